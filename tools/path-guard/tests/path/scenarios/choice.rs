//! Alternatives.

use super::{Places, ROUNDS};
use futures_lite::future;
use luna::prelude::*;
use std::time::Duration;

const LONG: Duration = Duration::from_secs(1000);
const SHORT: Duration = Duration::from_micros(50);

pub(crate) fn alternatives_of_inputs(places: &mut Places) {
    let (one, from_one) = luna::channel::<u64>();
    let (two, from_two) = luna::buffered::<u64>(Buffer::fifo(2));
    for (name, output) in [("one", one), ("two", two)] {
        places.process(name, async move {
            for n in 0..ROUNDS {
                output.send(n).await?;
            }
            Ok(())
        });
    }
    places.process("chooses", async move {
        let (mut one, mut two) = (true, true);
        let mut turn = 0;
        while one || two {
            turn += 1;
            if turn % 2 == 0 {
                alt! {
                    n = from_one.recv(), if one => one = n.is_ok(),
                    n = from_two.recv(), if two => two = n.is_ok(),
                }
            } else {
                pri_alt! {
                    n = from_one.recv(), if one => one = n.is_ok(),
                    n = from_two.recv(), if two => two = n.is_ok(),
                }
            }
            pri_alt! {
                n = from_one.recv(), if false => one = n.is_ok(),
                skip => {}
            }
        }
        assert_eq!(turn, 2 * ROUNDS + 2);
        Ok(())
    });
}

pub(crate) fn alternatives_of_outputs(places: &mut Places) {
    let (one, from_one) = luna::channel::<u64>();
    let (two, from_two) = luna::channel::<u64>();
    let (three, from_three) = luna::buffered::<u64>(Buffer::fifo(2));
    places.process("offers", async move {
        let mut slot = None;
        for n in 0..ROUNDS {
            slot.get_or_insert(n);
            alt! {
                sent = one.send_from(&mut slot) => sent?,
                sent = two.send_with(move || n) => sent?,
                sent = three.send(n) => sent?,
            }
        }
        Ok(())
    });
    for (name, input) in [("one", from_one), ("two", from_two), ("three", from_three)] {
        places.process(name, async move {
            while input.recv().await.is_ok() {}
            Ok(())
        });
    }
}

pub(crate) fn alternatives_on_both_sides(places: &mut Places) {
    let (a, from_a) = luna::channel::<u64>();
    let (b, from_b) = luna::channel::<u64>();
    places.process("sends or receives", async move {
        for n in 0..ROUNDS {
            alt! {
                sent = a.send(n) => sent?,
                got = from_b.recv() => { got?; }
            }
        }
        Ok(())
    });
    places.process("receives or sends", async move {
        for n in 0..ROUNDS {
            pri_alt! {
                sent = b.send(n) => sent?,
                got = from_a.recv() => { got?; }
            }
        }
        Ok(())
    });
}

pub(crate) fn alternatives_with_delays(places: &mut Places) {
    let (silent, silence) = luna::channel::<u64>();
    places.process("waits in vain", async move {
        for n in 0..20 {
            alt! {
                _ = silence.recv() => unreachable!(),
                _ = luna::after(SHORT) => {}
            }
            pri_alt! {
                _ = luna::at(luna::now() + SHORT) => {}
                _ = silent.send(n) => unreachable!(),
                _ = luna::after(LONG) => unreachable!(),
            }
        }
        Ok(())
    });
}

/// Alternatives that are dropped while they wait, with partners about.
pub(crate) fn a_choice_dropped(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let (other, from_other) = luna::channel::<u64>();
    places.process("gives up", async move {
        for _ in 0..ROUNDS {
            let choose = async {
                alt! {
                    n = input.recv() => { let _ = n; }
                    n = from_other.recv() => { let _ = n; }
                }
            };
            future::or(choose, luna::yield_now()).await;
        }
        Ok(())
    });
    for (name, output) in [("one", output), ("other", other)] {
        places.process(name, async move {
            while output.send(1).await.is_ok() {}
            Ok(())
        });
    }
}

pub(crate) fn fair_alternative_object(places: &mut Places) {
    serve(places, |inputs| Alternative::fair(inputs));
}

pub(crate) fn prioritized_alternative_object(places: &mut Places) {
    serve(places, |inputs| Alternative::prioritized(inputs));
}

/// A server over five channels. The object is created at the beginning, off the path, since it
/// allocates.
fn serve(places: &mut Places, make: for<'a> fn(&'a [Receiver<u64>]) -> Alternative<'a, u64>) {
    let (outputs, inputs): (Vec<_>, Vec<_>) = (0..5).map(|_| luna::channel::<u64>()).unzip();
    // An input without clients is always ready, so all clients end together.
    let end = Barrier::new(5);
    for (number, output) in outputs.into_iter().enumerate() {
        let end = end.clone();
        places.process_at(number as u8 * 6, &format!("client {number}"), async move {
            for n in 0..ROUNDS {
                output.send(n).await?;
            }
            end.sync().await;
            Ok(())
        });
    }
    places.process("server", async move {
        let mut alternative = luna::realtime::off_path(|| make(&inputs));
        for _ in 0..5 * ROUNDS {
            let (_, value) = alternative.recv().await;
            value?;
        }
        let (_, ended) = alternative.recv().await;
        assert!(ended.is_err());
        luna::realtime::off_path(|| drop(alternative));
        luna::realtime::off_path(|| drop(inputs));
        Ok(())
    });
}

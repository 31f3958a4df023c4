//! Channels of every kind, and every way to use them.

use super::{Places, ROUNDS};
use futures_lite::{StreamExt, future};
use luna::prelude::*;
use std::time::Duration;

const SHORT: Duration = Duration::from_micros(50);

pub(crate) fn rendezvous(places: &mut Places) {
    let (output, input) = luna::channel();
    places.process("source", async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
        }
        Ok(())
    });
    places.process("sink", async move {
        for n in 0..ROUNDS {
            assert_eq!(input.recv().await?, n);
        }
        Ok(())
    });
}

pub(crate) fn rendezvous_of_two_levels(places: &mut Places) {
    for (low, high) in [(3, 4), (20, 5)] {
        let (there, come) = luna::channel();
        let (back, again) = luna::channel();
        places.process_at(low, &format!("ping {low}"), async move {
            for n in 0..ROUNDS {
                there.send(n).await?;
                assert_eq!(again.recv().await?, n + 1);
            }
            Ok(())
        });
        places.process_at(high, &format!("pong {high}"), async move {
            while let Ok(n) = come.recv().await {
                back.send(n + 1).await?;
            }
            Ok(())
        });
    }
}

pub(crate) fn many_to_many(places: &mut Places) {
    let (output, input) = luna::channel();
    for sender in 0..4 {
        let output = output.clone();
        places.process_at(sender * 4, &format!("sender {sender}"), async move {
            for n in 0..ROUNDS {
                output.send(n).await?;
            }
            Ok(())
        });
    }
    for receiver in 0..4 {
        let input = input.clone();
        places.process_at(receiver * 5, &format!("receiver {receiver}"), async move {
            while input.recv().await.is_ok() {}
            Ok(())
        });
    }
}

pub(crate) fn offers_that_do_not_wait(places: &mut Places) {
    let (output, input) = luna::channel();
    let (done, ended) = luna::channel::<()>();
    places.process("tries to send", async move {
        let mut sent = 0;
        while sent < ROUNDS {
            match output.try_send(sent) {
                Ok(()) => sent += 1,
                // Not by a yield, which would starve a process of lower priority on the same core.
                Err(error) => {
                    assert!(error.is_full());
                    luna::after(SHORT / 5).await;
                }
            }
        }
        drop(done);
        Ok(())
    });
    places.process("waits", async move {
        for n in 0..ROUNDS {
            assert_eq!(input.recv().await?, n);
        }
        // All senders are gone in the end.
        while input.try_recv().is_err_and(|error| error.is_empty()) {
            luna::after(SHORT).await;
        }
        assert!(ended.recv().await.is_err());
        Ok(())
    });
}

pub(crate) fn values_that_stay(places: &mut Places) {
    let (output, input) = luna::channel();
    places.process("keeps its value", async move {
        let mut slot = None;
        for n in 0..ROUNDS {
            slot = Some(n);
            output.send_from(&mut slot).await?;
            assert_eq!(slot, None);
            output.send_with(move || n).await?;
        }
        assert_eq!(slot, None);
        Ok(())
    });
    places.process("takes it", async move {
        for n in 0..ROUNDS {
            assert_eq!((input.recv().await?, input.recv().await?), (n, n));
        }
        Ok(())
    });
}

pub(crate) fn fifo_buffers(places: &mut Places) {
    let (output, input) = luna::buffered(Buffer::fifo(4));
    places.process("source", async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
        }
        Ok(())
    });
    places.process("sink", async move {
        for n in 0..ROUNDS {
            assert_eq!(input.recv().await?, n);
            assert!(input.buffered() <= 4);
        }
        assert!(input.recv().await.is_err());
        Ok(())
    });
}

pub(crate) fn overwriting_buffers(places: &mut Places) {
    for (name, buffer) in [
        ("oldest", Buffer::overwrite_oldest(2)),
        ("newest", Buffer::overwrite_newest(2)),
    ] {
        let (output, input) = luna::buffered(buffer);
        places.process(&format!("overwrites the {name}"), async move {
            for n in 0..ROUNDS {
                output.send(n).await?;
                if n % 8 == 0 {
                    luna::yield_now().await;
                }
            }
            Ok(())
        });
        places.process(&format!("looks at the {name}"), async move {
            let mut last = None;
            while let Ok(n) = input.recv().await {
                assert!(last < Some(n));
                last = Some(n);
            }
            assert_eq!(last, Some(ROUNDS - 1));
            Ok(())
        });
    }
}

pub(crate) fn timeouts(places: &mut Places) {
    let (silent, silence) = luna::channel::<u64>();
    let (output, input) = luna::channel::<u64>();
    places.process("runs out of time", async move {
        for _ in 0..20 {
            let error = silence.recv_timeout(SHORT).await.unwrap_err();
            assert!(error.is_timeout());
            let error = silent
                .send_deadline(1, luna::now() + SHORT)
                .await
                .unwrap_err();
            assert!(error.is_timeout());
        }
        Ok(())
    });
    let second = Duration::from_secs(1000);
    places.process("sends in time", async move {
        for n in 0..ROUNDS {
            output.send_timeout(n, second).await?;
        }
        Ok(())
    });
    places.process("receives in time", async move {
        for n in 0..ROUNDS {
            assert_eq!(input.recv_deadline(luna::now() + second).await?, n);
        }
        Ok(())
    });
}

/// Operations that a combinator drops while they wait, and after they were served.
pub(crate) fn dropped_operations(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let (done, ended) = luna::channel::<()>();
    places.process("withdraws its offers", async move {
        for n in 0..ROUNDS {
            let offer = async { output.send(n).await.is_ok() };
            future::or(offer, async {
                luna::yield_now().await;
                false
            })
            .await;
        }
        drop(done);
        Ok(())
    });
    places.process("withdraws too", async move {
        let is_over = async {
            let _ = ended.recv().await;
            false
        };
        let takes = async {
            loop {
                let take = async { Some(input.recv().await) };
                let pause = async {
                    luna::after(SHORT).await;
                    None
                };
                if let Some(Err(_)) = future::or(take, pause).await {
                    return true;
                }
            }
        };
        future::or(takes, is_over).await;
        Ok(())
    });
}

pub(crate) fn streams(places: &mut Places) {
    let (output, input) = luna::channel();
    places.process("source", async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
        }
        Ok(())
    });
    places.process("sink", async move {
        let sum = input.stream().fold(0, |sum, n| sum + n).await;
        assert_eq!(sum, ROUNDS * (ROUNDS - 1) / 2);
        Ok(())
    });
}

pub(crate) fn closed_channels(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let (back, again) = luna::buffered::<u64>(Buffer::fifo(2));
    places.process("goes first", async move {
        luna::after(SHORT).await;
        back.send(1).await?;
        // Both ends go at the end of the body, which frees no channel here.
        drop(output);
        Ok(())
    });
    for waiting in 0..3 {
        let (input, again) = (input.clone(), again.clone());
        places.process(&format!("left behind {waiting}"), async move {
            assert!(input.recv().await.unwrap_err().is_closed());
            let _ = again.recv().await;
            Ok(())
        });
    }
}

pub(crate) fn poisoned_channels(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    let (buffer, buffered) = luna::buffered::<u64>(Buffer::fifo(8));
    let (poisoner, of_buffer) = (input.clone(), buffered.clone());
    places.process("poisons", async move {
        buffered.recv().await?;
        luna::after(SHORT).await;
        poisoner.poison();
        of_buffer.poison();
        Ok(())
    });
    for waiting in 0..3 {
        let (input, output) = (input.clone(), output.clone());
        places.process(&format!("receives {waiting}"), async move {
            while input.recv().await.is_ok() {}
            assert!(output.send(1).await.unwrap_err().is_poisoned());
            Ok(())
        });
    }
    places.process("fills a buffer", async move {
        while buffer.send(1).await.is_ok() {}
        Ok(())
    });
}

pub(crate) fn waiting_for_the_end(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    places.process("watches", async move {
        output.ended().await;
        assert!(output.send(1).await.is_err());
        Ok(())
    });
    places.process("ends", async move {
        luna::after(SHORT).await;
        drop(input);
        Ok(())
    });
}

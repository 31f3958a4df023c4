//! Barriers, extended rendezvous and calls.

use super::{Places, ROUNDS};
use futures_lite::future;
use luna::channel::call_channel;
use luna::prelude::*;
use std::time::Duration;

pub(crate) fn barriers(places: &mut Places) {
    let barrier = Barrier::new(4);
    for party in 0..4 {
        let barrier = barrier.clone();
        places.process_at(party * 8, &format!("party {party}"), async move {
            for _ in 0..ROUNDS {
                barrier.sync().await;
            }
            Ok(())
        });
    }
}

pub(crate) fn barriers_as_guards(places: &mut Places) {
    let barrier = Barrier::new(3);
    for party in 0..3 {
        let barrier = barrier.clone();
        let (silent, silence) = luna::channel::<u64>();
        places.process(&format!("party {party}"), async move {
            for _ in 0..ROUNDS {
                alt! {
                    _ = barrier.sync() => {}
                    _ = silence.recv() => unreachable!(),
                    _ = luna::after(Duration::from_secs(1000)) => unreachable!(),
                }
            }
            drop(silent);
            Ok(())
        });
    }
}

pub(crate) fn barriers_of_two_levels(places: &mut Places) {
    let barrier = Barrier::new(2);
    let group = barrier.local(3);
    let executor = places.system.executor("group").build().unwrap();
    for member in 0..3 {
        let group = group.clone();
        executor
            .process(format!("member {member}"))
            .spawn(move || async move {
                for _ in 0..ROUNDS {
                    group.sync().await;
                }
                Ok(())
            })
            .unwrap();
    }
    places.process("alone", async move {
        for _ in 0..ROUNDS {
            barrier.sync().await;
        }
        Ok(())
    });
}

pub(crate) fn barriers_that_are_joined_and_left(places: &mut Places) {
    let barrier = Barrier::new(2);
    let visited = barrier.clone();
    places.process("stays", async move {
        for _ in 0..ROUNDS {
            barrier.sync().await;
        }
        barrier.resign();
        Ok(())
    });
    places.process("brings another along", async move {
        for _ in 0..ROUNDS {
            let party = visited.enroll();
            par!(
                async {
                    party.sync().await;
                    luna::Result::Ok(())
                },
                async {
                    visited.sync().await;
                    luna::Result::Ok(())
                },
            )
            .await?;
            drop(party);
        }
        visited.resign();
        Ok(())
    });
}

pub(crate) fn extended_rendezvous(places: &mut Places) {
    let (output, input) = luna::channel::<u64>();
    places.process("source", async move {
        for n in 0..ROUNDS {
            output.send(n).await?;
        }
        Ok(())
    });
    places.process("holds its sender", async move {
        for n in 0..ROUNDS {
            if n % 2 == 0 {
                let value = input.recv_extended().await?;
                luna::yield_now().await;
                assert_eq!(value.finish(), n);
            } else {
                alt! {
                    value = input.recv_extended() => assert_eq!(*value?, n),
                }
            }
        }
        Ok(())
    });
}

pub(crate) fn calls(places: &mut Places) {
    let (client, server) = call_channel::<u64, u64>();
    for (number, level) in [(0, 30), (1, 3)] {
        let client = client.clone();
        places.process_at(level, &format!("client {number}"), async move {
            for n in 0..ROUNDS {
                let answer = client.call(n).await;
                if n % 10 == 0 {
                    assert!(answer.unwrap_err().is_unanswered());
                } else {
                    assert_eq!(answer.unwrap(), n + 1);
                }
                alt! {
                    answer = client.call(1) => assert_eq!(answer.unwrap(), 2),
                }
            }
            Ok(())
        });
    }
    drop(client);
    places.process_at(10, "server", async move {
        while let Ok(call) = server.accept().await {
            if *call % 10 != 0 {
                luna::yield_now().await;
                let answer = *call + 1;
                let _ = call.reply(answer);
            }
        }
        Ok(())
    });
}

/// A server that is a client while it serves: priorities are inherited through both calls, and
/// where executors have priorities, threads are boosted.
pub(crate) fn nested_calls(places: &mut Places) {
    let (client, server) = call_channel::<u64, u64>();
    let (inner, inner_server) = call_channel::<u64, u64>();
    places.process_at(3, "inner server", async move {
        while let Ok(call) = inner_server.accept().await {
            let answer = *call + 1;
            let _ = call.reply(answer);
        }
        Ok(())
    });
    places.process_at(20, "client", async move {
        for n in 0..ROUNDS {
            assert_eq!(client.call(n).await?, n + 1);
        }
        Ok(())
    });
    places.process_at(5, "middle", async move {
        while let Ok(call) = server.accept().await {
            let answer = inner.call(*call).await?;
            let _ = call.reply(answer);
        }
        Ok(())
    });
}

/// Calls that are dropped while they wait, while they are served, and by servers; and an end by
/// poison.
pub(crate) fn calls_that_are_given_up(places: &mut Places) {
    let (client, server) = call_channel::<u64, u64>();
    let poisoner = client.clone();
    for number in 0..2 {
        let client = client.clone();
        places.process(&format!("impatient {number}"), async move {
            for n in 0..ROUNDS {
                let call = async { drop(client.call(n).await) };
                future::or(call, luna::after(Duration::from_micros(n % 50))).await;
            }
            Ok(())
        });
    }
    places.process("server", async move {
        loop {
            match server.accept().await {
                Err(_) => return Ok(()),
                Ok(call) if *call % 3 == 0 => drop(call),
                Ok(call) => {
                    luna::yield_now().await;
                    let _ = call.reply(1);
                }
            }
        }
    });
    places.process("poisons", async move {
        luna::after(Duration::from_millis(5)).await;
        poisoner.poison();
        Ok(())
    });
}

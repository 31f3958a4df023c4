//! A deadlock that comes later: after others have come and gone.

use super::*;
use crate::common::SpawnOk;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

#[test]
fn processes_that_come_while_it_runs_are_no_deadlock_and_can_come_to_one() {
    let _watchdog = watchdog();
    for spawned_on in PLACEMENTS {
        for is_good in [true, false] {
            let mut system = strict("late");
            let main = system.executor("main").build().unwrap();
            let mut other = Some(match spawned_on {
                Placement::Executor => system.executor("other").build().unwrap().process("late 1"),
                Placement::Thread => system.thread("other").process("late 1"),
            });
            let (sender, receiver) = luna::channel();
            main.process("first").spawn_ok(async move {
                let late = other.take().unwrap();
                late.spawn(async move {
                    if is_good {
                        sender.send(7).await?;
                    } else {
                        let (_keep, never) = luna::channel::<()>();
                        never.recv().await?;
                        drop(sender);
                    }
                    Ok(())
                })?;
                receiver.recv().await?;
                Ok(())
            });
            if is_good {
                assert_eq!(system.run().unwrap().deadlock, None);
            } else {
                let found = deadlock_of(&system);
                assert_eq!(found.waits[1].process, "late 1", "{found}");
            }
        }
    }
}

#[test]
fn many_that_wake_each_other_across_threads_are_no_deadlock_until_they_are() {
    let _watchdog = watchdog();
    let mut random = common::Random::seeded();
    for _ in 0..20 {
        let mut system = strict("ring");
        let count = 2 + random.below(4) as usize;
        let rounds = 50 + random.below(200);
        let channels: Vec<_> = (0..count).map(|_| luna::channel::<u64>()).collect();
        let hops_made = Arc::new(AtomicU64::new(0));
        for n in 0..count {
            let hops_made = hops_made.clone();
            let place = PLACEMENTS[random.below(2) as usize];
            let (to, from) = (channels[n].0.clone(), channels[(n + 1) % count].1.clone());
            place
                .process(&mut system, &format!("t{n}"), &format!("p{n}"))
                .spawn_ok(async move {
                    if n == 0 {
                        to.send(0).await?;
                    }
                    loop {
                        let hops = from.recv().await?;
                        hops_made.fetch_add(1, Ordering::Relaxed);
                        if hops < rounds {
                            to.send(hops + 1).await?;
                        }
                        // Else the token is lost, and all wait for ever.
                    }
                });
        }
        drop(channels);
        let found = deadlock_of(&system);
        // The token is received with each number from 0 to `rounds`.
        let made = hops_made.load(Ordering::Relaxed);
        assert_eq!(made, rounds + 1, "it was found before the token was lost");
        assert_eq!(found.waits.len(), count);
        assert_eq!(found.cycle.len(), count, "{found}");
    }
}

#[test]
fn it_is_found_also_after_the_outside_has_come_and_gone() {
    let _watchdog = watchdog();
    let mut system = strict("then");
    let (sender, receiver) = luna::channel();
    let sender = sender.external();
    let (_keep, never) = luna::channel::<()>();
    let main = system.executor("main").build().unwrap();
    main.process("process").spawn_ok(async move {
        receiver.recv().await?;
        never.recv().await?;
        Ok(())
    });
    std::thread::spawn(move || {
        std::thread::sleep(LONG);
        sender.blocking_send(()).unwrap();
    });
    assert_eq!(deadlock_of(&system).waits.len(), 1);
}

#[test]
fn it_is_found_also_when_the_last_call_is_forgotten() {
    let _watchdog = watchdog();
    let mut system = strict("call");
    let (_keep, never) = luna::channel::<()>();
    let main = system.executor("main").build().unwrap();
    main.process("process").spawn_ok(async move {
        {
            let mut call = std::pin::pin!(luna::blocking(|| std::thread::sleep(LONG)));
            std::future::poll_fn(|cx| {
                assert!(call.as_mut().poll(cx).is_pending());
                std::task::Poll::Ready(())
            })
            .await;
        }
        never.recv().await?;
        Ok(())
    });
    assert_eq!(deadlock_of(&system).waits.len(), 1);
}

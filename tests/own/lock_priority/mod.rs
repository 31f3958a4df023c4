//! The holder of a mutex works at the priority of its most urgent waiter, along chains, until it
//! unlocks. Seen in the order of events, and in the kernel's data on the threads.

mod several;

use crate::common;
use crate::levels;
use common::{Log, SpawnOk, real_time_core};
use levels::{burner, level, on_one_executor};
use luna::prelude::*;
use luna::sync::Mutex;
use luna::system::ProcessBuilder;
use luna::yield_now;
use luna_core::current;
use luna_platform::thread::{Attributes, current_policy};
use std::convert::Infallible;
use std::time::Duration;

/// Whether the locks of mutexes are biased to the executor: then a free mutex is locked and
/// unlocked on the fast path.
const IS_BIASED: [bool; 2] = [false, true];

/// Free mutexes of one executor, for processes that are spawned afterwards.
fn mutexes<const N: usize>(
    process: &dyn Fn(&str, u8) -> ProcessBuilder,
    is_biased: bool,
) -> [Mutex<()>; N] {
    let mutexes = [(); N].map(|()| Mutex::new(()));
    if is_biased {
        let mutexes = mutexes.clone();
        process("first user", 31).spawn_ok(async move {
            for _ in 0..100 {
                for mutex in &mutexes {
                    drop(mutex.lock().await?);
                }
            }
            Ok(())
        });
    }
    mutexes
}

/// A process that locks `mutex` once it is let, and holds it for a moment.
fn locker(process: ProcessBuilder, mutex: &Mutex<()>) -> luna::Sender<()> {
    let (go, gone) = luna::channel::<()>();
    let mutex = mutex.clone();
    process.spawn_ok(async move {
        gone.recv().await?;
        let guard = mutex.lock().await?;
        yield_now().await;
        drop(guard);
        Ok(())
    });
    go
}

#[test]
fn nobody_between_the_holder_and_the_one_that_waits_runs_before_it_unlocks() {
    own_process!();
    for is_biased in IS_BIASED {
        let log = Log::default();
        on_one_executor(|process| {
            let [mutex] = mutexes(process, is_biased);
            let start = burner(process("burner", 10), &log);
            let (go, gone) = luna::channel::<()>();
            let (own, theirs) = (log.clone(), mutex.clone());
            process("high", 20).spawn_ok(async move {
                gone.recv().await?;
                start.try_send(())?;
                own.add("waits");
                let _guard = theirs.lock().await?;
                own.add("holds");
                Ok(())
            });
            let own = log.clone();
            process("low", 1).spawn_ok(async move {
                let guard = mutex.lock().await?;
                // The other process runs at once. So this one is ready at level 1 when it is
                // boosted further, and the burner is ready above it.
                go.send(()).await?;
                assert_eq!(level(), 20);
                for _ in 0..5 {
                    yield_now().await;
                }
                own.add("unlocks");
                drop(guard);
                assert_eq!(level(), 1);
                yield_now().await;
                own.add("low");
                Ok(())
            });
        });
        assert_eq!(log.between("waits", "holds"), ["unlocks"]);
        assert_eq!(log.between("holds", "low"), ["burn"; 50]);
    }
}

#[test]
fn a_chain_of_holders_passes_it_on() {
    own_process!();
    for is_biased in IS_BIASED {
        let log = Log::default();
        on_one_executor(|process| {
            let [first, second] = mutexes(process, is_biased);
            let start = burner(process("burner", 10), &log);
            let (go_high, gone_high) = luna::channel::<()>();
            let (go_middle, gone_middle) = luna::channel::<()>();
            let (own, wanted) = (log.clone(), first.clone());
            process("high", 20).spawn_ok(async move {
                gone_high.recv().await?;
                start.try_send(())?;
                own.add("waits");
                let _guard = wanted.lock().await?;
                own.add("holds");
                Ok(())
            });
            let (holds, wanted) = (first.clone(), second.clone());
            process("middle", 2).spawn_ok(async move {
                gone_middle.recv().await?;
                let guard = holds.lock().await?;
                let wanted = wanted.lock().await?;
                assert_eq!(level(), 20);
                drop(wanted);
                yield_now().await;
                assert_eq!(level(), 20);
                drop(guard);
                assert_eq!(level(), 2);
                Ok(())
            });
            process("low", 1).spawn_ok(async move {
                let guard = second.lock().await?;
                go_middle.send(()).await?;
                yield_now().await;
                assert_eq!(level(), 2, "lent by the one in the middle");
                go_high.send(()).await?;
                yield_now().await;
                assert_eq!(
                    level(),
                    20,
                    "lent by the high one through the one in the middle"
                );
                yield_now().await;
                drop(guard);
                assert_eq!(level(), 1);
                Ok(())
            });
        });
        assert_eq!(log.between("waits", "holds"), [""; 0]);
    }
}

#[test]
fn a_waiter_that_gives_up_ends_its_boosts_along_the_chain() {
    own_process!();
    on_one_executor(|process| {
        let (first, second) = (Mutex::new(()), Mutex::new(()));
        let (go, gone) = luna::channel::<()>();
        let (gave_up, given_up) = luna::channel::<()>();
        let wanted = first.clone();
        process("high", 20).spawn_ok(async move {
            gone.recv().await?;
            let late = wanted.lock_timeout(Duration::from_millis(300)).await;
            assert!(late.is_err_and(|error| error.is_timeout()));
            gave_up.send(()).await?;
            Ok(())
        });
        let (go_middle, gone_middle) = luna::channel::<()>();
        let (holds, wanted) = (first.clone(), second.clone());
        process("middle", 2).spawn_ok(async move {
            gone_middle.recv().await?;
            let _guard = holds.lock().await?;
            let _wanted = wanted.lock().await?;
            assert_eq!(level(), 2);
            Ok(())
        });
        process("low", 1).spawn_ok(async move {
            let guard = second.lock().await?;
            go_middle.send(()).await?;
            yield_now().await;
            go.send(()).await?;
            yield_now().await;
            assert_eq!(level(), 20);
            given_up.recv().await?;
            assert_eq!(level(), 2, "the one in the middle waits on");
            drop(guard);
            assert_eq!(level(), 1);
            Ok(())
        });
    });
}

#[test]
fn the_next_holder_inherits_from_those_behind_it() {
    own_process!();
    for is_biased in IS_BIASED {
        on_one_executor(|process| {
            let [mutex] = mutexes(process, is_biased);
            let go = locker(process("behind", 20), &mutex);
            let wanted = mutex.clone();
            let (notify, notified) = luna::channel::<()>();
            process("next", 5).spawn_ok(async move {
                notified.recv().await?;
                let guard = wanted.lock().await?;
                assert_eq!(level(), 5, "nobody else waits");
                go.send(()).await?;
                yield_now().await;
                assert_eq!(level(), 20);
                drop(guard);
                assert_eq!(level(), 5);
                Ok(())
            });
            process("holder", 1).spawn_ok(async move {
                let guard = mutex.lock().await?;
                notify.send(()).await?;
                yield_now().await;
                assert_eq!(level(), 5);
                drop(guard);
                Ok(())
            });
        });
    }
}

/// The next holder was handed the mutex and has not run yet when a more urgent waiter comes: the
/// holder moves up before the levels between.
#[test]
fn one_that_was_handed_the_mutex_and_is_queued_moves_up() {
    own_process!();
    let (log, mutex) = (Log::default(), Mutex::new(()));
    on_one_executor(|process| {
        let (release, released) = luna::buffered::<()>(Buffer::fifo(1));
        let (start_between, between) = luna::buffered::<()>(Buffer::fifo(1));
        let (start_urgent, urgent) = luna::buffered::<()>(Buffer::fifo(1));
        let (own, first) = (mutex.clone(), log.clone());
        process("first", 25).spawn_ok(async move {
            let guard = own.lock().await?;
            released.recv().await?;
            drop(guard);
            start_between.try_send(()).unwrap();
            start_urgent.try_send(()).unwrap();
            first.add("handed over");
            Ok(())
        });
        let (own, next) = (mutex.clone(), log.clone());
        process("next", 10).spawn_ok(async move {
            // It waits in the mutex when it lets the first go on.
            par!(
                async {
                    drop(own.lock().await?);
                    next.add("next unlocks");
                    Ok(())
                },
                async {
                    release.send(()).await?;
                    Ok(())
                }
            )
            .await?;
            Ok(())
        });
        let between_log = log.clone();
        process("between", 20).spawn_ok(async move {
            between.recv().await?;
            between_log.add("between");
            Ok(())
        });
        let (own, last) = (mutex.clone(), log.clone());
        process("urgent", 30).spawn_ok(async move {
            urgent.recv().await?;
            drop(own.lock().await?);
            last.add("urgent");
            Ok(())
        });
    });
    let order = log.between("handed over", "urgent");
    assert_eq!(order, Vec::from(["next unlocks"]));
}

/// A branch that waits for what another branch of its process holds does not boost that branch;
/// least of all does it pass on what the process inherits.
#[test]
fn one_that_inherits_does_not_lend_it_to_itself() {
    own_process!();
    let (mutex, log) = (Mutex::new(()), Log::default());
    on_one_executor(|process| {
        let (own, seen) = (mutex.clone(), log.clone());
        let (wait, waits) = luna::buffered::<()>(Buffer::fifo(1));
        let (end, ended) = luna::buffered::<()>(Buffer::fifo(1));
        process("both", 10).spawn_ok(async move {
            par!(
                async {
                    let guard = own.lock().await?;
                    yield_now().await; // the other branch waits for it now
                    wait.send(()).await?;
                    ended.recv().await?;
                    if level() == 10 {
                        seen.add("its own level again");
                    }
                    drop(guard);
                    Ok(())
                },
                async {
                    drop(own.lock().await?);
                    Ok(())
                }
            )
            .await?;
            Ok(())
        });
        let (own, seen) = (mutex.clone(), log.clone());
        process("gives up", 30).spawn_ok(async move {
            waits.recv().await?;
            let given_up = own.lock_timeout(Duration::from_millis(1)).await;
            assert!(given_up.is_err());
            seen.add("given up");
            end.send(()).await?;
            Ok(())
        });
    });
    assert_eq!(log.all(), ["given up", "its own level again"]);
}

#[test]
fn branches_of_one_process_do_not_lift_each_other() {
    own_process!();
    on_one_executor(|process| {
        process("both", 10).spawn_ok(async move {
            let mutex = Mutex::new(());
            let (go, gone) = luna::channel::<()>();
            pri_par!(
                async {
                    gone.recv().await?;
                    drop(mutex.lock().await?);
                    assert_eq!(level(), 10);
                    Ok(())
                },
                async {
                    let guard = mutex.lock().await?;
                    go.send(()).await?;
                    for _ in 0..5 {
                        yield_now().await;
                        assert_eq!(level(), 9, "it would climb by one each time");
                    }
                    drop(guard);
                    Ok(())
                },
            )
            .await?;
            assert_eq!(level(), 10);
            Ok(())
        });
    });
}

#[test]
fn a_chain_reaches_across_three_threads() {
    own_process!();
    if real_time_core().is_none() {
        return;
    }
    let mut system = System::new("chain");
    let (first, second) = (Mutex::new(()), Mutex::new(()));
    let (go_middle, gone_middle) = luna::channel::<()>();
    let (go_high, gone_high) = luna::channel::<()>();
    let wanted = first.clone();
    system
        .thread("high")
        .policy(Policy::fifo(60))
        .process("high")
        .spawn_ok(async move {
            gone_high.recv().await?;
            drop(wanted.blocking_lock()?);
            Ok(())
        });
    let (holds, wanted) = (first.clone(), second.clone());
    system
        .executor("middle")
        .policy(Policy::fifo(30))
        .build()
        .unwrap()
        .process("middle")
        .spawn_ok(async move {
            gone_middle.recv().await?;
            let guard = holds.lock().await?;
            go_high.send(()).await?;
            let wanted = wanted.lock().await?;
            assert_eq!(current_policy(), Policy::fifo(60));
            drop((wanted, guard));
            assert_eq!(current_policy(), Policy::fifo(30));
            Ok(())
        });
    let own = Policy::fifo(20);
    let plain = luna_platform::thread::spawn(
        Attributes::new("low").policy(own),
        |_| Ok::<_, Infallible>(()),
        move |()| {
            let guard = second.blocking_lock().unwrap();
            go_middle.blocking_send(()).unwrap();
            // By way of the one in the middle, whether it waits here before or after the high one
            // waits for it.
            while current_policy() != Policy::fifo(60) {}
            drop(guard);
            assert_eq!(current_policy(), own);
        },
    )
    .unwrap();
    system.run().unwrap();
    plain.join().unwrap();
    assert_eq!(current::refused_boosts(), None);
}

#[test]
fn plain_threads_wait_at_their_own_priority() {
    own_process!();
    if real_time_core().is_none() {
        return;
    }
    let order = Mutex::new(Vec::with_capacity(3)).named("order");
    let guard = order.try_lock().unwrap();
    let threads: Vec<_> = [Policy::Other, Policy::fifo(5), Policy::fifo(7)]
        .into_iter()
        .enumerate()
        .map(|(number, policy)| {
            let theirs = order.clone();
            let thread = luna_platform::thread::spawn(
                Attributes::new("waits").policy(policy),
                |_| Ok::<_, Infallible>(()),
                move |()| theirs.blocking_lock().unwrap().push(policy),
            );
            let waiting = || {
                let places = luna::inspect::wait_points();
                let place = places
                    .iter()
                    .find(|one| one.name.as_deref() == Some("order"));
                place.map_or(0, |place| place.waiting.len())
            };
            while waiting() <= number {
                std::thread::yield_now();
            }
            thread.unwrap()
        })
        .collect();
    assert_eq!(current_policy(), Policy::fifo(7), "this thread holds it");
    drop(guard);
    assert_eq!(current_policy(), Policy::Other);
    for thread in threads {
        thread.join().unwrap();
    }
    let order = order.try_lock().unwrap();
    assert_eq!(*order, [Policy::fifo(7), Policy::fifo(5), Policy::Other]);
}

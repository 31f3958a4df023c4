//! Locks in a system: in parallel constructs, in reports, and as errors.

use crate::common;
use common::{PLACEMENTS, SpawnOk, deadlock_of, strict, watchdog};
use luna::inspect::{Operation, Partner};
use luna::prelude::*;
use luna::sync::{Condvar, LockError, Mutex, Semaphore};
use luna::{Error, yield_now};
use std::time::Duration;

async fn fails() -> luna::Result<()> {
    yield_now().await;
    Err(Error::Timeout)
}

/// Runs `branch` beside one that fails; gives the errors of both.
fn beside_a_failure(branch: impl Future<Output = luna::Result<()>>) -> Vec<Error> {
    let outcome = luna::run(async { par!(branch, fails()).await });
    outcome.unwrap_err().errors().cloned().collect()
}

#[test]
fn a_branch_beside_a_failure_does_not_wait_for_locks() {
    let _watch = watchdog();
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    let held = mutex.try_lock().unwrap();
    let none = Semaphore::new(0);
    let poisoned = [Error::Poisoned, Error::Timeout];
    assert_eq!(
        beside_a_failure(async {
            drop(mutex.lock().await?);
            Ok(())
        }),
        poisoned
    );
    assert_eq!(
        beside_a_failure(async {
            drop(none.acquire().await?);
            Ok(())
        }),
        poisoned
    );
    drop(held);
    assert_eq!(
        beside_a_failure(async {
            let guard = mutex.lock().await?;
            drop(condition.wait(guard).await?);
            Ok(())
        }),
        poisoned
    );
    condition.notify_one();
    assert!(mutex.try_lock().is_ok(), "nobody has died with it");
    assert_eq!(none.available_permits(), 0);
}

#[test]
fn a_branch_that_is_ended_in_the_middle_marks_its_mutex() {
    let _watch = watchdog();
    let (mutex, barrier) = (Mutex::new(0), Barrier::new(2));
    let errors = beside_a_failure(async {
        let _guard = mutex.lock().await?;
        // There is no error to return here, so the branch ends.
        barrier.sync().await;
        Ok(())
    });
    assert_eq!(errors, [Error::Poisoned, Error::Timeout]);
    let error = luna::run(async {
        drop(mutex.lock().await?);
        Ok(())
    })
    .unwrap_err();
    assert_eq!(error, Error::OwnerDied);
    // The error has let it go, and it is marked all the same.
    let Err(error @ LockError::OwnerDied(_)) = mutex.blocking_lock() else {
        panic!("it is marked");
    };
    drop(error.recover());
    assert!(mutex.blocking_lock().is_ok());
}

#[test]
fn errors_turn_into_luna_errors() {
    let _watch = watchdog();
    let short = Duration::from_millis(1);
    let mutex = Mutex::new(());
    let held = mutex.try_lock().unwrap();
    let none = Semaphore::new(0);
    let timeout = luna::run(async {
        drop(mutex.lock_timeout(short).await?);
        Ok(())
    });
    assert_eq!(timeout.unwrap_err(), Error::Timeout);
    let timeout = luna::run(async {
        drop(none.acquire_timeout(short).await?);
        Ok(())
    });
    assert_eq!(timeout.unwrap_err(), Error::Timeout);
    let locked: luna::Result<()> = (|| {
        drop(mutex.try_lock()?);
        Ok(())
    })();
    assert_eq!(locked.unwrap_err(), Error::Locked);
    drop(held);
}

#[test]
fn two_mutexes_in_opposite_order_are_reported_with_their_holders() {
    let _watch = watchdog();
    for left in PLACEMENTS {
        for right in PLACEMENTS {
            let mut system = strict("two");
            let mutexes = ["one", "other"].map(|name| Mutex::new(()).named(name));
            let meet = Barrier::new(2);
            let processes = [
                left.process(&mut system, "l", "left"),
                right.process(&mut system, "r", "right"),
            ];
            for (number, process) in processes.into_iter().enumerate() {
                let (first, second) = (mutexes[number].clone(), mutexes[1 - number].clone());
                let meet = meet.clone();
                process.spawn_ok(async move {
                    let _first = first.lock().await?;
                    meet.sync().await;
                    let _second = second.lock().await?;
                    Ok(())
                });
            }
            let found = deadlock_of(&system);
            assert_eq!(found.waits.len(), 2, "{found}");
            assert_eq!(found.waits[0].operation, Operation::Lock);
            assert_eq!(found.waits[0].at, "mutex `other`");
            assert_eq!(found.waits[0].partner, Partner::Process("right".into()));
            assert_eq!(found.cycle, ["left", "right"]);
            assert!(
                found
                    .to_string()
                    .contains("`right` waits to lock mutex `one` for `left`, which holds it"),
                "{found}"
            );
        }
    }
}

/// So many uses by one executor that the lock inside a mutex is biased to it: from then on a free
/// mutex is locked on the fast path.
const WARM: u32 = 100;

#[test]
fn one_that_locks_what_it_holds_is_reported() {
    let _watch = watchdog();
    for locked_before in [0, WARM] {
        let mut system = strict("own");
        let main = system.executor("main").build().unwrap();
        let mutex = Mutex::new(()).named("own");
        main.process("twice").spawn_ok(async move {
            for _ in 0..locked_before {
                drop(mutex.lock().await?);
            }
            let _guard = mutex.lock().await?;
            let _again = mutex.lock().await?;
            Ok(())
        });
        let found = deadlock_of(&system);
        assert_eq!(found.cycle, ["twice"]);
        assert!(
            found
                .to_string()
                .contains("`twice` waits to lock mutex `own`, which it holds itself"),
            "{found}"
        );
    }
}

#[test]
fn one_that_waits_at_a_condition_or_for_permits_is_reported() {
    let _watch = watchdog();
    let mut system = strict("both");
    let main = system.executor("main").build().unwrap();
    let condition = Condvar::new().named("filled");
    main.process("waits").spawn_ok(async move {
        let mutex = Mutex::new(());
        let guard = mutex.lock().await?;
        drop(condition.wait(guard).await?);
        Ok(())
    });
    let permits = Semaphore::new(1).named("slots");
    main.process("acquires").spawn_ok(async move {
        permits.acquire().await?.forget();
        permits.acquire().await?.forget();
        Ok(())
    });
    let found = deadlock_of(&system);
    let text = found.to_string();
    for line in [
        "`waits` waits to be notified at condition `filled`, where nobody has notified yet",
        "`acquires` waits for permits of semaphore `slots`, and acquired there last itself",
    ] {
        assert!(text.contains(line), "{text}");
    }
}

#[test]
fn what_a_thread_outside_may_do_is_no_deadlock() {
    let _watch = watchdog();
    let mut system = strict("outside");
    let main = system.executor("main").build().unwrap();
    let (mutex, condition) = (Mutex::new(false).named("shared"), Condvar::new().external());
    let held = mutex.clone();
    let (theirs, notifies) = (mutex.clone(), condition.clone());
    main.process("waits").spawn_ok(async move {
        let guard = mutex.lock().await?;
        drop(condition.wait_while(guard, |is_set| !*is_set).await?);
        Ok(())
    });
    let held = held.try_lock().unwrap();
    std::thread::scope(|scope| {
        let running = scope.spawn(|| system.run().map(drop));
        let is_waiting = || {
            let places = luna::inspect::wait_points();
            let shared = places
                .iter()
                .find(|one| one.name.as_deref() == Some("shared"));
            shared.is_some_and(|shared| !shared.waiting.is_empty())
        };
        while !is_waiting() {
            std::thread::yield_now();
        }
        drop(held);
        *theirs.blocking_lock().unwrap() = true;
        notifies.notify_one();
        running.join().unwrap().unwrap();
    });
}

#[test]
fn the_composition_shows_the_one_that_holds_a_mutex_as_long_as_it_does() {
    let _watch = watchdog();
    let mut system = System::new("shown");
    let main = system.executor("main").build().unwrap();
    let mutex = Mutex::new(()).named("table");
    let observer = system.observer();
    main.process("holder").spawn_ok(async move {
        let shown = || {
            let shown = observer.composition();
            let mut channels = shown.channels.iter();
            let table = channels.find(|one| one.name.as_deref() == Some("table"));
            table.map(|table| table.to_string())
        };
        for _ in 0..WARM {
            let guard = mutex.lock().await?;
            assert_eq!(shown().as_deref(), Some("mutex `table`: held by `holder`"));
            drop(guard);
            assert_eq!(shown(), None, "what no process uses is not shown");
        }
        Ok(())
    });
    system.run().unwrap();
}

#[test]
fn a_mutex_that_is_held_across_a_yield_is_locked_by_no_other_process() {
    let _watch = watchdog();
    let mut system = System::new("yield");
    let executor = system.executor("main").build().unwrap();
    let held_by = Mutex::new(0);
    for number in [1, 2] {
        let held_by = held_by.clone();
        let process = executor.process(format!("holder {number}"));
        process.spawn_ok(async move {
            for round in 0..2 * WARM {
                let mut holder = held_by.lock().await?;
                *holder = number;
                yield_now().await;
                assert_eq!(*holder, number, "round {round}");
                drop(holder);
                // So that the other one finds it free at times, and held at others.
                for _ in 0..round % 4 {
                    yield_now().await;
                }
            }
            Ok(())
        });
    }
    system.run().unwrap();
}

//! The mutex: one at a time, handed over by priority, never lost, and robust when its holder dies.

#![cfg(not(loom))]

use crate::common;
use common::{Wakes, Watchdog, pending, poll_with, ready, until_waiting};
use luna_channels::channel;
use luna_channels::lock_sync::{LockError, Mutex, MutexGuard, TryLockError};
use luna_core::{Executor, Exit, OsThread, ProcessSpec, yield_now};
use luna_platform::thread::Attributes;
use std::future::Future;
use std::sync::{Arc, mpsc};
use std::time::Duration;

const SHORT: Duration = Duration::from_millis(2);

/// Runs a process on an executor of its own, to its end.
fn on_executor<F: Future<Output = ()> + 'static>(
    body: impl FnOnce() -> F + Send + 'static,
) -> Exit {
    let executor = Executor::start(Attributes::new("test")).unwrap();
    let process = executor.spawn(ProcessSpec::new("process"), body);
    executor.release();
    process.wait()
}

/// Runs an OS-thread process to its end.
fn on_thread<F: Future<Output = ()> + 'static>(body: impl FnOnce() -> F + Send + 'static) -> Exit {
    let thread =
        OsThread::start(Attributes::new("test"), ProcessSpec::new("process"), body).unwrap();
    thread.release();
    thread.process().wait()
}

#[test]
fn it_unlocks_by_scope() {
    let mutex = Mutex::new(1);
    {
        let mut guard = mutex.try_lock().unwrap();
        *guard += 1;
        assert!(mutex.try_lock().unwrap_err().is_locked());
    }
    assert_eq!(*mutex.clone().try_lock().unwrap(), 2);
    mutex.try_lock().unwrap().unlock();
    assert!(mutex.try_lock().is_ok());
}

#[test]
fn the_value_goes_with_the_last_handle() {
    let value = Arc::new(());
    let mutex = Mutex::new(value.clone());
    let other = mutex.clone();
    drop(mutex);
    assert_eq!(Arc::strong_count(&value), 2);
    drop(other);
    assert_eq!(Arc::strong_count(&value), 1);
}

#[test]
fn a_holder_may_wait_and_its_executor_goes_on() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(Vec::new());
    let (go, gone) = channel::<()>();
    let executor = Executor::start(Attributes::new("one")).unwrap();
    let of_holder = mutex.clone();
    let holder = executor.spawn(ProcessSpec::new("holder").level(20), move || async move {
        let mut guard = of_holder.lock().await.unwrap();
        gone.recv().await.unwrap(); // from a process of this very executor
        guard.push("holder");
    });
    let of_next = mutex.clone();
    let next = executor.spawn(ProcessSpec::new("next").level(10), move || async move {
        of_next.lock().await.unwrap().push("next");
    });
    let other = executor.spawn(ProcessSpec::new("other").level(0), move || async move {
        go.send(()).await.unwrap();
    });
    executor.release();
    for process in [holder, next, other] {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(*mutex.try_lock().unwrap(), ["holder", "next"]);
}

/// One executor alone uses it for long; then a process of the same executor waits for it, then a
/// thread.
#[test]
fn a_mutex_of_one_executor_is_handed_over_there_and_to_a_thread() {
    const ALONE: u32 = 100;
    const TOGETHER: u32 = 200;
    let mutex = Mutex::new(0);
    let executor = Executor::start(Attributes::new("owner")).unwrap();
    let (says, hears) = mpsc::channel();
    let processes: Vec<_> = [5, 6]
        .into_iter()
        .map(|level| {
            let (mutex, says) = (mutex.clone(), says.clone());
            let spec = ProcessSpec::new("process").level(level);
            executor.spawn(spec, move || async move {
                for round in 0..ALONE {
                    let mut count = mutex.lock().await.unwrap();
                    // Every other time the other process waits for it.
                    if round % 2 == 0 {
                        yield_now().await;
                    }
                    *count += 1;
                }
                says.send(()).unwrap();
                for _ in 0..TOGETHER {
                    let mut count = mutex.lock().await.unwrap();
                    yield_now().await;
                    *count += 1;
                }
            })
        })
        .collect();
    executor.release();
    hears.recv().unwrap();
    for _ in 0..TOGETHER {
        *mutex.blocking_lock().unwrap() += 1;
    }
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(*mutex.try_lock().unwrap(), 2 * ALONE + 3 * TOGETHER);
}

#[test]
fn it_is_handed_over_by_priority_then_by_arrival() {
    let _watchdog = Watchdog::new();
    const LEVELS: [u8; 6] = [3, 9, 3, 31, 9, 0];
    let mutex = Mutex::new(Vec::new());
    let executor = Executor::start(Attributes::new("one")).unwrap();
    let (notify, notified) = mpsc::channel();
    let mut gates = Vec::new();
    let mut processes = Vec::new();
    for (number, level) in LEVELS.into_iter().enumerate() {
        let (open, gate) = channel::<()>();
        gates.push(open);
        let mutex = mutex.clone();
        let spec = ProcessSpec::new(format!("{number}")).level(level);
        processes.push(executor.spawn(spec, move || async move {
            gate.recv().await.unwrap();
            mutex.lock().await.unwrap().push(number);
        }));
    }
    let of_director = mutex.clone();
    processes.push(
        executor.spawn(ProcessSpec::new("director").level(0), move || async move {
            let guard = of_director.lock().await.unwrap();
            for gate in gates {
                gate.send(()).await.unwrap();
                // The other one waits for the mutex then, and this one inherits its level; so that
                // this one alone runs, all the same.
                yield_now().await;
            }
            drop(guard);
            assert!(
                of_director.try_lock().is_err_and(|error| error.is_locked()),
                "it was handed over: nobody barges in"
            );
            notify.send(()).unwrap();
        }),
    );
    executor.release();
    notified.recv().unwrap();
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(*mutex.try_lock().unwrap(), [3, 1, 4, 0, 2, 5]);
}

#[test]
fn one_that_goes_away_has_not_locked_and_passes_on_what_it_was_handed() {
    let mutex = Mutex::new(());
    let guard = mutex.try_lock().unwrap();
    let mut gone = Box::pin(mutex.lock());
    pending(&mut gone);
    drop(gone);
    let (wakes, waker) = Wakes::new();
    let mut handed = Box::pin(mutex.lock());
    pending(&mut handed);
    let mut next = Box::pin(mutex.lock());
    assert!(poll_with(&mut next, &waker).is_pending());
    drop(guard);
    assert_eq!(wakes.count(), 0);
    drop(handed);
    assert_eq!(wakes.count(), 1);
    drop(ready(&mut next).unwrap());
    drop(next);
    assert!(mutex.try_lock().is_ok());
}

#[test]
fn a_wait_is_woken_by_the_one_that_polled_last() {
    let mutex = Mutex::new(());
    let guard = mutex.try_lock().unwrap();
    let ((before, first), (now, second)) = (Wakes::new(), Wakes::new());
    let mut lock = Box::pin(mutex.lock());
    assert!(poll_with(&mut lock, &first).is_pending());
    assert!(poll_with(&mut lock, &second).is_pending());
    drop(guard);
    assert_eq!((before.count(), now.count()), (0, 1));
}

#[test]
fn the_time_runs_out_or_it_is_locked() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(());
    luna_core::block_on(async {
        let guard = mutex.lock_timeout(SHORT).await.unwrap();
        assert!(mutex.lock_timeout(SHORT).await.unwrap_err().is_timeout());
        drop(guard);
        drop(mutex.lock_timeout(SHORT).await.unwrap());
    })
    .unwrap();
    let guard = mutex.blocking_lock().unwrap();
    let late = mutex.blocking_lock_timeout(SHORT);
    assert!(late.unwrap_err().is_timeout());
    drop(guard);
    assert!(mutex.blocking_lock_timeout(SHORT).is_ok());
}

#[test]
fn what_was_handed_over_at_the_deadline_is_locked() {
    let mutex = Mutex::new(());
    luna_core::block_on(async {
        let guard = mutex.lock().await.unwrap();
        // Time enough for two steps on a busy machine.
        let time = Duration::from_millis(100);
        let mut late = Box::pin(mutex.lock_timeout(time));
        pending(&mut late);
        // The deadline has come, and so has the mutex: it is not polled in between.
        std::thread::sleep(2 * time);
        drop(guard);
        assert!(late.await.is_ok());
    })
    .unwrap();
}

#[test]
fn a_blocking_lock_is_refused_on_an_executor() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(());
    let Exit::Panicked(why) = on_executor(move || async move {
        let _ = mutex.blocking_lock();
    }) else {
        panic!("it stops the executor");
    };
    assert!(why.contains("await the operation instead"), "{why}");
}

#[test]
fn tasks_of_other_runtimes_lock_too() {
    let mutex = Mutex::new(0);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .build()
        .unwrap();
    runtime.block_on(async {
        let tasks: Vec<_> = (0..8)
            .map(|_| {
                let mutex = mutex.clone();
                tokio::spawn(async move {
                    let mut guard = mutex.lock().await.unwrap();
                    let before = *guard;
                    tokio::task::yield_now().await;
                    *guard = before + 1;
                })
            })
            .collect();
        for task in tasks {
            task.await.unwrap();
        }
    });
    assert_eq!(*mutex.try_lock().unwrap(), 8);
}

/// It is marked, and once recovered it is not.
#[track_caller]
fn assert_died<T>(mutex: &Mutex<T>) {
    let Err(TryLockError::OwnerDied(died)) = mutex.try_lock() else {
        panic!("it is marked");
    };
    drop(died.into_guard());
    let Err(error @ LockError::OwnerDied(_)) = mutex.blocking_lock() else {
        panic!("it stays marked");
    };
    drop(error.recover().unwrap());
    assert!(mutex.try_lock().is_ok(), "it was recovered");
}

async fn hold_and_panic(mutex: Mutex<u8>) {
    let _guard = mutex.lock().await.unwrap();
    yield_now().await;
    panic!("on purpose");
}

#[test]
fn a_panic_marks_it_wherever_that_was() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(0);
    let theirs = mutex.clone();
    assert!(matches!(
        on_executor(move || hold_and_panic(theirs)),
        Exit::Panicked(_)
    ));
    assert_died(&mutex);
    let theirs = mutex.clone();
    assert!(matches!(
        on_thread(move || hold_and_panic(theirs)),
        Exit::Panicked(_)
    ));
    assert_died(&mutex);
    let theirs = mutex.clone();
    let thread = std::thread::spawn(move || {
        let _guard = theirs.blocking_lock().unwrap();
        panic!("on purpose");
    });
    thread.join().unwrap_err();
    assert_died(&mutex);
}

#[test]
fn a_panic_marks_what_a_future_beside_it_held() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(0);
    let theirs = mutex.clone();
    let exit = on_executor(move || async move {
        // Its guard is not on the stack that unwinds.
        let holder = async {
            let _guard = theirs.lock().await.unwrap();
            std::future::pending::<()>().await;
        };
        futures_lite::future::zip(holder, async { panic!("on purpose") }).await;
    });
    assert!(matches!(exit, Exit::Panicked(_)));
    assert_died(&mutex);
}

#[test]
fn one_that_waits_is_handed_it_and_learns_of_the_death() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(0).named("dying");
    let guard = mutex.try_lock().unwrap();
    let theirs = mutex.clone();
    let waiting =
        std::thread::spawn(move || theirs.blocking_lock().is_err_and(|e| e.is_owner_died()));
    until_waiting("dying", 1);
    let dies = std::panic::AssertUnwindSafe(move || {
        let _guard = guard;
        panic!("on purpose");
    });
    std::panic::catch_unwind(dies).unwrap_err();
    assert!(waiting.join().unwrap());
}

#[test]
fn a_cancelled_holder_marks_it() {
    let _watchdog = Watchdog::new();
    for is_thread in [false, true] {
        let mutex = Mutex::new(0);
        let (notify, notified) = mpsc::channel();
        let theirs = mutex.clone();
        let body = move || async move {
            let _guard = theirs.lock().await.unwrap();
            notify.send(()).unwrap();
            std::future::pending::<()>().await;
        };
        let spec = ProcessSpec::new("holder");
        if is_thread {
            let thread = OsThread::start(Attributes::new("test"), spec, body).unwrap();
            thread.release();
            notified.recv().unwrap();
            thread.process().cancel();
            assert_eq!(thread.process().wait(), Exit::Cancelled);
        } else {
            let executor = Executor::start(Attributes::new("test")).unwrap();
            let process = executor.spawn(spec, body);
            executor.release();
            notified.recv().unwrap();
            process.cancel();
            assert_eq!(process.wait(), Exit::Cancelled);
        }
        assert_died(&mutex);
    }
}

#[test]
fn a_cancelled_one_that_waits_marks_nothing() {
    let _watchdog = Watchdog::new();
    let mutex = Mutex::new(0);
    let guard = mutex.try_lock().unwrap();
    let theirs = mutex.clone();
    let executor = Executor::start(Attributes::new("test")).unwrap();
    let (notify, notified) = mpsc::channel();
    let process = executor.spawn(ProcessSpec::new("waits"), move || async move {
        notify.send(()).unwrap();
        let _ = theirs.lock().await;
    });
    executor.release();
    notified.recv().unwrap();
    process.cancel();
    assert_eq!(process.wait(), Exit::Cancelled);
    drop(guard);
    assert!(mutex.try_lock().is_ok());
}

#[test]
fn a_destructor_may_lock_while_a_panic_unwinds() {
    struct Locks(Mutex<u8>);
    impl Drop for Locks {
        fn drop(&mut self) {
            *self.0.try_lock().unwrap() += 1;
        }
    }
    let mutex = Mutex::new(0);
    let locks = Locks(mutex.clone());
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(move || {
        let _locks = locks;
        panic!("on purpose");
    }))
    .unwrap_err();
    assert_eq!(*mutex.try_lock().unwrap(), 1, "it has come to its end");
}

#[test]
fn a_guard_may_be_sent_away_and_is_unlocked_there() {
    let _watchdog = Watchdog::new();
    let mutex: &'static Mutex<u8> = Box::leak(Box::new(Mutex::new(0)));
    let (pass, passed) = channel::<MutexGuard<'static, u8>>();
    let thread = std::thread::spawn(move || *passed.blocking_recv().unwrap() += 1);
    let exit = on_executor(move || async move {
        pass.send(mutex.lock().await.unwrap()).await.unwrap();
    });
    assert_eq!(exit, Exit::Completed);
    thread.join().unwrap();
    assert_eq!(*mutex.try_lock().unwrap(), 1);
}

/// Processes of all placements take turns on two mutexes, with others that give up in between: no
/// waiter is lost, and a holder is always alone.
#[test]
fn mixed_places_under_stress() {
    let _watchdog = Watchdog::new();
    const ROUNDS: u32 = if cfg!(miri) { 20 } else { 2000 };
    let mutexes = [Mutex::new(0_u32), Mutex::new(0)];
    async fn work(mutexes: [Mutex<u32>; 2], seed: u32) {
        for round in 0..ROUNDS {
            let mutex = &mutexes[((round + seed) % 2) as usize];
            if round % 3 == seed % 3 {
                // May be handed the mutex just now.
                let mut gives_up = Box::pin(mutex.lock());
                let _ = futures_lite::future::poll_once(&mut gives_up).await;
            }
            let mut guard = mutex.lock().await.unwrap();
            let before = *guard;
            if round % 5 == 0 {
                yield_now().await;
            }
            *guard = before + 1;
        }
    }
    let executors = ["a", "b"].map(|name| Executor::start(Attributes::new(name)).unwrap());
    let mut processes = Vec::new();
    for seed in 0..6 {
        let mutexes = mutexes.clone();
        let spec = ProcessSpec::new("process").level(seed as u8 * 5);
        processes.push(executors[seed as usize % 2].spawn(spec, move || work(mutexes, seed)));
    }
    let of_thread = mutexes.clone();
    let thread = OsThread::start(
        Attributes::new("thread"),
        ProcessSpec::new("thread"),
        move || work(of_thread, 6),
    )
    .unwrap();
    let plain = mutexes.clone();
    let plain = std::thread::spawn(move || {
        for round in 0..ROUNDS {
            let mutex = &plain[round as usize % 2];
            if round % 4 == 0 {
                drop(mutex.blocking_lock_timeout(Duration::ZERO));
            }
            *mutex.blocking_lock().unwrap() += 1;
        }
    });
    thread.release();
    executors.iter().for_each(Executor::release);
    for process in &processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(thread.process().wait(), Exit::Completed);
    plain.join().unwrap();
    let total: u32 = mutexes.iter().map(|mutex| *mutex.try_lock().unwrap()).sum();
    assert_eq!(total, 8 * ROUNDS);
}

//! The condition variable: nothing lost, no spurious wake, by priority; and the semaphore's
//! permits.

#![cfg(not(loom))]

use crate::common;
use common::{Wakes, Watchdog, pending, poll, poll_with, ready};
use luna_channels::lock_sync::{Condvar, LockError, Mutex};
use luna_channels::{after, channel};
use luna_core::{Executor, Exit, OsThread, ProcessSpec, yield_now};
use luna_platform::thread::Attributes;
use std::time::Duration;

const SHORT: Duration = Duration::from_millis(2);
/// Time enough for a few steps on a busy machine.
const ENOUGH: Duration = Duration::from_millis(100);

#[test]
fn waiting_unlocks_and_locks_again() {
    let (mutex, condition) = (Mutex::new(0), Condvar::new());
    let mut wait = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    assert!(
        mutex.try_lock().is_err(),
        "nothing happens before it is polled"
    );
    pending(&mut wait);
    *mutex.try_lock().unwrap() = 1;
    pending(&mut wait);
    condition.notify_one();
    assert!(
        mutex.try_lock().is_err(),
        "it holds the mutex before it is polled"
    );
    let guard = ready(&mut wait).unwrap();
    assert_eq!(*guard, 1);
}

#[test]
fn one_that_is_notified_is_woken_once_when_it_can_go_on() {
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    let (wakes, waker) = Wakes::new();
    let mut wait = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    assert!(poll_with(&mut wait, &waker).is_pending());
    let guard = mutex.try_lock().unwrap();
    condition.notify_one();
    assert_eq!(wakes.count(), 0, "the mutex is locked");
    assert!(poll_with(&mut wait, &waker).is_pending());
    drop(guard);
    assert_eq!(wakes.count(), 1);
    drop(ready(&mut wait).unwrap());
}

#[test]
fn nobody_to_notify_is_nothing() {
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    condition.notify_one();
    condition.notify_all();
    let mut wait = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    pending(&mut wait);
    pending(&mut wait);
}

#[test]
fn all_are_those_that_wait_now() {
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    let mut first = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    pending(&mut first);
    let mut second = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    pending(&mut second);
    condition.notify_all();
    // The first holds the mutex now, and waits again with it.
    let guard = ready(&mut first).unwrap();
    let mut again = Box::pin(condition.wait(guard));
    pending(&mut again);
    drop(ready(&mut second).unwrap());
    pending(&mut again);
}

#[test]
fn one_that_goes_passes_on_what_was_for_it_alone() {
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    for hold in [false, true] {
        let mut goes = Box::pin(condition.wait(mutex.try_lock().unwrap()));
        pending(&mut goes);
        let mut stays = Box::pin(condition.wait(mutex.try_lock().unwrap()));
        pending(&mut stays);
        // It is notified as it waits for the mutex, or holds it.
        let guard = hold.then(|| mutex.try_lock().unwrap());
        condition.notify_one();
        drop(goes);
        drop(guard);
        drop(ready(&mut stays).unwrap());
    }
    // One that was notified with all others has nothing to pass on to one that came later.
    let mut goes = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    pending(&mut goes);
    let guard = mutex.try_lock().unwrap();
    condition.notify_all();
    let mut late = Box::pin(condition.wait(guard));
    pending(&mut late);
    drop(goes);
    pending(&mut late);
    assert!(mutex.try_lock().is_ok());
}

#[test]
fn those_of_several_mutexes_may_wait_at_one_condition() {
    let condition = Condvar::new();
    let mutexes = [Mutex::new(1), Mutex::new(2)];
    let mut waits = mutexes
        .each_ref()
        .map(|mutex| Box::pin(condition.wait(mutex.try_lock().unwrap())));
    waits.iter_mut().for_each(pending);
    condition.notify_all();
    let values = waits.each_mut().map(|wait| *ready(wait).unwrap());
    assert_eq!(values, [1, 2]);
}

#[test]
fn the_time_runs_out_and_the_mutex_is_locked_all_the_same() {
    let _watchdog = Watchdog::new();
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    luna_core::block_on(async {
        let guard = mutex.lock().await.unwrap();
        let (guard, result) = condition.wait_timeout(guard, SHORT).await.unwrap();
        assert!(result.timed_out());
        assert!(mutex.try_lock().is_err());
        let mut wait = Box::pin(condition.wait_timeout(guard, ENOUGH));
        assert!(poll(&mut wait).is_pending());
        let guard = mutex.try_lock().unwrap();
        condition.notify_one();
        // It was notified before its time ran out, and waits for the mutex alone.
        after(2 * ENOUGH).await;
        assert!(poll(&mut wait).is_pending());
        drop(guard);
        let (guard, result) = wait.await.unwrap();
        assert!(!result.timed_out());
        // A notification after the deadline reaches no waiter.
        let mut late = Box::pin(condition.wait_timeout(guard, ENOUGH));
        assert!(poll(&mut late).is_pending());
        let guard = mutex.try_lock().unwrap();
        after(2 * ENOUGH).await;
        assert!(poll(&mut late).is_pending());
        condition.notify_one();
        drop(guard);
        assert!(late.await.unwrap().1.timed_out());
    })
    .unwrap();
}

#[test]
fn threads_wait_too() {
    let _watchdog = Watchdog::new();
    let (mutex, condition) = (Mutex::new(false), Condvar::new());
    let guard = mutex.blocking_lock().unwrap();
    let (guard, result) = condition.blocking_wait_timeout(guard, SHORT).unwrap();
    assert!(result.timed_out());
    let (theirs, notifies) = (mutex.clone(), condition.clone());
    let thread = std::thread::spawn(move || {
        *theirs.blocking_lock().unwrap() = true;
        notifies.notify_one();
    });
    let guard = condition.blocking_wait(guard).unwrap();
    assert!(*guard);
    let result = condition.blocking_wait_timeout(guard, Duration::ZERO);
    assert!(result.unwrap().1.timed_out());
    thread.join().unwrap();
}

#[test]
fn one_that_waits_learns_that_the_holder_died() {
    let (mutex, condition) = (Mutex::new(()), Condvar::new());
    let mut wait = Box::pin(condition.wait(mutex.try_lock().unwrap()));
    pending(&mut wait);
    std::panic::catch_unwind(|| {
        let _guard = mutex.try_lock().unwrap();
        condition.notify_one();
        panic!("on purpose");
    })
    .unwrap_err();
    assert!(matches!(ready(&mut wait), Err(LockError::OwnerDied(_))));
}

#[test]
fn the_most_urgent_is_notified_first() {
    let _watchdog = Watchdog::new();
    const LEVELS: [u8; 5] = [3, 9, 31, 3, 0];
    let (order, condition) = (Mutex::new(Vec::new()), Condvar::new());
    let executor = Executor::start(Attributes::new("one")).unwrap();
    let mut processes = Vec::new();
    let mut gates = Vec::new();
    for (number, level) in LEVELS.into_iter().enumerate() {
        let (order, condition) = (order.clone(), condition.clone());
        let (open, gate) = channel::<()>();
        gates.push(open);
        let spec = ProcessSpec::new(format!("{number}")).level(level);
        processes.push(executor.spawn(spec, move || async move {
            gate.recv().await.unwrap();
            let guard = order.lock().await.unwrap();
            condition.wait(guard).await.unwrap().push(number);
        }));
    }
    let (all, notifies) = (order.clone(), condition.clone());
    processes.push(
        executor.spawn(ProcessSpec::new("director").level(0), move || async move {
            for gate in gates {
                gate.send(()).await.unwrap();
                yield_now().await;
            }
            let guard = all.lock().await.unwrap();
            notifies.notify_one();
            notifies.notify_all();
            drop(guard);
        }),
    );
    executor.release();
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(*order.try_lock().unwrap(), [2, 1, 0, 3, 4]);
}

/// A queue with a capacity, as of the textbook: makers and takers in all places, some of which give
/// up in between.
#[test]
fn a_bounded_queue_loses_and_doubles_nothing() {
    let _watchdog = Watchdog::new();
    const EACH: usize = if cfg!(miri) { 10 } else { 1000 };
    const MAKERS: usize = 3;
    #[derive(Clone)]
    struct Queue {
        values: Mutex<Vec<usize>>,
        has_room: Condvar,
        has_some: Condvar,
    }
    impl Queue {
        async fn put(&self, value: usize) {
            let guard = self.values.lock().await.unwrap();
            let full = |values: &mut Vec<usize>| values.len() >= 2;
            self.has_room
                .wait_while(guard, full)
                .await
                .unwrap()
                .push(value);
            self.has_some.notify_one();
        }
        async fn take(&self) -> usize {
            let guard = self.values.lock().await.unwrap();
            let empty = |values: &mut Vec<usize>| values.is_empty();
            let value = self
                .has_some
                .wait_while(guard, empty)
                .await
                .unwrap()
                .remove(0);
            self.has_room.notify_one();
            value
        }
    }
    let queue = Queue {
        values: Mutex::new(Vec::with_capacity(2)),
        has_room: Condvar::new(),
        has_some: Condvar::new(),
    };
    let executors = ["a", "b"].map(|name| Executor::start(Attributes::new(name)).unwrap());
    let mut processes = Vec::new();
    for maker in 0..MAKERS {
        let queue = queue.clone();
        let spec = ProcessSpec::new("maker").level(10 + maker as u8);
        processes.push(executors[maker % 2].spawn(spec, move || async move {
            for n in 0..EACH {
                queue.put(maker * EACH + n).await;
            }
        }));
    }
    let taken = Mutex::new(vec![0_u8; MAKERS * EACH]);
    for level in [5, 20] {
        let (queue, taken) = (queue.clone(), taken.clone());
        let spec = ProcessSpec::new("taker").level(level);
        processes.push(
            executors[usize::from(level == 5)].spawn(spec, move || async move {
                for _ in 0..EACH {
                    // One that gives up while it waits, though it may be notified just then.
                    let mut gives_up = Box::pin(async {
                        let guard = queue.values.lock().await.unwrap();
                        drop(queue.has_some.wait(guard).await.unwrap());
                    });
                    let _ = futures_lite::future::poll_once(&mut gives_up).await;
                    drop(gives_up);
                    let value = queue.take().await;
                    taken.lock().await.unwrap()[value] += 1;
                }
            }),
        );
    }
    let (of_thread, all) = (queue.clone(), taken.clone());
    let thread = OsThread::start(
        Attributes::new("thread"),
        ProcessSpec::new("taker"),
        move || async move {
            for _ in 0..EACH {
                let value = of_thread.take().await;
                all.lock().await.unwrap()[value] += 1;
            }
        },
    )
    .unwrap();
    thread.release();
    executors.iter().for_each(Executor::release);
    for process in &processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(thread.process().wait(), Exit::Completed);
    assert!(taken.try_lock().unwrap().iter().all(|&times| times == 1));
}

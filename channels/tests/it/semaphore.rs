//! The semaphore: as many at a time as there are permits, by priority, and none lost.

#![cfg(not(loom))]

use crate::common;
use common::{Watchdog, pending, ready, until_waiting};
use luna_channels::channel;
use luna_channels::lock_sync::{Mutex, Semaphore};
use luna_core::{Executor, Exit, OsThread, ProcessSpec, yield_now};
use luna_platform::thread::Attributes;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

const SHORT: Duration = Duration::from_millis(2);

#[test]
fn permits_are_taken_and_given_back() {
    let semaphore = Semaphore::new(3);
    let two = semaphore.try_acquire_many(2).unwrap();
    assert_eq!((two.num_permits(), semaphore.available_permits()), (2, 1));
    assert!(semaphore.try_acquire_many(2).is_none());
    let one = semaphore.clone().try_acquire().map(|one| one.num_permits());
    assert_eq!(one, Some(1), "given back at once");
    two.forget();
    assert_eq!(semaphore.available_permits(), 1);
    semaphore.add_permits(4);
    assert_eq!(semaphore.available_permits(), 5);
}

#[test]
fn one_that_wants_much_is_not_starved_and_the_one_that_goes_lets_others_by() {
    let semaphore = Semaphore::new(1);
    let mut much = Box::pin(semaphore.acquire_many(3));
    pending(&mut much);
    let mut little = Box::pin(semaphore.acquire());
    pending(&mut little);
    assert!(
        semaphore.try_acquire().is_none(),
        "an equally urgent process waits"
    );
    semaphore.add_permits(1);
    pending(&mut little);
    drop(much);
    drop(ready(&mut little).unwrap());
    assert_eq!(semaphore.available_permits(), 2);
}

#[test]
fn one_that_wants_none_passes_behind_one_that_takes_the_last() {
    let semaphore = Semaphore::new(0);
    let mut last = Box::pin(semaphore.acquire());
    pending(&mut last);
    let mut none = Box::pin(semaphore.acquire_many(0));
    pending(&mut none);
    semaphore.add_permits(1);
    ready(&mut last).unwrap().forget();
    assert_eq!(ready(&mut none).unwrap().num_permits(), 0);
}

#[test]
fn what_was_given_to_one_that_goes_is_there_again() {
    let semaphore = Semaphore::new(0);
    let mut goes = Box::pin(semaphore.acquire_many(2));
    pending(&mut goes);
    let mut stays = Box::pin(semaphore.acquire());
    pending(&mut stays);
    semaphore.add_permits(2);
    drop(goes);
    ready(&mut stays).unwrap().forget();
    assert_eq!(semaphore.available_permits(), 1);
}

#[test]
fn the_time_runs_out_or_it_is_acquired() {
    let _watchdog = Watchdog::new();
    let semaphore = Semaphore::new(1);
    luna_core::block_on(async {
        let permit = semaphore.acquire_timeout(SHORT).await.unwrap();
        let late = semaphore.acquire_timeout(SHORT).await;
        assert!(late.unwrap_err().is_timeout());
        drop(permit);
    })
    .unwrap();
    let permit = semaphore.blocking_acquire().unwrap();
    assert!(semaphore.blocking_acquire_timeout(SHORT).is_err());
    drop(permit);
    assert_eq!(semaphore.available_permits(), 1);
}

#[test]
fn the_most_urgent_is_served_first_and_may_pass_those_below() {
    let _watchdog = Watchdog::new();
    const LEVELS: [u8; 5] = [3, 9, 31, 3, 0];
    let (order, semaphore) = (Mutex::new(Vec::new()), Semaphore::new(0));
    let executor = Executor::start(Attributes::new("one")).unwrap();
    let (mut processes, mut gates) = (Vec::new(), Vec::new());
    for (number, level) in LEVELS.into_iter().enumerate() {
        let (order, semaphore) = (order.clone(), semaphore.clone());
        let (open, gate) = channel::<()>();
        gates.push(open);
        let spec = ProcessSpec::new(format!("{number}")).level(level);
        processes.push(executor.spawn(spec, move || async move {
            gate.recv().await.unwrap();
            semaphore.acquire().await.unwrap().forget();
            order.try_lock().unwrap().push(number);
        }));
    }
    let adds = semaphore.clone();
    processes.push(
        executor.spawn(ProcessSpec::new("director").level(0), move || async move {
            for gate in gates {
                gate.send(()).await.unwrap();
                yield_now().await;
            }
            for _ in LEVELS {
                adds.add_permits(1);
                yield_now().await;
            }
        }),
    );
    executor.release();
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(*order.try_lock().unwrap(), [2, 1, 0, 3, 4]);

    // The highest is not starved from below: two permits are wanted, one is there, and one of lower
    // level waits for it.
    let semaphore = Semaphore::new(1).named("much");
    let executor = Executor::start(Attributes::new("one")).unwrap();
    let wants = semaphore.clone();
    let low = executor.spawn(ProcessSpec::new("low").level(1), move || async move {
        wants.acquire_many(2).await.unwrap().forget();
    });
    let comes = semaphore.clone();
    executor.release();
    until_waiting("much", 1);
    let high = executor.spawn(ProcessSpec::new("high").level(30), move || async move {
        comes.try_acquire().unwrap().forget();
    });
    assert_eq!(high.wait(), Exit::Completed);
    semaphore.add_permits(2);
    assert_eq!(low.wait(), Exit::Completed);
}

#[test]
fn as_many_at_a_time_in_mixed_places() {
    let _watchdog = Watchdog::new();
    const ROUNDS: usize = if cfg!(miri) { 20 } else { 2000 };
    const PERMITS: u32 = 3;
    async fn work(semaphore: Semaphore, inside: Arc<AtomicUsize>, seed: usize) {
        for round in 0..ROUNDS {
            let mut gives_up = Box::pin(semaphore.acquire_many(2));
            let _ = futures_lite::future::poll_once(&mut gives_up).await;
            drop(gives_up);
            let count = 1 + ((round + seed) % 3) as u32;
            let permit = semaphore.acquire_many(count).await.unwrap();
            let before = inside.fetch_add(count as usize, Ordering::SeqCst);
            assert!(before + count as usize <= PERMITS as usize);
            if round % 5 == 0 {
                yield_now().await;
            }
            inside.fetch_sub(count as usize, Ordering::SeqCst);
            drop(permit);
        }
    }
    let (semaphore, inside) = (Semaphore::new(PERMITS), Arc::new(AtomicUsize::new(0)));
    let executors = ["a", "b"].map(|name| Executor::start(Attributes::new(name)).unwrap());
    let mut processes = Vec::new();
    for seed in 0..4 {
        let (semaphore, inside) = (semaphore.clone(), inside.clone());
        let spec = ProcessSpec::new("process").level(seed as u8 * 7);
        processes.push(executors[seed % 2].spawn(spec, move || work(semaphore, inside, seed)));
    }
    let (of_thread, theirs) = (semaphore.clone(), inside.clone());
    let thread = OsThread::start(
        Attributes::new("thread"),
        ProcessSpec::new("thread"),
        move || work(of_thread, theirs, 4),
    )
    .unwrap();
    thread.release();
    executors.iter().for_each(Executor::release);
    for _ in 0..ROUNDS {
        let _permit = semaphore.blocking_acquire().unwrap();
        assert!(inside.fetch_add(1, Ordering::SeqCst) < PERMITS as usize);
        inside.fetch_sub(1, Ordering::SeqCst);
    }
    for process in &processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(thread.process().wait(), Exit::Completed);
    assert_eq!(semaphore.available_permits(), u64::from(PERMITS));
}

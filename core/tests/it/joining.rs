//! Waiting for the end of processes: from processes, from threads, by many at once.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Exit, ProcessSpec, ProcessState, block_on};
use std::future::pending;
use std::pin::pin;
use std::sync::Arc;
use support::{Gate, Log, executor, poll_once, until, watchdog};

#[test]
fn a_process_joins_one_of_its_own_and_of_another_executor() {
    let _watchdog = watchdog();
    let (one, two) = (executor(), executor());
    for executor_one in [&one, &two] {
        let gate = Gate::default();
        let own = gate.clone();
        let joined = executor_one.spawn(ProcessSpec::new("joined"), move || async move {
            own.pass().await
        });
        let handle = joined.clone();
        let joiner = one.spawn(ProcessSpec::new("joiner"), move || async move {
            assert_eq!(handle.join().await, Exit::Completed);
            // One that has ended is joined at once, as often as wanted.
            assert_eq!(handle.join().await, Exit::Completed);
        });
        one.release();
        two.release();
        until(|| joiner.state() == ProcessState::Waiting);
        gate.open();
        assert_eq!((joiner.wait(), joiner.polls()), (Exit::Completed, 2));
    }
}

#[test]
fn joiners_are_readied_most_urgent_first() {
    let _watchdog = watchdog();
    let executor = executor();
    let (gate, log) = (Gate::default(), Log::new());
    let own = gate.clone();
    let joined = executor.spawn(ProcessSpec::new("joined").level(31), move || async move {
        own.pass().await
    });
    let joiners: Vec<_> = [4, 9, 4, 20, 9]
        .into_iter()
        .enumerate()
        .map(|(n, level)| {
            let (joined, log) = (joined.clone(), log.clone());
            executor.spawn(
                ProcessSpec::new("joiner").level(level),
                move || async move {
                    joined.join().await;
                    log.add((level, n));
                },
            )
        })
        .collect();
    executor.release();
    until(|| {
        joiners
            .iter()
            .all(|joiner| joiner.state() == ProcessState::Waiting)
    });
    gate.open();
    joiners.iter().for_each(|joiner| drop(joiner.wait()));
    // Within a level in the order in which they began to wait.
    assert_eq!(log.take(), [(20, 3), (9, 1), (9, 4), (4, 0), (4, 2)]);
}

#[test]
fn threads_and_processes_join_one_process_in_numbers() {
    let _watchdog = watchdog();
    let executor = executor();
    let gate = Gate::default();
    let own = gate.clone();
    let joined = executor.spawn(ProcessSpec::new("joined"), move || async move {
        own.pass().await
    });
    let processes: Vec<_> = (0..100)
        .map(|n| {
            let joined = joined.clone();
            executor.spawn(
                ProcessSpec::new("joiner").level(n % 32),
                move || async move {
                    assert_eq!(joined.join().await, Exit::Completed);
                },
            )
        })
        .collect();
    let threads: Vec<_> = (0..8)
        .map(|_| {
            let joined = joined.clone();
            std::thread::spawn(move || joined.wait())
        })
        .collect();
    executor.release();
    until(|| {
        processes
            .iter()
            .all(|process| process.state() == ProcessState::Waiting)
    });
    gate.open();
    assert!(
        processes
            .iter()
            .all(|process| process.wait() == Exit::Completed)
    );
    assert!(
        threads
            .into_iter()
            .all(|thread| thread.join().unwrap() == Exit::Completed)
    );
}

#[test]
fn a_join_that_is_dropped_is_withdrawn() {
    let _watchdog = watchdog();
    let executor = executor();
    let gate = Gate::default();
    let own = gate.clone();
    let joined = executor.spawn(ProcessSpec::new("joined"), move || async move {
        own.pass().await
    });
    let (handle, open) = (joined.clone(), gate.clone());
    let joiner = executor.spawn(ProcessSpec::new("joiner"), move || async move {
        let mut first = pin!(handle.join());
        assert!(poll_once(&mut first).await.is_none());
        {
            let mut dropped = pin!(handle.join());
            assert!(poll_once(&mut dropped).await.is_none());
            assert!(
                poll_once(&mut dropped).await.is_none(),
                "a second poll changes nothing"
            );
        }
        open.open();
        assert_eq!(first.await, Exit::Completed);
    });
    executor.release();
    assert_eq!(
        (joiner.wait(), joined.wait()),
        (Exit::Completed, Exit::Completed)
    );
}

#[test]
fn a_join_that_moved_to_another_thread_wakes_that_one() {
    let _watchdog = watchdog();
    let executor = executor();
    let gate = Gate::default();
    let own = gate.clone();
    let joined = Arc::new(
        executor.spawn(ProcessSpec::new("joined"), move || async move {
            own.pass().await
        }),
    );
    executor.release();
    std::thread::scope(|scope| {
        let mut join = Box::pin(joined.join());
        assert_eq!(block_on(poll_once(&mut join)), Ok(None));
        let thread = scope.spawn(move || block_on(join));
        gate.open();
        assert_eq!(thread.join().unwrap(), Ok(Exit::Completed));
    });
}

#[test]
fn every_end_is_told_to_joiners() {
    let _watchdog = watchdog();
    support::quiet_panics();
    let (executor, other) = (executor(), executor());
    let panics = executor.spawn(ProcessSpec::new("panics"), || async {
        panic!("on purpose")
    });
    let cancelled = executor.spawn(ProcessSpec::new("cancelled"), || async { pending().await });
    let stopped = executor.spawn(ProcessSpec::new("stopped"), || async { pending().await });
    let handles = [panics.clone(), cancelled.clone(), stopped.clone()];
    let exits = Log::new();
    let own = exits.clone();
    let joiner = other.spawn(ProcessSpec::new("joiner"), move || async move {
        for handle in handles {
            own.add(handle.join().await);
        }
    });
    other.release();
    executor.release();
    until(|| exits.len() == 1);
    cancelled.cancel();
    until(|| exits.len() == 2);
    executor.stop();
    joiner.wait();
    assert_eq!(
        exits.take(),
        [
            Exit::Panicked("on purpose".into()),
            Exit::Cancelled,
            Exit::Cancelled
        ]
    );
}

//! Which process runs next: the highest level, and within a level the first that came.

#![cfg(not(loom))]

use crate::support;
use luna_core::current::{self, QueueEnd};
use luna_core::{ProcessSpec, yield_now};
use std::task::Poll;
use support::{Gate, Log, executor, watchdog};

#[test]
fn smoke() {
    let _watchdog = watchdog();
    let executor = executor();
    let log = Log::new();
    let own = log.clone();
    let process = executor.spawn(ProcessSpec::new("one"), || async move { own.add(1) });
    executor.release();
    process.wait();
    assert_eq!(log.take(), [1]);
}

#[test]
fn all_levels_run_highest_first() {
    let _watchdog = watchdog();
    let executor = executor();
    let log = Log::new();
    // Each level twice, in an order that is neither up nor down.
    let processes: Vec<_> = (0..64)
        .map(|n| {
            let (level, log) = ((n * 7 % 32) as u8, log.clone());
            executor.spawn(ProcessSpec::new("p").level(level), move || async move {
                log.add((level, n))
            })
        })
        .collect();
    executor.settle();
    executor.release();
    processes.iter().for_each(|process| drop(process.wait()));
    let mut expected: Vec<(u8, usize)> = (0..64).map(|n| ((n * 7 % 32) as u8, n)).collect();
    // Stable: within a level in the order of their arrival.
    expected.sort_by_key(|&(level, _)| std::cmp::Reverse(level));
    assert_eq!(log.take(), expected);
}

#[test]
fn a_level_above_the_last_counts_as_the_last() {
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("p").level(200), || async {});
    assert_eq!(process.priority(), 31);
    assert_eq!(
        executor
            .spawn(ProcessSpec::new("q"), || async {})
            .priority(),
        ProcessSpec::DEFAULT_LEVEL
    );
}

#[test]
fn yielding_takes_turns_within_a_level_only() {
    let _watchdog = watchdog();
    let executor = executor();
    let log = Log::new();
    let processes: Vec<_> = [("low", 1), ("a", 5), ("b", 5), ("c", 5), ("high", 9)]
        .into_iter()
        .map(|(name, level)| {
            let log = log.clone();
            executor.spawn(ProcessSpec::new(name).level(level), move || async move {
                for _ in 0..2 {
                    log.add(name);
                    yield_now().await;
                }
                log.add(name);
            })
        })
        .collect();
    executor.settle();
    executor.release();
    processes.iter().for_each(|process| drop(process.wait()));
    let golden = "high high high a b c a b c a b c low low low";
    assert_eq!(log.take().join(" "), golden);
    assert!(processes.iter().all(|process| process.polls() == 3));
}

#[test]
fn one_that_gives_way_to_higher_ones_keeps_its_place() {
    let _watchdog = watchdog();
    let executor = executor();
    let log = Log::new();
    let gate = Gate::default();
    let (to_high, of_high) = (gate.clone(), log.clone());
    let high = executor.spawn(ProcessSpec::new("high").level(20), move || async move {
        of_high.add("high waits");
        to_high.pass().await;
        of_high.add("high");
    });
    let mut others = Vec::new();
    for name in ["a", "b"] {
        let (log, gate) = (log.clone(), gate.clone());
        others.push(
            executor.spawn(ProcessSpec::new(name).level(10), move || async move {
                log.add(name);
                if name == "a" {
                    gate.open();
                    log.add("a goes on after the wake");
                    // What a communication does that made a more urgent process ready.
                    assert!(current::is_outranked());
                    let mut once = true;
                    std::future::poll_fn(|cx| {
                        if std::mem::take(&mut once) {
                            current::ready_again(cx, QueueEnd::Front);
                            return Poll::Pending;
                        }
                        Poll::Ready(())
                    })
                    .await;
                    assert!(!current::is_outranked());
                }
                log.add(name);
            }),
        );
    }
    executor.settle();
    executor.release();
    others.iter().for_each(|process| drop(process.wait()));
    high.wait();
    assert_eq!(
        log.take(),
        [
            "high waits",
            "a",
            "a goes on after the wake",
            "high",
            "a",
            "b",
            "b"
        ]
    );
}

#[test]
fn a_process_woken_by_its_equal_comes_behind_those_that_are_ready() {
    let _watchdog = watchdog();
    let executor = executor();
    let log = Log::new();
    let gate = Gate::default();
    let mut processes = Vec::new();
    for name in ["waiter", "opener", "third"] {
        let (log, gate) = (log.clone(), gate.clone());
        processes.push(executor.spawn(ProcessSpec::new(name), move || async move {
            match name {
                "waiter" => gate.pass().await,
                "opener" => gate.open(),
                _ => {}
            }
            log.add(name);
            yield_now().await;
            log.add(name);
        }));
    }
    executor.settle();
    executor.release();
    processes.iter().for_each(|process| drop(process.wait()));
    assert_eq!(
        log.take(),
        ["opener", "third", "waiter", "opener", "third", "waiter"]
    );
}

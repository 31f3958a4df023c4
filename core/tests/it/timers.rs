//! Deadlines of the processes of an executor.

#![cfg(not(loom))]

use crate::support;
use luna_core::timer_queue::Sleep;
use luna_core::{Exit, ProcessSpec, yield_now};
use luna_platform::clock::Instant;
use std::pin::pin;
use std::time::Duration;
use support::{Gate, Log, Random, executor, poll_once, rounds, until, watchdog};

fn in_micros(micros: u64) -> Instant {
    Instant::now() + Duration::from_micros(micros)
}

/// Starts processes at `levels` that sleep until so many microseconds after a start time, and
/// returns their numbers in the order of their wakes.
fn order_of(sleepers: &[(u8, u64)]) -> Vec<usize> {
    loop {
        let (executor, log) = (executor(), Log::new());
        let base = in_micros(5_000);
        let processes: Vec<_> = sleepers
            .iter()
            .enumerate()
            .map(|(n, &(level, micros))| {
                let (log, deadline) = (log.clone(), base + Duration::from_micros(micros));
                executor.spawn(
                    ProcessSpec::new("sleeps").level(level),
                    move || async move {
                        Sleep::until(deadline).await;
                        assert!(Instant::now() >= deadline);
                        log.add(n);
                    },
                )
            })
            .collect();
        let busy = executor.spawn(ProcessSpec::new("busy").level(1), move || async move {
            // All deadlines pass while this one computes.
            until(|| Instant::now() > base + Duration::from_millis(1));
        });
        executor.settle();
        executor.release();
        busy.wait();
        assert!(
            processes
                .iter()
                .all(|process| process.wait() == Exit::Completed)
        );
        // On a slow machine one may have come too late to wait at all: then once more.
        if processes.iter().all(|process| process.polls() == 2) {
            return log.take();
        }
    }
}

#[test]
fn never_early_and_in_the_order_of_the_deadlines() {
    let _watchdog = watchdog();
    assert_eq!(
        order_of(&[(5, 700), (5, 300), (5, 900), (5, 100), (5, 500)]),
        [3, 1, 4, 0, 2]
    );
}

#[test]
fn deadlines_that_come_together_run_by_level() {
    let _watchdog = watchdog();
    // The lower the level the earlier the deadline.
    assert_eq!(order_of(&[(2, 1), (30, 500), (11, 100)]), [1, 2, 0]);
}

#[test]
fn thousands_of_sleeps() {
    let _watchdog = watchdog();
    let (executor, log) = (executor(), Log::new());
    let mut random = Random::seeded();
    let (base, count) = (in_micros(1_000), rounds(5_000));
    let processes: Vec<_> = (0..count)
        .map(|_| {
            let (deadline, log) = (
                base + Duration::from_micros(random.below(50_000)),
                log.clone(),
            );
            let give_up = random.below(4) == 0;
            executor.spawn(ProcessSpec::new("sleeps"), move || async move {
                if give_up {
                    // Withdrawn, from anywhere in the heap.
                    let mut sleep = pin!(Sleep::until(deadline));
                    poll_once(&mut sleep).await;
                } else {
                    Sleep::until(deadline).await;
                    assert!(Instant::now() >= deadline);
                }
                log.add(give_up);
            })
        })
        .collect();
    executor.release();
    assert!(
        processes
            .iter()
            .all(|process| process.wait() == Exit::Completed)
    );
    assert_eq!(log.take().len(), count);
}

#[test]
fn a_deadline_in_the_past_does_not_wait() {
    let _watchdog = watchdog();
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("late"), || async {
        Sleep::until(Instant::from_nanos(0)).await;
        Sleep::until(Instant::now()).await;
    });
    executor.release();
    assert_eq!((process.wait(), process.polls()), (Exit::Completed, 1));
}

#[test]
fn a_deadline_comes_to_a_busy_executor() {
    let _watchdog = watchdog();
    let executor = executor();
    let sleeper = executor.spawn(ProcessSpec::new("sleeps").level(2), || {
        Sleep::until(in_micros(2_000))
    });
    let busy = executor.spawn(ProcessSpec::new("busy").level(1), || async {
        loop {
            yield_now().await;
        }
    });
    executor.release();
    assert_eq!((sleeper.wait(), busy.exit()), (Exit::Completed, None));
    assert!(sleeper.polls() <= 2);
}

#[test]
fn an_earlier_deadline_and_a_wake_shorten_a_sleep() {
    let _watchdog = watchdog();
    let (executor, gate, log) = (executor(), Gate::default(), Log::new());
    let far = Instant::now() + Duration::from_secs(10_000);
    let long = executor.spawn(ProcessSpec::new("long"), move || Sleep::until(far));
    let (wait, own) = (gate.clone(), log.clone());
    let woken = executor.spawn(ProcessSpec::new("woken"), move || async move {
        wait.pass().await;
        let early = in_micros(500);
        Sleep::until(early).await;
        own.add(Instant::now() >= early);
    });
    executor.release();
    until(|| gate.waiting() == 1);
    gate.open();
    woken.wait();
    assert_eq!((log.take(), long.exit()), (vec![true], None));
}

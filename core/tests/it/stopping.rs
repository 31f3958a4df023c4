//! The end of an executor: stopped, dropped, asked to stop, abandoned; held, idle, busy.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Exit, ProcessSpec, yield_now};
use std::future::pending;
use support::{Drops, Gate, executor, until, watchdog};

#[test]
fn dropped_while_held_nothing_ever_ran() {
    let _watchdog = watchdog();
    let (executor, drops) = (executor(), Drops::default());
    let token = drops.token();
    let process = executor.spawn(ProcessSpec::new("held"), move || async move { drop(token) });
    drop(executor);
    assert_eq!(
        (process.wait(), process.polls(), drops.count()),
        (Exit::Cancelled, 0, 1)
    );
}

#[test]
fn stopped_while_busy() {
    let _watchdog = watchdog();
    let (executor, drops) = (executor(), Drops::default());
    let processes: Vec<_> = (0..10)
        .map(|level| {
            let token = drops.token();
            executor.spawn(ProcessSpec::new("busy").level(level), move || async move {
                let _token = token;
                loop {
                    yield_now().await;
                }
            })
        })
        .collect();
    executor.settle();
    executor.release();
    until(|| processes[9].polls() > 100);
    executor.stop();
    assert!(
        processes
            .iter()
            .all(|process| process.wait() == Exit::Cancelled)
    );
    assert_eq!(drops.count(), 10);
    assert!(
        processes[..9].iter().all(|process| process.polls() == 0),
        "the highest always has the processor"
    );
}

#[test]
fn asked_to_stop_it_ends_by_itself() {
    let _watchdog = watchdog();
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("waits"), || async { pending().await });
    executor.release();
    assert!(!executor.has_stopped());
    executor.request_stop();
    executor.request_stop();
    assert_eq!(process.wait(), Exit::Cancelled);
    until(|| executor.has_stopped());
    // A release after the stop changes nothing.
    executor.release();
    let late = executor.spawn(ProcessSpec::new("late"), || async {});
    assert_eq!(late.wait(), Exit::Cancelled);
}

#[test]
fn an_abandoned_executor_goes_on() {
    let _watchdog = watchdog();
    let executor = executor();
    let (gate, handle) = (Gate::default(), executor.handle().clone());
    let own = gate.clone();
    let process = executor.spawn(ProcessSpec::new("goes on"), move || async move {
        own.pass().await
    });
    executor.release();
    executor.abandon();
    gate.open();
    assert_eq!(process.wait(), Exit::Completed);
    assert_eq!(
        handle.spawn(ProcessSpec::new("more"), || async {}).wait(),
        Exit::Completed
    );
}

#[test]
fn bodies_that_wait_for_each_other_end_together() {
    let _watchdog = watchdog();
    let executor = executor();
    let first = executor.spawn(ProcessSpec::new("first"), || async { pending().await });
    let mut last = first.clone();
    for level in 0..20 {
        let before = last.clone();
        last = executor.spawn(ProcessSpec::new("next").level(level), move || async move {
            before.join().await;
            pending().await
        });
    }
    executor.release();
    until(|| first.polls() == 1);
    executor.stop();
    assert_eq!(
        (first.wait(), last.wait()),
        (Exit::Cancelled, Exit::Cancelled)
    );
}

#[test]
fn started_and_stopped_many_times() {
    let _watchdog = watchdog();
    for n in 0..support::rounds(200) {
        let executor = executor();
        let process = executor.spawn(ProcessSpec::new("p"), || async { yield_now().await });
        if n % 2 == 0 {
            executor.release();
        }
        if n % 3 == 0 {
            executor.request_stop();
        }
        drop(executor);
        process.wait();
    }
}

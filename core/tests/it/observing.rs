//! What a handle reports of its process, and how the living are counted.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Executor, Exit, OsThread, ProcessRegistry, ProcessSpec, ProcessState, yield_now};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::future::pending;
use std::sync::Arc;
use std::time::Duration;
use support::{Gate, executor, until, watchdog};

#[test]
fn the_states_of_a_life() {
    let _watchdog = watchdog();
    let executor = executor();
    let (gate, build) = (Gate::default(), Gate::default());
    let (own, wait) = (gate.clone(), build.clone());
    let process = executor.spawn(ProcessSpec::new("seen").level(7), move || {
        futures_lite::future::block_on(wait.pass());
        async move { own.pass().await }
    });
    assert_eq!((process.name(), process.priority()), ("seen", 7));
    assert_eq!(
        (process.state(), process.polls(), process.exit()),
        (ProcessState::Created, 0, None)
    );
    build.open();
    executor.settle();
    assert_eq!((process.state(), process.polls()), (ProcessState::Ready, 0));
    executor.release();
    until(|| process.state() == ProcessState::Waiting);
    assert_eq!((process.polls(), process.exit()), (1, None));
    gate.open();
    assert_eq!(process.wait(), Exit::Completed);
    assert_eq!(
        (process.state(), process.polls(), process.exit()),
        (ProcessState::Ended, 2, Some(Exit::Completed))
    );
    assert!(format!("{process:?}").contains("seen"));
}

#[test]
fn polls_are_counted_exactly() {
    let _watchdog = watchdog();
    let executor = executor();
    let process = executor.spawn(ProcessSpec::new("counts"), || async {
        for _ in 0..1000 {
            yield_now().await;
        }
    });
    executor.release();
    process.wait();
    assert_eq!(process.polls(), 1001);
}

#[test]
fn the_longest_poll_is_measured_where_asked_for() {
    let _watchdog = watchdog();
    let executor = executor();
    let body = |spec: ProcessSpec| {
        executor.spawn(spec, || async {
            yield_now().await;
            let end = Instant::now() + Duration::from_millis(5);
            while Instant::now() < end {}
            yield_now().await;
        })
    };
    let (timed, plain) = (
        body(ProcessSpec::new("timed").timed(true)),
        body(ProcessSpec::new("plain")),
    );
    assert_eq!(timed.longest_poll(), None);
    executor.release();
    timed.wait();
    plain.wait();
    assert!(timed.longest_poll().unwrap() >= Duration::from_millis(5));
    assert_eq!(plain.longest_poll(), None);
}

#[test]
fn the_living_are_counted_over_executors_and_threads() {
    let _watchdog = watchdog();
    let registry = Arc::new(ProcessRegistry::new());
    let executor = Executor::start_counted(Attributes::new("one"), registry.clone()).unwrap();
    let gate = Gate::default();
    let own = gate.clone();
    let short = executor.spawn(ProcessSpec::new("short"), move || async move {
        own.pass().await
    });
    let long = executor.spawn(ProcessSpec::new("long"), || async { pending().await });
    let own = gate.clone();
    let body = move || async move { own.pass().await };
    let thread = OsThread::start_counted(Attributes::new("two"), registry.clone(), |executor| {
        executor.announce(ProcessSpec::new("thread"), body)
    })
    .unwrap();
    assert_eq!(registry.count(), 3);
    executor.release();
    thread.release();
    let mut seen = registry.changes();
    gate.open();
    while registry.count() > 1 {
        registry.wait(seen, Instant::NEVER);
        seen = registry.changes();
    }
    assert_eq!(
        (short.wait(), thread.process().wait()),
        (Exit::Completed, Exit::Completed)
    );
    long.cancel();
    while registry.count() > 0 {
        registry.wait(seen, Instant::NEVER);
        seen = registry.changes();
    }
    // Announcing wakes without an end, and a deadline ends a wait.
    registry.announce();
    assert_ne!(registry.changes(), seen);
    registry.wait(registry.changes(), Instant::now());
}

#[test]
fn everything_public_is_what_it_says() {
    fn send_sync<T: Send + Sync>() {}
    fn send<T: Send>() {}
    send_sync::<luna_core::Executor>();
    send_sync::<luna_core::ExecutorHandle>();
    send_sync::<luna_core::ProcessHandle>();
    send_sync::<luna_core::Join<'static>>();
    send_sync::<ProcessRegistry>();
    send_sync::<OsThread>();
    send::<luna_core::Blocking<fn() -> u8, u8>>();
    #[cfg(unix)]
    send_sync::<luna_core::FileReady<'static>>();
}

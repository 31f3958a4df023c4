//! An emergency that a process raises with a cause: the functions run, the others are cancelled,
//! and `run` returns that cause.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;
use luna::{End, Error};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

fn cause() -> Error {
    Error::other("the sensor is dead")
}

#[test]
fn the_cause_is_what_run_returns_wherever_it_is_raised() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("raised");
        let calls = Arc::new(AtomicU32::new(0));
        let counted = calls.clone();
        system.on_emergency("count", move || {
            counted.fetch_add(1, Ordering::Relaxed);
        });
        let executor = system.executor("first").build().unwrap();
        let (value, values) = luna::channel::<u32>();
        // Spawned before, and fails by what the one that raises it leaves.
        executor.process("reader").spawn_ok(async move {
            values.recv().await?;
            Ok(())
        });
        executor
            .process("waits")
            .spawn_ok(std::future::pending::<luna::Result<()>>());
        place
            .process(&mut system, "sensors", "sensor")
            .spawn_ok(async move {
                value.poison();
                Err(luna::emergency(cause()))
            });
        let error = system.run().unwrap_err();
        assert_eq!(
            error.to_string(),
            "process `sensor`: the sensor is dead",
            "{place:?}"
        );
        let report = system.report().unwrap();
        assert_eq!(report.end, End::Emergency);
        assert!(report.to_string().contains("ended by an emergency"));
        assert_eq!(calls.load(Ordering::Relaxed), 1);
    }
}

#[test]
fn the_first_cause_stays() {
    let _watch = watchdog();
    let mut system = System::new("twice");
    let executor = system.executor("main").build().unwrap();
    executor
        .process("first")
        .priority(20)
        .spawn_ok(async { Err(luna::emergency(Error::other("first"))) });
    executor
        .process("second")
        .priority(10)
        .spawn_ok(async { Err(luna::emergency(Error::other("second"))) });
    let error = system.run().unwrap_err();
    assert_eq!(error.to_string(), "process `first`: first");
}

#[test]
fn one_that_raises_it_may_go_on_and_the_cause_is_told_all_the_same() {
    let _watch = watchdog();
    let mut system = System::new("goes on");
    let executor = system.executor("main").build().unwrap();
    executor.process("sensor").spawn_ok(async {
        let _ = luna::emergency(cause());
        std::future::pending().await
    });
    let error = system.run().unwrap_err();
    assert_eq!(error.to_string(), "process `sensor`: the sensor is dead");
}

struct Last(fn());

impl Drop for Last {
    fn drop(&mut self) {
        self.0();
    }
}

/// Runs a system on a clock that comes to stand still. A value that a process then drops calls
/// `last`.
fn stands_still_and_then(is_livelock: bool, last: fn()) -> (Error, End, u32) {
    let mut system = System::new("stands");
    let calls = Arc::new(AtomicU32::new(0));
    let counted = calls.clone();
    system.on_emergency("count", move || {
        counted.fetch_add(1, Ordering::Relaxed);
    });
    if is_livelock {
        system.virtual_clock();
        system.most_turns_at_an_instant(1000);
    } else {
        drop(system.driven_clock());
    }
    let executor = system.executor("main").build().unwrap();
    if is_livelock {
        let spins = executor.process("spins").spawn(async {
            loop {
                luna::yield_now().await;
            }
        });
        spins.unwrap();
    }
    executor.process("arm").spawn_ok(async move {
        let _last = Last(last);
        std::future::pending().await
    });
    let error = system.run().unwrap_err();
    let end = system.report().unwrap().end;
    (error, end, calls.load(Ordering::Relaxed))
}

#[test]
fn one_that_is_raised_during_the_cancellation_is_told_too() {
    let _watch = watchdog();
    for is_livelock in [false, true] {
        let (error, end, calls) = stands_still_and_then(is_livelock, || {
            let _ = luna::emergency(cause());
        });
        assert_eq!(error.to_string(), "process `arm`: the sensor is dead");
        assert_eq!((end, calls), (End::Emergency, 1));
    }
}

#[test]
fn a_panic_during_the_cancellation_is_told_too() {
    let _watch = watchdog();
    for is_livelock in [false, true] {
        let (error, end, calls) = stands_still_and_then(is_livelock, || panic!("on purpose"));
        assert!(error.to_string().contains("on purpose"), "{error}");
        assert_eq!((end, calls), (End::Panic, 1));
    }
}

#[test]
fn outside_of_a_system_it_is_an_error_as_any_other() {
    assert_eq!(luna::emergency(Error::Timeout), Error::Timeout);
    let outcome = luna::run(async { Err::<(), _>(luna::emergency(Error::Timeout)) });
    assert_eq!(outcome, Err(Error::Timeout));
}

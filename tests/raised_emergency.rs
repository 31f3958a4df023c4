//! An emergency that a process raises with a cause: the functions run, the others are cancelled, and `run` returns that cause.

mod common;

use common::{PLACES, watchdog};
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
    for place in PLACES {
        let mut system = System::new("raised");
        let calls = Arc::new(AtomicU32::new(0));
        let counted = calls.clone();
        system.on_emergency("count", move || {
            counted.fetch_add(1, Ordering::Relaxed);
        });
        let executor = system.executor("first").build().unwrap();
        let (value, values) = luna::channel::<u32>();
        // Spawned before, and fails by what the one that raises it leaves.
        executor
            .process("reader")
            .spawn(async move {
                values.recv().await?;
                Ok(())
            })
            .unwrap();
        executor
            .process("waits")
            .spawn(std::future::pending::<luna::Result<()>>())
            .unwrap();
        place
            .process(&mut system, "sensors", "sensor")
            .spawn(async move {
                value.poison();
                Err(luna::emergency(cause()))
            })
            .unwrap();
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
        .spawn(async { Err(luna::emergency(Error::other("first"))) })
        .unwrap();
    executor
        .process("second")
        .priority(10)
        .spawn(async { Err(luna::emergency(Error::other("second"))) })
        .unwrap();
    let error = system.run().unwrap_err();
    assert_eq!(error.to_string(), "process `first`: first");
}

#[test]
fn who_raises_it_may_go_on_and_the_cause_is_told_all_the_same() {
    let _watch = watchdog();
    let mut system = System::new("goes on");
    let executor = system.executor("main").build().unwrap();
    executor
        .process("sensor")
        .spawn(async {
            let _ = luna::emergency(cause());
            std::future::pending().await
        })
        .unwrap();
    let error = system.run().unwrap_err();
    assert_eq!(error.to_string(), "process `sensor`: the sensor is dead");
}

#[test]
fn outside_of_a_system_it_is_an_error_as_any_other() {
    assert_eq!(luna::emergency(Error::Timeout), Error::Timeout);
    let outcome = luna::run(async { Err::<(), _>(luna::emergency(Error::Timeout)) });
    assert_eq!(outcome, Err(Error::Timeout));
}

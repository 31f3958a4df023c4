//! Watchdogs and the emergency.

use super::{Outcome, Test, Trouble, ensure, on_one_executor, same};
use luna::{End, System, Watchdog};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub(super) const TESTS: &[Test] = &[
    Test {
        name: "watchdog",
        component: "safety",
        shows: "a watchdog that is fed no more fires, and stays expired until its reset",
        run: watchdog,
    },
    Test {
        name: "emergency",
        component: "safety",
        shows: "a panic in a process runs the emergency functions in order, and ends the system with an error",
        run: emergency,
    },
];

fn watchdog() -> Outcome {
    on_one_executor(|executor| {
        let dog = Watchdog::new(Duration::from_millis(2));
        executor.process("guard").spawn(async move {
            dog.feed();
            let start = luna::now();
            dog.expired().await;
            ensure(
                luna::now() - start >= Duration::from_millis(1),
                "not before its time",
            )?;
            dog.feed();
            ensure(dog.has_expired(), "it stays expired")?;
            dog.reset();
            dog.feed();
            Ok(())
        })?;
        Ok(())
    })?;
    Ok("1 bite".to_owned())
}

fn emergency() -> Outcome {
    let calls = Arc::new(AtomicU32::new(0));
    let mut system = System::new("self-test");
    let executor = system.executor("main").build()?;
    // The digits tell the order.
    for digit in 1..=2 {
        let calls = calls.clone();
        system.on_emergency("digit", move || {
            let before = calls.load(Ordering::Relaxed);
            calls.store(10 * before + digit, Ordering::Relaxed);
        });
    }
    executor.process("panics on purpose").spawn(async {
        // Unwinds without the hook, which would write to standard error.
        std::panic::resume_unwind(Box::new("the self-test's own panic"))
    })?;
    let outcome = system.run();
    if let Ok(report) = outcome {
        return Err(Trouble::Failed(format!(
            "the panic was no error: {:?}",
            report.end
        )));
    }
    same("the functions that ran", calls.load(Ordering::Relaxed), 12)?;
    let end = system.report().map(|report| report.end);
    same("the end", end, Some(End::Panic))?;
    Ok("2 functions".to_owned())
}

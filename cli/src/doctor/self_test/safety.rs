//! Watchdogs and the emergency.

use super::{Outcome, Test, Trouble, ensure, on_one_executor, same};
use luna::safety::Watchdog;
use luna::{End, System};
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
    Test {
        name: "budget",
        component: "safety",
        shows: "a process that takes longer than its budget is counted, and one that keeps it is not",
        run: budget,
    },
];

fn watchdog() -> Outcome {
    on_one_executor(|executor| {
        let watchdog = Watchdog::new(Duration::from_millis(2));
        executor.process("guard").spawn(async move {
            let start = luna::now();
            watchdog.feed();
            watchdog.expired().await;
            ensure(
                luna::now() - start >= Duration::from_millis(1),
                "not before its time",
            )?;
            watchdog.feed();
            ensure(watchdog.has_expired(), "it stays expired")?;
            watchdog.reset();
            watchdog.feed();
            Ok(())
        })
    })?;
    Ok("1 expiry".to_owned())
}

fn emergency() -> Outcome {
    let calls = Arc::new(AtomicU32::new(0));
    let mut system = System::new("self-test");
    let executor = system.executor("main").build()?;
    // The digits show the order.
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

fn budget() -> Outcome {
    let report = on_one_executor(|executor| {
        let long = executor
            .process("long")
            .poll_budget(Duration::from_micros(100));
        long.spawn(async {
            let end = luna::now() + Duration::from_millis(1);
            while luna::now() < end {
                std::hint::spin_loop();
            }
            Ok(())
        })?;
        let short = executor
            .process("short")
            .poll_budget(Duration::from_secs(60));
        short.spawn(async { Ok(()) })?;
        Ok(())
    })?;
    let overruns = |name: &str| -> u64 {
        let of_name = report.processes.iter().filter(|one| one.name == name);
        of_name
            .flat_map(|one| &one.budgets)
            .map(|budget| budget.overruns)
            .sum()
    };
    same("overruns", (overruns("long"), overruns("short")), (1, 0))?;
    Ok("1 overrun".to_owned())
}

//! Budgets: a machine with a path planner that sometimes computes for too long. It is counted, then
//! ended, then an emergency; and the loop that it delayed reports which process ran instead.
//!
//! ```text
//!   planner ----> drive (a loop of 10 ms, more urgent, on the same executor)
//! ```
//!
//! A process runs until it awaits something, regardless of the others' priorities. So each process
//! that shares an executor with a loop states how long it may run.

use luna::prelude::*;
use luna::safety::{BudgetKind, OnOverrun};
use luna::{End, Error, Report};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(10);
/// What the planner is allowed at a time.
const BUDGET: Duration = Duration::from_millis(100);
/// What it takes once: past many a slot of the loop.
const TOO_LONG: Duration = Duration::from_millis(155);

/// Computes paths: one of them for too long.
async fn plan(output: Sender<u32>) -> luna::Result<()> {
    for path in 0..3 {
        if path == 1 {
            let end = luna::now() + TOO_LONG;
            while luna::now() < end {}
        }
        output.send(path).await?;
    }
    Ok(())
}

/// Takes a path when there is one.
async fn drive(input: Receiver<u32>) -> luna::Result<()> {
    let mut tick = luna::periodic("drive", PERIOD)?;
    loop {
        tick.next().await;
        input.recv().await?;
    }
}

/// Runs the machine; `policy` determines what happens to a planner that takes too long.
fn run(policy: OnOverrun) -> (luna::Result<Report>, Report, bool) {
    let stopped = Arc::new(AtomicBool::new(false));
    let brake = stopped.clone();
    let machine = || -> luna::Result<System> {
        let mut system = System::new("machine");
        system.on_emergency("brake", move || brake.store(true, Ordering::SeqCst));
        let main = system.executor("main").build()?;
        let (output, input) = luna::channel();
        main.process("planner")
            .priority(10)
            .poll_budget(BUDGET)
            .on_overrun(policy)
            .spawn(plan(output))?;
        main.process("drive").priority(30).spawn(async {
            drive(input)
                .await
                .or_else(|end| if end.is_closed() { Ok(()) } else { Err(end) })
        })?;
        Ok(system)
    };
    let system = machine().expect("the description is right");
    let outcome = system.run();
    let report = system.report().expect("it has run");
    (outcome, report, stopped.load(Ordering::SeqCst))
}

/// The planner's overrun, as an error has it.
fn is_overrun(error: &Error) -> bool {
    let Error::Process { name, source } = error else {
        return false;
    };
    name == "planner"
        && matches!(**source, Error::BudgetOverrun { kind: BudgetKind::Poll, budget: BUDGET, taken } if taken > BUDGET)
}

fn main() -> luna::Result<()> {
    // Count: all continue, and the report has the culprit, and the victim.
    let (outcome, report, stopped) = run(OnOverrun::Count);
    outcome?;
    let budget = &report.processes[0].budgets[0];
    assert!(budget.overruns >= 1 && !stopped);
    assert!(
        budget
            .worst
            .as_ref()
            .is_some_and(|worst| worst.taken >= TOO_LONG)
    );
    let late = &report.loops["drive"].late_cycles;
    let culprits = late.iter().filter_map(|cycle| cycle.ran_instead.as_ref());
    assert!(
        culprits
            .into_iter()
            .any(|culprit| culprit.process == "planner")
    );
    println!("{report}");

    // Warn: also reported on standard error, while the system runs.
    run(OnOverrun::Warn).0?;

    // Poison: the planner is ended, and processes that wait for it get an error.
    let (outcome, report, stopped) = run(OnOverrun::Poison);
    let error = outcome.expect_err("the planner was ended for cause");
    assert!(
        is_overrun(&error) && report.end == End::Completed && !stopped,
        "{error}"
    );
    println!("poison: {error}");

    // Emergency: the brake first, then the end of all.
    let (outcome, report, stopped) = run(OnOverrun::Emergency);
    let error = outcome.expect_err("the planner has made an emergency");
    assert!(
        is_overrun(&error) && report.end == End::Overrun && stopped,
        "{error}"
    );
    println!("emergency: {error}");
    Ok(())
}

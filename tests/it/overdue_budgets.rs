//! Budgets of polls and cycles that never end: the guarded process does not switch off its emergency
//! by that.

use crate::common;
use common::{PLACEMENTS, SpawnOk, watchdog};
use luna::prelude::*;
use luna::safety::{BudgetKind, OnOverrun};
use luna::{End, Error};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// The report of a system that was ended for an overrun, of this kind and of the process `stuck`.
fn ended_for(system: &mut System, kind: BudgetKind) -> luna::Report {
    let error = system.run().unwrap_err();
    let Error::Process { name, source } = &error else {
        panic!("{error}");
    };
    assert_eq!(name, "stuck");
    let Error::BudgetOverrun { kind: found, .. } = &**source else {
        panic!("{error}");
    };
    assert_eq!(*found, kind);
    let report = system.report().unwrap();
    assert_eq!(report.end, End::Overrun);
    report
}

#[test]
fn a_cycle_that_waits_for_ever_is_an_overrun() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        let mut system = System::new("stuck");
        let process = place.process(&mut system, "place", "stuck");
        let process = process
            .cycle_budget(5 * MS)
            .on_overrun(OnOverrun::Emergency);
        process.spawn_ok(async {
            let mut tick = luna::periodic("loop", MS)?;
            // Its partner exists, and sends nothing.
            let (_partner, input) = luna::channel::<()>();
            tick.next().await;
            input.external().recv().await?;
            tick.next().await;
            Ok(())
        });
        let report = ended_for(&mut system, BudgetKind::Cycle);
        let budget = &report.processes[0].budgets[0];
        assert_eq!(budget.overruns, 1);
        assert!(budget.worst.as_ref().unwrap().taken > 5 * MS);
    }
}

#[test]
fn a_poll_that_computes_for_ever_is_an_overrun() {
    let _watch = watchdog();
    let is_over = Arc::new(AtomicBool::new(false));
    let mut system = System::new("hog");
    let (over, own) = (is_over.clone(), is_over.clone());
    system.on_emergency("over", move || over.store(true, Ordering::SeqCst));
    let main = system.executor("main").build().unwrap();
    let process = main.process("stuck").poll_budget(5 * MS);
    process
        .on_overrun(OnOverrun::Emergency)
        .spawn_ok(async move {
            // Only the emergency ends it, so that the test leaves nothing behind.
            while !own.load(Ordering::SeqCst) {
                std::hint::spin_loop();
            }
            Ok(())
        });
    let report = ended_for(&mut system, BudgetKind::Poll);
    // Counted once, though it ended after all.
    assert_eq!(report.processes[0].budgets[0].overruns, 1);
}

#[test]
fn polls_and_cycles_that_end_in_time_are_none() {
    let _watch = watchdog();
    let mut system = System::new("well");
    let main = system.executor("main").build().unwrap();
    let process = main
        .process("well")
        .cycle_budget(Duration::from_secs(1000))
        .poll_budget(Duration::from_secs(1000));
    process
        .on_overrun(OnOverrun::Emergency)
        .spawn_ok(async move {
            let mut ticks = Vec::new();
            // More loops than are looked at while they last.
            for number in 0..12 {
                let mut tick = luna::periodic(format!("loop {number}"), MS)?;
                tick.next().await;
                ticks.push(tick);
            }
            luna::after(50 * MS).await;
            Ok(())
        });
    let report = system.run().unwrap();
    assert!(
        report.processes[0]
            .budgets
            .iter()
            .all(|one| one.overruns == 0)
    );
}

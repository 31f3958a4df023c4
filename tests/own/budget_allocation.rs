//! Budgets that are overrun and cycles that are late allocate and free nothing on the real-time
//! path. One test alone, since the allocator counts what the whole program does.

use crate::ALLOCATOR;
use crate::common;

use common::{PLACES, burn_until, watchdog};
use luna::prelude::*;
use luna::{BudgetKind, OnOverrun};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
const CYCLES: u64 = 50;

/// Overruns both its budgets in each cycle, and is late for the next.
async fn overrun(name: &'static str, accounted: bool) -> luna::Result<()> {
    let mut tick = luna::periodic(name, PERIOD)?.late_after(Duration::from_micros(1));
    if accounted {
        tick = tick.accounted();
    }
    for _ in 0..CYCLES {
        let cycle = tick.next().await;
        burn_until(cycle.deadline + 3 * PERIOD / 2);
    }
    Ok(())
}

#[test]
fn overruns_and_late_cycles_allocate_nothing() {
    own_process!();
    let _watch = watchdog();
    let mut system = System::new("overrun");
    let policies = [OnOverrun::Count, OnOverrun::Warn];
    let mut names = Vec::new();
    for (place, policy, accounted) in PLACES
        .into_iter()
        .flat_map(|place| policies.map(|policy| (place, policy)))
        .flat_map(|(place, policy)| [false, true].map(|accounted| (place, policy, accounted)))
    {
        let name: &'static str = format!("{place:?} {policy:?} {accounted}").leak();
        names.push(name);
        let mut process = place
            .process(&mut system, name, name)
            .poll_budget(PERIOD / 2)
            .cycle_budget(PERIOD / 2)
            .on_overrun(policy);
        if accounted {
            process = process.accounted();
        }
        process.spawn(overrun(name, accounted)).unwrap();
    }
    let (output, input) = luna::channel::<u32>();
    let main = system.executor("poisons").build().unwrap();
    main.process("poisoned")
        .poll_budget(PERIOD)
        .on_overrun(OnOverrun::Poison)
        .spawn(async move {
            let _output = output;
            burn_until(luna::now() + 2 * PERIOD);
            luna::after(PERIOD).await;
            Ok(())
        })
        .unwrap();
    main.process("partner")
        .spawn(async move {
            assert!(input.recv().await.is_err());
            Ok(())
        })
        .unwrap();
    system.run().unwrap_err();
    assert_eq!(ALLOCATOR.on_path(), (0, 0), "allocations and frees");

    let report = system.report().unwrap();
    for name in names {
        let process = report.processes.iter().find(|one| one.name == name);
        for budget in &process.unwrap().budgets {
            // The last cycle has no end.
            let least = match budget.kind {
                BudgetKind::Cycle => CYCLES - 1,
                _ => CYCLES / 2,
            };
            assert!(budget.overruns >= least, "{name}: {budget:?}");
        }
        assert!(report.loops[name].late >= CYCLES / 2, "{name}");
    }
}

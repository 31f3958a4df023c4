//! A run of the Production Cell on a virtual clock, as a recording.

use luna::log::Logging;
use luna::prelude::*;
use luna_production_cell::{Breakage, Drill, Plan, Settings, Unit, deploy};
use std::path::Path;
use std::time::Duration;

/// The fault comes at 2 s and is repaired at 3.5 s.
pub fn record(to: &Path, fault: (Unit, Breakage)) {
    let (unit, fault) = fault;
    let mut system = System::new("production cell");
    system.virtual_clock();
    system.log(Logging::to_file(to).replacing());
    let drill = Drill {
        unit,
        fault,
        at: Duration::from_secs(2),
        lasts: Duration::from_millis(1500),
    };
    let settings = Settings {
        plan: Plan {
            time: Duration::from_secs(5),
            exchange: None,
            drills: vec![drill],
        },
        policy: Policy::Other,
        heeds_neighbours: true,
    };
    let cell = deploy::in_one_program(&mut system, deploy::Place::Executor, settings).unwrap();
    system.run().unwrap();
    assert!(cell.outcome().is_good(), "{:?}", cell.outcome());
}

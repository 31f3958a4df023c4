//! The cell in virtual time: every run is the same, and takes moments.

#![cfg(target_os = "linux")]

mod drills;
mod line;
#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

use luna::prelude::*;
use luna_production_cell::{Drill, Outcome, Plan, Settings, deploy};
use std::time::Duration;

const fn ms(time: u64) -> Duration {
    Duration::from_millis(time)
}

fn settings(seconds: u64, drill: Option<Drill>) -> Settings {
    Settings {
        plan: Plan {
            time: Duration::from_secs(seconds),
            exchange: None,
            drills: drill.into_iter().collect(),
        },
        policy: Policy::Other,
        heeds_neighbours: true,
    }
}

/// Runs the cell on one executor, on a virtual clock.
fn run(settings: Settings) -> Outcome {
    let mut system = System::new("production cell");
    system.virtual_clock();
    let cell = deploy::in_one_program(&mut system, deploy::Place::Executor, settings).unwrap();
    system.run().unwrap();
    cell.outcome()
}

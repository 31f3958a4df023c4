//! The line without faults.

use crate::{ms, run, settings};
use luna_production_cell::messages::Condition;
use luna_production_cell::{Settings, Unit};

#[test]
fn blocks_go_round_and_none_is_lost() {
    let outcome = run(settings(14, None));
    assert!(outcome.is_good() && outcome.blocks >= 8, "{outcome:?}");
    // All of them have passed all units.
    for unit in &outcome.units {
        assert!(unit.taken >= 8 && unit.stops == 0, "{unit:?}");
        assert_eq!(unit.condition, Condition::Stopped);
    }
    let mut blocks: Vec<u32> = outcome
        .units
        .iter()
        .flat_map(|unit| unit.blocks.clone())
        .collect();
    blocks.sort_unstable();
    assert_eq!(blocks, [1, 2, 3, 4, 5]);
}

#[test]
fn every_run_is_the_same() {
    let runs = [(); 2].map(|()| run(settings(3, None)));
    assert_eq!(runs[0].changes, runs[1].changes);
    assert!(runs[0].changes.len() > 20);
}

#[test]
fn the_controllers_are_exchanged_while_the_line_runs() {
    let mut settings = settings(10, None);
    // Not a multiple of any time in it, so that all phases of the motion are met.
    settings.plan.exchange = Some(ms(173));
    let outcome = run(settings);
    assert!(outcome.is_good() && outcome.blocks >= 8, "{outcome:?}");
    assert!(
        outcome.units.iter().all(|unit| unit.stops == 0),
        "{outcome:?}"
    );
}

/// The other law alone is another motion: the exchange above was one.
#[test]
fn the_second_law_is_another() {
    let second = |settings: Settings| {
        let mut settings = settings;
        settings.plan.exchange = Some(ms(1));
        // An exchange each look of the operator: an odd number of them leaves the other law.
        run(settings)
    };
    let [first, exchanged] = [run(settings(3, None)), second(settings(3, None))];
    assert_ne!(first.changes, exchanged.changes);
    assert!(exchanged.is_good());
    assert!(!exchanged.was(Unit::Feeder, Condition::Faulty));
}

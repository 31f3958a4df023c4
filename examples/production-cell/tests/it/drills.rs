//! Faults: the neighbours that depend on the unit stop before anything collides, and no others.
//! After the repair the line goes on, without a lost or doubled block.

use crate::shared::sample;
use crate::{ms, run, settings};
use luna_production_cell::messages::Condition::{self, Faulty, Halted, Lost, Safe};
use luna_production_cell::{Breakage, Drill, Outcome, Settings, Unit, picture};

fn drill(unit: Unit, fault: Breakage, at: u64) -> Settings {
    let (at, lasts) = (ms(at), ms(400));
    let drill = Drill {
        unit,
        fault,
        at,
        lasts,
    };
    let mut settings = settings(0, Some(drill));
    settings.plan.time = at + lasts + ms(2000);
    settings
}

/// The units that were in this condition at some time.
fn were(outcome: &Outcome, condition: Condition) -> Vec<Unit> {
    let was = |unit: &Unit| outcome.was(*unit, condition);
    Unit::ALL.into_iter().filter(was).collect()
}

fn drills_of(unit: Unit) {
    let safe = match unit {
        Unit::Feeder => vec![Unit::MoulderDoor],
        _ => vec![],
    };
    for fault in [Breakage::Stuck, Breakage::Sensor, Breakage::Kill] {
        let outcome = run(drill(unit, fault, 1200));
        let failed = were(
            &outcome,
            if fault == Breakage::Kill {
                Lost
            } else {
                Faulty
            },
        );
        assert_eq!(failed, [unit], "{fault:?}: {outcome:#?}");
        assert_eq!(were(&outcome, Halted), [unit.behind()], "{fault:?}");
        assert_eq!(were(&outcome, Safe), safe, "{fault:?}");
        assert!(outcome.is_good(), "{fault:?}: {outcome:#?}");
        let repair = outcome.marks.iter().find(|mark| mark.what == "repair");
        let repair = repair.expect("there is a repair");
        if unit == Unit::Feeder {
            let door = repair.positions[Unit::MoulderDoor as usize];
            assert!((door - 0.1).abs() < 5e-3, "the door is not open: {door}");
        }
        for unit in [unit.behind(), unit, unit.ahead()] {
            let given = outcome.units[unit as usize].given;
            assert!(
                given > repair.given[unit as usize],
                "{unit:?} after {fault:?}: {outcome:#?}"
            );
        }
    }
}

#[test]
fn the_feeder_belt_fails() {
    drills_of(Unit::FeederBelt);
}

#[test]
fn the_feeder_fails_so_the_door_opens_and_the_feeder_belt_halts() {
    drills_of(Unit::Feeder);
}

#[test]
fn the_door_fails() {
    drills_of(Unit::MoulderDoor);
}

#[test]
fn the_extractor_fails() {
    drills_of(Unit::Extractor);
}

#[test]
fn the_extraction_belt_fails() {
    drills_of(Unit::ExtractionBelt);
}

#[test]
fn the_robot_fails() {
    drills_of(Unit::Robot);
}

/// The belt brings a block to the feeder then.
const BLOCK_COMES: u64 = 1900;

/// A feeder that dies, and what would have run into it has done so by the end.
fn feeder_dies(at: u64) -> Settings {
    let mut settings = drill(Unit::Feeder, Breakage::Kill, at);
    settings.plan.time -= ms(1000);
    settings
}

fn is_not_run_into(at: u64) {
    let outcome = run(feeder_dies(at));
    assert!(outcome.is_good(), "{at}: {outcome:#?}");
}

/// The same with neighbours that do not heed it shows that there is something to prevent.
#[test]
fn a_feeder_that_dies_when_a_block_comes_is_not_run_into() {
    is_not_run_into(BLOCK_COMES);
    let mut settings = feeder_dies(BLOCK_COMES);
    settings.heeds_neighbours = false;
    assert!(run(settings).collisions > 0);
}

/// A part of the instants; with `LUNA_LONG=1` all of them. Those next to a block's coming are
/// always among them.
#[test]
fn a_feeder_that_dies_at_any_instant_of_its_cycle_is_not_run_into() {
    is_not_run_into(BLOCK_COMES - 100);
    is_not_run_into(BLOCK_COMES + 100);
    let others = (1200..2400_u64).step_by(100);
    let others = others.filter(|at| at.abs_diff(BLOCK_COMES) > 100);
    sample(others, 4).for_each(is_not_run_into);
}

#[test]
fn the_picture_shows_all_units_and_the_fault() {
    let outcome = run(drill(Unit::Feeder, Breakage::Stuck, 1200));
    let svg = picture::svg(&outcome, "drill");
    for text in [
        "feeder belt",
        "robot",
        ">fault<",
        ">repair<",
        "#c53030",
        "#2b6cb0",
    ] {
        assert!(svg.contains(text), "{text}");
    }
}

//! A motor axis with a fault of its plant, operator or controller, on virtual time: when each fault
//! is found, to the millisecond, and what the axis did until then.

#[path = "../../examples/safe_axis/axis.rs"]
mod axis;

use axis::{APART, ASKED, BLOCKED, MS, NOISE, Outcome, PRESSED, SILENT, STOP, Trouble, run};
use luna_plants::PAN;
use luna_safety_blocks::Fault;
use std::time::Duration;

/// The block that found the fault, after how many milliseconds, and whether the emergency ran then.
fn first(outcome: &Outcome) -> (&str, Duration, bool) {
    let (after, cause) = &outcome.alarms[0];
    let is_emergency = outcome
        .emergency
        .as_ref()
        .is_some_and(|(at, of)| (at, of) == (after, cause));
    (&cause.block, *after, is_emergency)
}

fn fault(outcome: &Outcome) -> Fault {
    outcome.alarms[0].1.fault
}

#[test]
fn without_trouble_there_is_no_alarm_and_the_axis_follows() {
    let outcome = run(Trouble::None).unwrap();
    assert_eq!((&outcome.alarms[..], &outcome.emergency), (&[][..], &None));
    assert!((0.9..1.1).contains(&outcome.furthest), "{outcome:?}");
}

#[test]
fn a_frozen_encoder_is_seen_five_milliseconds_after_it_is_too_far_off() {
    let outcome = run(Trouble::EncoderFrozen).unwrap();
    // At this speed the axis moves two hundredths of a radian in 8 ms.
    assert_eq!(outcome.apart, Some(8 * MS));
    assert_eq!(first(&outcome), ("encoders", 8 * MS + APART, true));
    assert!(matches!(
        fault(&outcome),
        Fault::Disagree { time: APART, .. }
    ));
}

#[test]
fn an_encoder_that_jumps_is_seen_in_the_same_sample() {
    let outcome = run(Trouble::EncoderJumps).unwrap();
    assert_eq!(first(&outcome), ("encoder rate", Duration::ZERO, true));
}

#[test]
fn noise_is_seen_within_its_samples_and_is_a_warning() {
    let outcome = run(Trouble::EncoderRustles).unwrap();
    let (block, after, _) = first(&outcome);
    assert_eq!((block, after), ("encoder noise", 13 * MS));
    assert!(after < NOISE * MS);
    assert_eq!(outcome.emergency, None);
}

#[test]
fn a_jammed_motor_is_seen_fifty_milliseconds_after_the_first_sample_that_drives_it() {
    let outcome = run(Trouble::Jammed).unwrap();
    // What reaches the motor after 3 ms was put out by the blocks after 1.
    assert_eq!(outcome.driven, Some(3 * MS));
    assert_eq!(first(&outcome), ("motion", MS + BLOCKED, true));
    assert!(matches!(
        fault(&outcome),
        Fault::Blocked { time: BLOCKED, .. }
    ));
}

#[test]
fn a_set_point_that_runs_away_is_limited_at_once_and_held_when_it_lasts() {
    let outcome = run(Trouble::SetPointRunsAway).unwrap();
    assert_eq!(first(&outcome), ("set-point limit", ASKED, false));
    assert_eq!(outcome.alarms.len(), 1);
    // Its neutral, the middle, was come to; and the axis never was far.
    assert!(
        outcome.furthest < 1.1 && outcome.end.angle.abs() < 0.05,
        "{outcome:?}"
    );
}

#[test]
fn a_set_point_that_is_no_number_is_refused_in_the_same_sample() {
    let outcome = run(Trouble::SetPointIsNan).unwrap();
    assert_eq!(first(&outcome), ("set-point limit", Duration::ZERO, false));
    assert!(matches!(fault(&outcome), Fault::NotFinite { value, .. } if value.is_nan()));
    assert!(outcome.end.angle.abs() < 0.05, "{outcome:?}");
}

#[test]
fn a_silent_controller_is_seen_when_its_time_is_over() {
    let outcome = run(Trouble::ControllerSilent).unwrap();
    // It spoke last one cycle before.
    assert_eq!(first(&outcome), ("controller", SILENT - MS, false));
    // The plant receives it in its next slot, and applies it from there on: visible at that slot's
    // end.
    assert_eq!(outcome.off_since, Some(SILENT + MS));
    assert_eq!(outcome.end.speed, 0.0);
}

#[test]
fn a_controller_gone_mad_does_not_reach_the_end_stop() {
    let outcome = run(Trouble::ControllerMad).unwrap();
    let (block, after, _) = first(&outcome);
    let off = outcome.off_since.unwrap();
    // The drive is off two slots after the blocks removed it: one until the plant receives that,
    // one until its step is visible.
    assert_eq!((block, after), ("end stop", off - 2 * MS + PRESSED));
    assert!(
        (STOP..PAN.end_stop).contains(&outcome.furthest),
        "{outcome:?}"
    );
    assert!(outcome.is_safe_state && outcome.emergency.is_none());
}

#[test]
fn every_run_is_the_same() {
    for trouble in axis::TROUBLES {
        let [first, second] = [0, 1].map(|_| format!("{:?}", run(trouble).unwrap()));
        assert_eq!(first, second);
    }
}

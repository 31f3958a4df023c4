//! The head in virtual time: every run is the same, and takes moments.

use luna::prelude::*;
use luna::report::Report;
use luna_head::mechanics::{Fault, Trouble};
use luna_head::parameters::{GAZE_BOUND, HEAD, SETTLE, STOP_WITHIN};
use luna_head::{Findings, Place, Settings, network};
use std::time::Duration;

/// Runs the head on a virtual clock, with a fault from 2 s on that lasts 1.5 s.
fn run(seconds: u64, fault: Option<Fault>, place: Place) -> (Findings, Report) {
    let mut system = System::new("head");
    system.virtual_clock();
    let trouble = |fault| Trouble {
        fault,
        at: Duration::from_secs(2),
        lasts: Duration::from_millis(1500),
    };
    let settings = Settings {
        time: Duration::from_secs(seconds),
        troubles: fault.into_iter().map(trouble).collect(),
        policy: Policy::Other,
        place,
    };
    let head = network::build(&mut system, settings).unwrap();
    let report = system.run().unwrap();
    (head.findings().expect("it has ended"), report)
}

#[test]
fn the_gaze_settles_on_the_target_and_stays() {
    let (findings, report) = run(6, None, Place::Executor);
    assert!(findings.is_good(), "{findings:#?}");
    assert!(findings.gaze_rms.unwrap() < GAZE_BOUND.to_degrees() / 2.0);
    for (name, slots) in [("joints", 5_990), ("motion", 355), ("mechanics", 5_990)] {
        let one = &report.loops[name];
        assert!(one.cycles >= slots && one.missed == 0, "{name}: {one:?}");
    }
}

#[test]
fn every_run_is_the_same_and_vision_may_have_its_own_thread() {
    let runs = [Place::Executor, Place::Executor, Place::Threads];
    let [first, again, apart] = runs.map(|place| run(2, None, place).0);
    assert_eq!(first, again);
    assert!(apart.is_good(), "{apart:#?}");
}

#[test]
fn the_gaze_holds_without_vision_and_comes_back() {
    let (findings, _) = run(7, Some(Fault::Vision), Place::Executor);
    assert!(findings.is_good(), "{findings:#?}");
    assert!(findings.held_drift.is_some());
    // The target went on meanwhile, and is followed afterwards.
    let until_then = run(3, Some(Fault::Vision), Place::Executor).0;
    assert_ne!(findings.gaze_rms, until_then.gaze_rms);
}

#[test]
fn a_target_that_jumps_is_found_again() {
    let (findings, _) = run(5, Some(Fault::Jump), Place::Executor);
    assert!(findings.is_good(), "{findings:#?}");
}

/// The gaze is judged until the fault; from then on, that the head stands.
#[test]
fn a_sensor_that_is_stuck_stops_the_head() {
    for (axis, name) in HEAD.iter().map(|axis| axis.name).enumerate() {
        let (findings, _) = run(4, Some(Fault::Sensor(axis)), Place::Executor);
        assert!(findings.is_good(), "{name}: {findings:#?}");
        let at = findings.stopped_at.unwrap();
        assert!((2.0..2.0 + STOP_WITHIN).contains(&at), "{name}: {at}");
    }
}

/// What the verdict is made of: each limit alone makes it bad.
#[test]
fn the_verdict_sees_each_limit() {
    let good = run(2, None, Place::Executor).0;
    assert!(good.is_good());
    let bad = |change: fn(&mut Findings)| {
        let mut findings = good.clone();
        change(&mut findings);
        !findings.is_good()
    };
    assert!(bad(|findings| findings.axes[2].furthest = 40.0));
    assert!(bad(|findings| findings.duty = 0.95));
    assert!(bad(|findings| findings.gaze_worst = Some(2.5)));
    assert!(bad(|findings| findings.gaze_worst = None));
    assert!(bad(|findings| findings.held_drift = Some(3.0)));
    assert!(bad(|findings| findings.stopped_at = Some(2.0)));
    assert!(bad(
        |findings| findings.faults = vec!["sensor-neck-pan".into()]
    ));
}

#[test]
fn a_run_that_is_too_short_is_not_called_good() {
    let (findings, _) = run(1, None, Place::Executor);
    assert!(findings.seconds < SETTLE && !findings.is_good());
}

//! TUlip in virtual time: every run is the same, and takes moments. Faults are tried at a part of
//! the joints; `LUNA_LONG=1` tries all.

#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

use luna::prelude::*;
use luna::report::Report;
use luna_tulip::parameters::{ROBOT, STOP_WITHIN};
use luna_tulip::{Fault, Findings, Place, Settings, Trouble, network};
use shared::sample;
use std::time::Duration;

/// Runs the robot on a virtual clock, with a fault at 3 s.
fn run(seconds: u64, fault: Option<Fault>, place: Place) -> (Findings, Report) {
    let mut system = System::new("tulip");
    system.virtual_clock();
    let at = Duration::from_secs(3);
    let settings = Settings {
        time: Duration::from_secs(seconds),
        exchange: Duration::from_millis(700),
        troubles: fault
            .map(|fault| Trouble { fault, at })
            .into_iter()
            .collect(),
        policy: Policy::Other,
        place,
    };
    let tulip = network::build(&mut system, settings).unwrap();
    let report = system.run().unwrap();
    (tulip.findings().expect("it has ended"), report)
}

#[test]
fn it_walks_and_its_controllers_are_exchanged_meanwhile() {
    let (findings, report) = run(10, None, Place::Executor);
    assert!(findings.is_good(), "{findings:#?}");
    assert!(findings.steps >= 8 && findings.distance > 0.4);
    assert!(findings.exchanges >= 8 && findings.lost == 0);
    assert!(findings.capture_margin.unwrap() > 0.01);
    for name in network::LOOPS {
        let one = &report.loops[name];
        let all = 10.0 / one.period.as_secs_f64() - 5.0;
        assert!(
            one.cycles as f64 >= all && one.missed == 0,
            "{name}: {one:?}"
        );
    }
    assert!(findings.shown_times > 90 && findings.shown.len() == 3);
}

#[test]
fn every_run_is_the_same_and_layers_may_have_threads() {
    let runs = [Place::Executor, Place::Executor, Place::Threads];
    let [first, again, apart] = runs.map(|place| run(5, None, place).0);
    assert_eq!(first, again);
    assert!(apart.is_good(), "{apart:#?}");
}

#[test]
fn a_push_is_answered_by_other_footholds() {
    let (pushed, _) = run(9, Some(Fault::Push), Place::Executor);
    assert!(pushed.is_good(), "{pushed:#?}");
    let (alone, _) = run(9, None, Place::Executor);
    assert!(pushed.distance > alone.distance, "{pushed:#?}");
}

/// While the robot walks, all joints but the yaws of the hips move.
#[test]
fn a_sensor_that_is_stuck_stops_the_robot() {
    let names = ROBOT.iter().map(|joint| joint.name).enumerate();
    let moving = names.filter(|(_, name)| !name.ends_with("hip-yaw"));
    for (joint, name) in sample(moving, 3) {
        let (findings, _) = run(4, Some(Fault::Sensor(joint)), Place::Executor);
        assert!(findings.is_good(), "{name}: {findings:#?}");
        let at = findings.stopped_at.unwrap();
        assert!((3.0..3.0 + STOP_WITHIN).contains(&at), "{name}: {at}");
    }
}

#[test]
fn a_controller_gone_mad_stops_the_robot_before_its_joint_is_at_the_stop() {
    let names = ROBOT.iter().map(|joint| joint.name).enumerate();
    for (joint, name) in sample(names, 3) {
        let (findings, _) = run(4, Some(Fault::Controller(joint)), Place::Executor);
        assert!(findings.is_good(), "{name}: {findings:#?}");
    }
}

/// What the verdict is made of: each limit alone makes it bad.
#[test]
fn the_verdict_sees_each_limit() {
    let good = run(5, None, Place::Executor).0;
    assert!(good.is_good(), "{good:#?}");
    let bad = |change: fn(&mut Findings)| {
        let mut findings = good.clone();
        change(&mut findings);
        !findings.is_good()
    };
    assert!(bad(|findings| findings.steps = 0));
    assert!(bad(|findings| findings.fallen_at = Some(3.0)));
    assert!(bad(|findings| findings.capture_margin = Some(-0.001)));
    assert!(bad(|findings| findings.exchanges = 0));
    assert!(bad(|findings| findings.lost = 1));
    assert!(bad(|findings| findings.duty = 0.96));
    assert!(bad(|findings| findings.joints[3].range[1] = 130.0));
    assert!(bad(|findings| findings.stopped_at = Some(2.0)));
    assert!(bad(
        |findings| findings.faults = vec!["sensor-left-knee".into()]
    ));
}

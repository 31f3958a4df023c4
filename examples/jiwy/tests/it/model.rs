//! The complete model, on virtual time and in lock-step with the machine: calibration, following,
//! faults, and the same run twice.

use luna::prelude::*;
use luna::{End, Report};
use luna_jiwy::joystick::Recording;
use luna_jiwy::parts::sanity::Interventions;
use luna_jiwy::parts::tracking::Tracking;
use luna_jiwy::{AXES, Executors, Findings, Settings, Start, hardware, network};
use luna_plants::{Motor, MotorParameters, MotorState};
use std::sync::Arc;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

fn executors(system: &mut System) -> luna::Result<Executors> {
    Ok(Executors {
        control: system.executor("control").build()?,
        mechanism: system.executor("mechanism").build()?,
        operator: system.executor("operator").build()?,
    })
}

fn settings(cycles: u64, start: Start) -> Settings {
    Settings {
        period: PERIOD,
        cycles,
        start,
        joystick: Recording::built_in().play(),
    }
}

/// What came of a run: bits, so that runs can be compared.
#[derive(Debug, PartialEq)]
struct Outcome {
    tracking: [Option<Tracking>; 2],
    interventions: [Interventions; 2],
    states: [MotorState; 2],
}

fn outcome(findings: &[Arc<Findings>; 2], states: [MotorState; 2]) -> Outcome {
    Outcome {
        tracking: [0, 1].map(|axis| findings[axis].tracking.get().copied()),
        interventions: [0, 1].map(|axis| findings[axis].interventions()),
        states,
    }
}

/// On virtual time, with the machine's processes.
fn simulated(cycles: u64, start: Start) -> luna::Result<(Outcome, Report)> {
    let mut system = System::new("jiwy");
    system.virtual_clock();
    let executors = executors(&mut system)?;
    let machine = hardware::simulated(&mut system, &executors.mechanism, PERIOD)?;
    let findings = network::build(&executors, machine.registers, settings(cycles, start))?;
    let report = system.run()?;
    let completed =
        |process: &luna::report::ProcessReport| process.exit == Some(luna::Exit::Completed);
    assert!(report.processes.iter().all(completed), "{report}");
    let states = machine
        .states
        .map(|state| state.get().copied().expect("its process has ended"));
    Ok((outcome(&findings, states), report))
}

/// In lock-step with a machine outside; `before` may break it.
fn in_lock_step(
    cycles: u64,
    start: Start,
    before: impl FnMut(u64, &mut [hardware::Axis; 2]) + Send + 'static,
) -> (Outcome, luna::Result<Report>) {
    let mut system = System::new("jiwy");
    let (registers, simulator) = hardware::lock_step(&mut system);
    let executors = executors(&mut system).unwrap();
    let findings = network::build(&executors, registers, settings(cycles, start)).unwrap();
    let simulator = std::thread::spawn(move || simulator.run(PERIOD, before));
    let report = system.run();
    let states = simulator.join().unwrap();
    (outcome(&findings, states), report)
}

#[test]
fn all_the_thesis_processes_are_there() {
    let (_, report) = simulated(10, Start::Calibrated).unwrap();
    assert_eq!(report.processes.len(), 51);
    assert_eq!(report.end, End::Completed);
}

#[test]
fn finds_its_stops_and_follows_the_joystick() {
    let (found, _) = simulated(30_000, Start::Calibrate).unwrap();
    for (axis, tracking) in found.tracking.iter().enumerate() {
        let tracking = tracking.expect("it was calibrated in time");
        assert!(tracking.rms().to_degrees() < 1.5, "{}", AXES[axis].name);
        assert!(tracking.max().to_degrees() < 6.0, "{}", AXES[axis].name);
        assert_eq!(found.interventions[axis].not_finite, 0);
        assert_eq!(found.interventions[axis].limited, 0);
        assert_eq!(found.interventions[axis].guarded, 0);
    }
}

#[test]
fn every_run_is_the_same() {
    let (first, report) = simulated(8_000, Start::Calibrate).unwrap();
    let (second, again) = simulated(8_000, Start::Calibrate).unwrap();
    assert_eq!(first, second);
    let polls = |report: &Report| -> Vec<_> {
        let processes = report.processes.iter();
        processes
            .map(|process| (process.name.clone(), process.polls))
            .collect()
    };
    assert_eq!(polls(&report), polls(&again));
}

#[test]
fn in_lock_step_it_is_the_same_each_time_too() {
    let run = || {
        let (outcome, report) = in_lock_step(8_000, Start::Calibrate, |_, _| {});
        assert_eq!(report.unwrap().end, End::Completed);
        outcome
    };
    let first = run();
    assert!(first.tracking.iter().flatten().count() == 2, "{first:?}");
    assert_eq!(first, run());
}

/// Runs until the fault injected at the 2000th step has ended the system. Returns its message.
fn error_of(mut fault: impl FnMut(&mut hardware::Axis) + Send + 'static) -> (String, Outcome) {
    let (outcome, report) = in_lock_step(60_000, Start::Calibrated, move |step, axes| {
        if step == 2_000 {
            fault(&mut axes[0]);
        }
    });
    (report.unwrap_err().to_string(), outcome)
}

#[test]
fn a_motor_that_is_blocked_ends_the_run_with_both_motors_off() {
    let (error, outcome) = error_of(|axis| {
        let stuck = MotorParameters {
            coulomb_friction: 100.0,
            stiction: 100.0,
            ..AXES[0].plant
        };
        axis.motor = Motor::new(stuck).starting_at(MotorState {
            speed: 0.0,
            ..axis.motor.state()
        });
    });
    assert!(error.contains("pan: it was driven for"), "{error}");
    assert!(
        outcome
            .states
            .iter()
            .all(|state| state.current.abs() < 1e-3),
        "{outcome:?}"
    );
}

#[test]
fn an_encoder_that_is_dead_ends_the_run() {
    let (error, _) = error_of(|axis| axis.counts = false);
    assert!(error.contains("pan: it was driven for"), "{error}");
}

#[test]
fn an_encoder_that_jumps_ends_the_run() {
    let (error, _) = error_of(|axis| {
        let state = axis.motor.state();
        axis.motor = Motor::new(AXES[0].plant).starting_at(MotorState {
            angle: state.angle + 0.5,
            ..state
        });
    });
    assert!(error.contains("pan: its encoder measures"), "{error}");
}

#[test]
fn an_axis_that_cannot_reach_its_stop_is_not_taken_for_calibrated() {
    let (outcome, report) = in_lock_step(60_000, Start::Calibrate, |step, axes| {
        if step == 0 {
            let narrow = MotorParameters {
                end_stop: 0.3,
                ..AXES[1].plant
            };
            axes[1].motor = Motor::new(narrow);
        }
    });
    let error = report.unwrap_err().to_string();
    assert!(error.contains("tilt: the end stops are 0.6"), "{error}");
    assert_eq!(
        outcome.tracking[1].map(|tracking| tracking.max()),
        Some(0.0)
    );
}

/// A camera with gains of its pan axis changed in the middle of the run, by a set with one wrong
/// gain, and then by a correct one.
#[test]
fn gains_are_parameters_and_change_at_once() {
    let run = |set: &'static str| {
        let mut system = System::new("jiwy");
        system.virtual_clock();
        let executors = executors(&mut system).unwrap();
        let machine = hardware::simulated(&mut system, &executors.mechanism, PERIOD).unwrap();
        let settings = settings(5000, Start::Calibrated);
        let findings = network::build(&executors, machine.registers, settings).unwrap();
        let parameters = system.parameters();
        let tuner = async move {
            luna::after(PERIOD * 700).await;
            let wrong = parameters.set([("pan/kp", 1.0), ("tilt/kp", -1.0)]);
            assert!(
                wrong
                    .unwrap_err()
                    .to_string()
                    .contains("`tilt/kp` = -1.0: it must be 0.0 to 1000.0 1/rad")
            );
            if !set.is_empty() {
                assert_eq!(parameters.set_text(set)?, 1);
            }
            Ok(())
        };
        executors.operator.process("tuner").spawn(tuner).unwrap();
        drop(executors);
        system.run().unwrap();
        [0, 1].map(|axis| findings[axis].tracking.get().unwrap().rms())
    };
    let placed = run("");
    let soft = run("pan/kp=0.1,pan/ki=0");
    assert!(soft[0] > 1.2 * placed[0], "{soft:?}, {placed:?}");
    assert_eq!(soft[1], placed[1]);
}

//! What physics does not allow to be otherwise.

use super::*;
use crate::{Checked, PAN, TILT};
use proptest::prelude::*;

const AXES: [MotorParameters; 2] = [PAN, TILT];

/// An axis without stops.
fn unbounded(parameters: MotorParameters) -> Motor {
    Motor::new(MotorParameters {
        end_stop: f64::INFINITY,
        ..parameters
    })
}

#[test]
fn reaches_the_analytic_speed() {
    for p in AXES {
        for (duty, rate) in [(1.0, 100.0), (0.5, 1000.0), (-0.25, 4000.0)] {
            let mut plant = unbounded(p);
            for _ in 0..rate as usize {
                plant.drive(duty, 1.0 / rate);
            }
            // U = R i + K ω and K i = b ω + friction.
            let (k, u) = (p.joint_constant(), f64::abs(duty) * p.supply);
            let expected = (k * u / p.resistance - p.coulomb_friction)
                / (p.viscous_friction + k * k / p.resistance);
            let error = (plant.state().speed - expected * duty.signum()) / expected;
            assert!(error.abs() < 0.01, "{error} at duty {duty}, {rate} Hz");
        }
    }
}

#[test]
fn never_gains_energy_without_input() {
    for p in AXES {
        for rate in [100.0, 1000.0, 4000.0] {
            for (angle, speed, current) in [
                (0.0, 10.0, 0.0),
                (p.end_stop - 1e-3, 15.0, 2.0),
                (-p.end_stop - 0.02, -1.0, -2.0),
            ] {
                let mut plant = Motor::new(p);
                plant.state = MotorState {
                    angle,
                    speed,
                    current,
                };
                let mut energy = plant.energy();
                let c = plant.coefficients(MAX_SUB_STEP);
                for _ in 0..20_000 {
                    plant.sub_step(0.0, &c);
                    assert!(
                        plant.energy() <= energy * (1.0 + 1e-12),
                        "{rate} Hz: {} J after {energy} J",
                        plant.energy()
                    );
                    energy = plant.energy();
                }
                plant.drive(0.0, 1.0 / rate);
                assert_eq!(plant.state().speed, 0.0);
            }
        }
    }
}

#[test]
fn rests_at_rest_below_breakaway_and_moves_above() {
    for p in AXES {
        let breakaway = p.stiction / p.stall_torque();
        let mut plant = Motor::new(p);
        plant.state.angle = 0.123;
        for n in 0..1000 {
            // A load that changes sign each millisecond, which makes smoothed friction laws creep
            // or chatter.
            plant.drive(if n % 2 == 0 { 0.99 } else { -0.99 } * breakaway, 1e-3);
            assert_eq!((plant.state().angle, plant.state().speed), (0.123, 0.0));
        }
        plant.drive(1.01 * breakaway, 0.1);
        assert!(plant.state().speed > 0.0);
        // Once loose it keeps moving under a load that could not have moved it from rest.
        plant.drive(0.9 * breakaway, 0.1);
        assert!(plant.state().speed > 0.0);
    }
}

#[test]
fn stops_in_finite_time_and_stays() {
    for p in AXES {
        let mut plant = Motor::new(p);
        plant.state.speed = 1.0;
        plant.drive(0.0, 0.5);
        let at = plant.state();
        assert_eq!(at.speed, 0.0);
        plant.drive(0.0, 10.0);
        assert_eq!(plant.state().angle, at.angle);
    }
}

#[test]
fn end_stop_holds_at_full_duty() {
    for p in AXES {
        for (duty, rate) in [(1.0, 1000.0), (-1.0, 100.0), (1.0, 4000.0)] {
            let mut plant = Motor::new(p);
            let mut deepest = 0.0_f64;
            for _ in 0..(2.0 * rate) as usize {
                plant.drive(duty, 1.0 / rate);
                deepest = deepest.max(plant.state().angle.abs() - p.end_stop);
            }
            // Hit at full speed from the middle: within 4 degrees. Then held: within the motor's
            // compression and the friction.
            assert!(deepest < 0.07, "{deepest} rad into the stop");
            let held = plant.state().angle.abs() - p.end_stop;
            assert_eq!(plant.state().speed, 0.0);
            let bound = (p.stall_torque() + p.stiction) / p.stop_stiffness;
            assert!((0.0..=bound).contains(&held), "{held} rad");
        }
    }
}

#[test]
fn end_stop_springs_back() {
    let mut plant = Motor::new(PAN);
    plant.state.angle = PAN.end_stop + 0.05;
    plant.drive(0.0, 1.0);
    assert!(plant.state().angle < PAN.end_stop);
}

#[test]
fn halving_the_step_changes_little() {
    for p in AXES {
        let run = |sub_step: f64| {
            let mut plant = Motor::new(p);
            let mut path = Vec::new();
            for n in 0..2000 {
                // Into the stop and back, with reversals.
                let duty = 0.8 * (n as f64 * 1e-3 * 4.0).sin();
                plant.drive_by(plant.voltage(duty), 1e-3, sub_step);
                path.push(plant.state().angle);
            }
            path
        };
        let apart = run(MAX_SUB_STEP)
            .iter()
            .zip(run(MAX_SUB_STEP / 2.0))
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(apart < 2e-3, "{apart} rad apart");
    }
}

/// Compared with sub-steps 64 times as fine, exact steps are nearer than sub-steps alone, and
/// within 150 µrad, some three counts of the encoder.
#[test]
fn steps_at_once_are_as_good_as_sub_steps() {
    for p in AXES {
        let farthest = |drive: fn(&mut Motor, f64)| {
            let (mut motor, mut reference) = (Motor::new(p), Motor::new(p));
            let apart = (0..2000).map(|n| {
                // Reversals, some of them small enough to stick in, and once into a stop.
                let time = f64::from(n) * 1e-3;
                let duty = 0.3 * (time * 9.0).sin() + 0.25 * (time * 31.0).cos() + 0.1;
                drive(&mut motor, duty);
                reference.drive_by(reference.voltage(duty), 1e-3, MAX_SUB_STEP / 64.0);
                (motor.state().angle - reference.state().angle).abs()
            });
            apart.fold(0.0, f64::max)
        };
        let by_sub_steps =
            farthest(|motor, duty| motor.drive_by(motor.voltage(duty), 1e-3, MAX_SUB_STEP));
        let at_once = farthest(|motor, duty| motor.drive(duty, 1e-3));
        assert!(at_once < 150e-6, "{at_once} rad, {by_sub_steps} rad");
        assert!(at_once < by_sub_steps, "{at_once} rad, {by_sub_steps} rad");
    }
}

#[test]
fn rate_of_the_caller_does_not_matter() {
    for p in AXES {
        let run = |rate: usize| {
            let mut plant = Motor::new(p);
            for n in 0..rate {
                let duty = if 2 * n < rate { 0.3 } else { -0.2 };
                plant.drive(duty, 1.0 / rate as f64);
            }
            plant.state().angle
        };
        for rate in [100, 250, 730, 1500, 4000] {
            assert!(
                (run(rate) - run(1000)).abs() < 2e-3,
                "{rate} Hz: {} against {}",
                run(rate),
                run(1000)
            );
        }
    }
}

#[test]
fn odd_inputs_do_nothing() {
    let mut plant = Motor::new(PAN);
    plant.drive(f64::NAN, 0.1);
    plant.drive(1.0, 0.0);
    plant.drive(1.0, -1.0);
    plant.drive(1.0, f64::NAN);
    assert_eq!(plant.state(), MotorState::default());
    plant.drive(f64::INFINITY, 0.01);
    let mut full = Motor::new(PAN);
    full.drive(1.0, 0.01);
    assert_eq!(plant.state(), full.state());
}

#[test]
fn without_friction_and_inductance_the_speed_follows_the_exponential() {
    let p = MotorParameters {
        inductance: 0.0,
        viscous_friction: 0.0,
        coulomb_friction: 0.0,
        stiction: 0.0,
        end_stop: f64::INFINITY,
        ..PAN
    };
    let time_constant = p.inertia() * p.resistance / (p.joint_constant() * p.joint_constant());
    let final_speed = p.supply / p.joint_constant();
    let mut motor = Motor::new(p);
    for n in 1..200 {
        motor.drive(1.0, 1e-3);
        // Without inductance there are sub-steps alone.
        let expected = final_speed * (1.0 - (-f64::from(n) * 1e-3 / time_constant).exp());
        let error = motor.state().speed - expected;
        // First order: half a sub-step by the time constant.
        assert!(
            error.abs() < final_speed * MAX_SUB_STEP / time_constant,
            "{error} at {n} ms"
        );
    }
}

#[test]
fn the_bridge_limits_current_and_torque() {
    let limited = |limit: f64| {
        Motor::new(MotorParameters {
            current_limit: limit,
            ..PAN
        })
    };
    // The limit's torque is below what breaks it loose, or above.
    let breakaway = PAN.stiction / PAN.joint_constant();
    let mut held = limited(0.99 * breakaway);
    held.drive(1.0, 1.0);
    assert_eq!(held.state().speed, 0.0);
    assert_eq!(held.state().current, 0.99 * breakaway);
    let mut moving = limited(1.01 * breakaway);
    moving.drive(1.0, 0.01);
    assert!(moving.state().speed > 0.0);
    // At the limit the acceleration is constant: J dω/dt = K i − b ω − friction.
    let mut motor = limited(0.5);
    let mut last = 0.0;
    for _ in 0..10 {
        motor.drive(1.0, 1e-3);
        assert!(motor.state().current <= 0.5);
        let s = motor.state();
        if s.current == 0.5 && last > 0.0 {
            let torque = PAN.joint_constant() * 0.5
                - PAN.coulomb_friction
                - PAN.viscous_friction * (s.speed + last) / 2.0;
            let expected = torque / PAN.inertia() * 1e-3;
            assert!(((s.speed - last) / expected - 1.0).abs() < 1e-3);
        }
        last = s.speed;
    }
}

proptest! {
    #![proptest_config(crate::seeded())]

    #[test]
    fn energy_never_grows_without_input_whatever_the_motor(
        inductance in 0.0..1e-2f64, resistance in 0.1..20.0f64, constant in 0.0..0.1f64, gear in 1.0..200.0f64,
        inertia in 1e-6..1e-2f64, viscous in 0.0..1e-2f64, coulomb in 0.0..0.2f64, stiffness in 0.0..1e4f64, damping in 0.0..5.0f64,
        limit in 0.05..10.0f64, angle in -2.0..2.0f64, speed in -50.0..50.0f64, current in -1.0..1.0f64,
    ) {
        let parameters = MotorParameters {
            inductance, resistance, torque_constant: constant, gear_ratio: gear, load_inertia: inertia,
            viscous_friction: viscous, coulomb_friction: coulomb, stiction: 1.3 * coulomb,
            stop_stiffness: stiffness, stop_damping: damping, current_limit: limit, ..PAN
        };
        let current = current.clamp(-limit, limit);
        let mut motor = Motor::new(parameters).starting_at(MotorState { angle, speed, current });
        let c = motor.coefficients(MAX_SUB_STEP);
        let mut energy = motor.energy();
        for _ in 0..400 {
            motor.sub_step(0.0, &c);
            prop_assert!(motor.energy() <= energy * (1.0 + 1e-9) + 1e-18, "{} J after {energy} J", motor.energy());
            energy = motor.energy();
        }
    }

    #[test]
    fn a_plant_of_any_duty_and_time_has_finite_outputs(
        steps in prop::collection::vec((prop::num::f64::NORMAL | prop::num::f64::INFINITE, 1u64..50_000), 1..20)
    ) {
        let mut motor = Checked::new(Motor::new(MotorParameters { current_limit: 1.5, ..TILT }));
        for (duty, time) in steps {
            motor.set("duty", duty).unwrap();
            motor.step(Duration::from_micros(time)).unwrap();
            prop_assert!(motor.outputs().unwrap().iter().all(|value| value.is_finite()));
            prop_assert!(motor.get("current").unwrap().abs() <= 1.5);
        }
    }
}

#[test]
fn a_plants_step_has_an_end() {
    for step in [Duration::ZERO, LONGEST_STEP + Duration::from_nanos(1)] {
        let mut motor = Checked::new(Motor::new(PAN));
        let error = motor.step(step);
        assert_eq!(
            error,
            Err(PlantError::Step {
                step,
                longest: LONGEST_STEP
            })
        );
    }
}

//! What physics does not allow to be otherwise.

use super::*;

const AXES: [Parameters; 2] = [PAN, TILT];

/// An axis whose stops are out of the way.
fn unbounded(parameters: Parameters) -> Plant {
    Plant::new(Parameters {
        end_stop: 1e9,
        ..parameters
    })
}

#[test]
fn reaches_the_analytic_speed() {
    for p in AXES {
        for (duty, rate) in [(1.0, 100.0), (0.5, 1000.0), (-0.25, 4000.0)] {
            let mut plant = unbounded(p);
            for _ in 0..rate as usize {
                plant.step(duty, 1.0 / rate);
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
                let mut plant = Plant::new(p);
                plant.state = State {
                    angle,
                    speed,
                    current,
                };
                let mut energy = plant.energy();
                for _ in 0..20_000 {
                    plant.sub_step(0.0, MAX_SUB_STEP);
                    assert!(
                        plant.energy() <= energy * (1.0 + 1e-12),
                        "{rate} Hz: {} J after {energy} J",
                        plant.energy()
                    );
                    energy = plant.energy();
                }
                plant.step(0.0, 1.0 / rate);
                assert_eq!(plant.state().speed, 0.0);
            }
        }
    }
}

#[test]
fn rests_at_rest_below_breakaway_and_moves_above() {
    for p in AXES {
        let breakaway = p.stiction / p.stall_torque();
        let mut plant = Plant::new(p);
        plant.state.angle = 0.123;
        for n in 0..1000 {
            // A load that changes sign each millisecond: what makes smoothed friction laws creep or chatter.
            plant.step(if n % 2 == 0 { 0.99 } else { -0.99 } * breakaway, 1e-3);
            assert_eq!((plant.state().angle, plant.state().speed), (0.123, 0.0));
        }
        plant.step(1.01 * breakaway, 0.1);
        assert!(plant.state().speed > 0.0);
        // Once loose it keeps moving under what could not have moved it from rest.
        plant.step(0.9 * breakaway, 0.1);
        assert!(plant.state().speed > 0.0);
    }
}

#[test]
fn stops_in_finite_time_and_stays() {
    for p in AXES {
        let mut plant = Plant::new(p);
        plant.state.speed = 1.0;
        plant.step(0.0, 0.5);
        let at = plant.state();
        assert_eq!(at.speed, 0.0);
        plant.step(0.0, 10.0);
        assert_eq!(plant.state().angle, at.angle);
    }
}

#[test]
fn end_stop_holds_at_full_duty() {
    for p in AXES {
        for (duty, rate) in [(1.0, 1000.0), (-1.0, 100.0), (1.0, 4000.0)] {
            let mut plant = Plant::new(p);
            let mut deepest = 0.0_f64;
            for _ in 0..(2.0 * rate) as usize {
                plant.step(duty, 1.0 / rate);
                deepest = deepest.max(plant.state().angle.abs() - p.end_stop);
            }
            // Hit at full speed from the middle: within 4 degrees. Then held: within what the motor compresses and friction keeps.
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
    let mut plant = Plant::new(PAN);
    plant.state.angle = PAN.end_stop + 0.05;
    plant.step(0.0, 1.0);
    assert!(plant.state().angle < PAN.end_stop);
}

#[test]
fn halving_the_step_changes_little() {
    for p in AXES {
        let run = |sub_step: f64| {
            let mut plant = Plant::new(p);
            let mut path = Vec::new();
            for n in 0..2000 {
                // Into the stop and back, with reversals.
                let duty = 0.8 * (n as f64 * 1e-3 * 4.0).sin();
                plant.step_by(duty, 1e-3, sub_step);
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

#[test]
fn rate_of_the_caller_does_not_matter() {
    for p in AXES {
        let run = |rate: usize| {
            let mut plant = Plant::new(p);
            for n in 0..rate {
                let duty = if 2 * n < rate { 0.3 } else { -0.2 };
                plant.step(duty, 1.0 / rate as f64);
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
    let mut plant = Plant::new(PAN);
    plant.step(f64::NAN, 0.1);
    plant.step(1.0, 0.0);
    plant.step(1.0, -1.0);
    plant.step(1.0, f64::NAN);
    assert_eq!(plant.state(), State::default());
    plant.step(f64::INFINITY, 0.01);
    let mut full = Plant::new(PAN);
    full.step(1.0, 0.01);
    assert_eq!(plant.state(), full.state());
}

//! Jiwy without its processes: joystick, set-points, controllers, safety layer, mechanism.

use super::pid::{Gains, Pid};
use super::sanity::Interventions;
use super::set_point::SetPoint;
use super::tracking::Tracking;
use crate::joystick::Recording;
use crate::{AXES, Axis};
use luna_plants::Motor;
use luna_plants::{Decoder, Encoder};
use std::time::Duration;

/// Plays the built-in recording once; a duty reaches the motor one sample after its measurement.
fn play(axis: &Axis, rate: f64) -> (Tracking, Interventions) {
    let recording = Recording::built_in();
    let cycles = (recording.length() * rate) as u32;
    let (mut playback, sample_time) = (recording.play(), 1.0 / rate);
    let gear = axis.plant.gear_ratio;
    let encoder = Encoder::new(gear, axis.count_at_zero);
    let mut decoder = Decoder::new(gear, axis.count_at_zero);
    let mut plant = Motor::new(axis.plant);
    let mut set_point = SetPoint::new(axis.max_speed);
    let mut pid = Pid::new(Gains::place(&axis.plant, axis.tuning, sample_time));
    let mut limit = axis.limits.limit().unwrap();
    let mut slew = axis.limits.slew().unwrap();
    let mut guard = axis.limits.guard().unwrap();
    let period = Duration::from_secs_f64(sample_time);
    let (mut tracking, mut duty) = (Tracking::default(), 0.0);
    for n in 0..cycles {
        // The joystick is read at 100 Hz, whatever the rate of control.
        let read_at = (f64::from(n) * sample_time * 100.0 + 1e-6).floor() / 100.0;
        let wanted = axis.range * (axis.stick)(playback.at(read_at));
        let target = set_point.follow(wanted, sample_time);
        let angle = decoder.angle(encoder.count(plant.state().angle));
        tracking.add(target - angle);
        let asked = limit.check(pid.update(target, angle, sample_time), angle, period);
        let next = guard.check(slew.check(asked, angle, period), angle, period);
        plant.drive(std::mem::replace(&mut duty, next), sample_time);
    }
    let interventions = Interventions {
        not_finite: limit.not_finite,
        limited: limit.changed,
        slewed: slew.changed,
        guarded: guard.changed,
    };
    (tracking, interventions)
}

#[test]
fn follows_the_recording() {
    for axis in &AXES {
        for (rate, rms, max) in [
            (100.0, 12.0, 30.0),
            (500.0, 1.5, 6.0),
            (1000.0, 1.5, 6.0),
            (4000.0, 1.5, 6.0),
        ] {
            let (tracking, sanity) = play(axis, rate);
            println!(
                "{} at {rate} Hz: rms {:.2}, max {:.2} degrees; {sanity:?}",
                axis.name,
                tracking.rms().to_degrees(),
                tracking.max().to_degrees()
            );
            assert!(
                tracking.rms().to_degrees() < rms,
                "{} at {rate} Hz",
                axis.name
            );
            assert!(
                tracking.max().to_degrees() < max,
                "{} at {rate} Hz",
                axis.name
            );
            // With a working controller the safety layer never intervenes, except for its slew
            // limit.
            assert_eq!(
                Interventions {
                    slewed: 0,
                    ..sanity
                },
                Interventions::default()
            );
        }
    }
}

#[test]
fn set_points_stay_off_the_guard_and_the_guard_off_the_stop() {
    for axis in &AXES {
        assert!(axis.range < axis.limits.guard);
        assert!(axis.limits.guard < axis.plant.end_stop);
        assert!(axis.tuning.limit <= axis.limits.duty && axis.limits.duty <= 1.0);
        assert!(axis.plant.coulomb_friction <= axis.plant.stiction);
    }
}

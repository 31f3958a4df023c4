//! The controller of one axis: a discrete PID.

use luna_plants::MotorParameters;

/// The tuning of a controller, in continuous time: the sample time comes with each update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Duty by error, in 1/rad.
    pub proportional: f64,
    /// Duty by the error's integral, in 1/(rad·s).
    pub integral: f64,
    /// Duty by the measured speed, in s/rad.
    pub derivative: f64,
    /// The time constant of the filter on the measured speed, in s.
    pub filter: f64,
    /// The output stays within plus and minus this duty.
    pub limit: f64,
}

/// The requirements for an axis at high rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tuning {
    /// The natural frequency of the closed loop, in rad/s.
    pub bandwidth: f64,
    /// The output stays within plus and minus this duty.
    pub limit: f64,
}

/// Damping of the closed loop: no overshoot with some margin for the delay of sampling.
const DAMPING: f64 = 1.0;
/// The loop's bandwidth times the sample time stays below this: two samples of delay then cost at
/// most 23 degrees of phase.
const BANDWIDTH_BY_SAMPLE_TIME: f64 = 0.2;
/// The integral acts this much slower than the loop, so that it removes friction's offset without
/// affecting the dynamics.
const INTEGRAL_BY_BANDWIDTH: f64 = 0.1;
/// The speed's filter is this much faster than the loop.
const FILTER_BY_BANDWIDTH: f64 = 6.0;

impl Gains {
    /// Gains for an axis sampled each `sample_time` seconds.
    ///
    /// Pole placement on the axis without its armature's time constant: `T θ'' + θ' = G duty`, with
    /// the mechanical time constant `T = J R / K²` and the speed at full duty `G = supply / K`.
    /// Slow sampling lowers the bandwidth.
    pub fn place(axis: &MotorParameters, tuning: Tuning, sample_time: f64) -> Self {
        let k = axis.joint_constant();
        let time_constant = axis.inertia() * axis.resistance / (k * k);
        let speed = axis.supply / k;
        let bandwidth = tuning.bandwidth.min(BANDWIDTH_BY_SAMPLE_TIME / sample_time);
        let proportional = bandwidth * bandwidth * time_constant / speed;
        Self {
            proportional,
            integral: proportional * bandwidth * INTEGRAL_BY_BANDWIDTH,
            // The motor's own back-EMF damps a slow loop enough.
            derivative: ((2.0 * DAMPING * bandwidth * time_constant - 1.0) / speed).max(0.0),
            filter: 1.0 / (bandwidth * FILTER_BY_BANDWIDTH),
            limit: tuning.limit,
        }
    }
}

/// A PID with its state.
///
/// The derivative acts on the filtered measurement, so a step of the set-point causes no kick. The
/// integral does not grow while the output is at its limit in the error's direction, nor beyond the
/// output's range.
#[derive(Debug, Clone)]
pub struct Pid {
    gains: Gains,
    integral: f64,
    speed: f64,
    last: Option<f64>,
}

impl Pid {
    /// A controller at rest.
    pub fn new(gains: Gains) -> Self {
        Self {
            gains,
            integral: 0.0,
            speed: 0.0,
            last: None,
        }
    }

    /// Changes the gains. The integral is kept as a duty, so another integral gain causes no step.
    pub fn set_gains(&mut self, gains: Gains) {
        self.gains = gains;
    }

    /// The duty for a measurement taken `sample_time` seconds after the one before. O(1); allocates
    /// nothing.
    ///
    /// A sample time that is not positive leaves integral and speed as they are.
    pub fn update(&mut self, set_point: f64, measured: f64, sample_time: f64) -> f64 {
        let gains = self.gains;
        let error = set_point - measured;
        if sample_time > 0.0 {
            let last = self.last.replace(measured).unwrap_or(measured);
            let raw = (measured - last) / sample_time;
            self.speed += (raw - self.speed) * sample_time / (gains.filter + sample_time);
        }
        let rest = gains.proportional * error - gains.derivative * self.speed;
        if sample_time > 0.0 {
            let grown = self.integral + gains.integral * error * sample_time;
            let winds_up = (rest + grown).abs() > gains.limit && (rest + grown) * error > 0.0;
            if !winds_up {
                self.integral = grown.clamp(-gains.limit, gains.limit);
            }
        }
        (rest + self.integral).clamp(-gains.limit, gains.limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AXES, Axis};
    use luna_plants::Motor;
    use luna_plants::{Decoder, Encoder};

    /// A loop of plant, encoder and controller, with a sample of delay as between separate
    /// processes.
    struct Loop {
        plant: Motor,
        encoder: Encoder,
        decoder: Decoder,
        pid: Pid,
        duty: f64,
        sample_time: f64,
    }

    impl Loop {
        fn new(axis: &Axis, rate: f64) -> Self {
            let gear = axis.plant.gear_ratio;
            Self {
                plant: Motor::new(axis.plant),
                encoder: Encoder::new(gear, axis.count_at_zero),
                decoder: Decoder::new(gear, axis.count_at_zero),
                pid: Pid::new(Gains::place(&axis.plant, axis.tuning, 1.0 / rate)),
                duty: 0.0,
                sample_time: 1.0 / rate,
            }
        }

        fn cycle(&mut self, set_point: f64) -> f64 {
            let measured = self
                .decoder
                .angle(self.encoder.count(self.plant.state().angle));
            let next = self.pid.update(set_point, measured, self.sample_time);
            // The duty of this sample reaches the motor one sample later.
            self.plant
                .drive(std::mem::replace(&mut self.duty, next), self.sample_time);
            self.plant.state().angle
        }
    }

    const RATES: [f64; 6] = [100.0, 200.0, 500.0, 1000.0, 2000.0, 4000.0];

    #[test]
    fn step_settles_with_little_overshoot() {
        for axis in &AXES {
            for rate in RATES {
                for target in [0.05, 0.3, -0.3] {
                    let mut control = Loop::new(axis, rate);
                    let path: Vec<f64> = (0..(2.0 * rate) as usize)
                        .map(|_| control.cycle(target))
                        .collect();
                    let peak = path.iter().map(|angle| angle / target).fold(0.0, f64::max);
                    let late = path[path.len() / 2..]
                        .iter()
                        .map(|angle| (angle - target).abs())
                        .fold(0.0, f64::max);
                    assert!(
                        peak < 1.10,
                        "{} at {rate} Hz: overshoot to {peak}",
                        axis.name
                    );
                    // During the second second. The slow loop at 100 Hz is still compensating
                    // friction by then.
                    let allowed = if rate > 100.0 { 0.25 } else { 1.25 };
                    assert!(
                        late.to_degrees() < allowed,
                        "{} at {rate} Hz: {late} rad off",
                        axis.name
                    );
                }
            }
        }
    }

    #[test]
    fn no_windup_at_an_end_stop() {
        for axis in &AXES {
            let mut control = Loop::new(axis, 1000.0);
            // Ten seconds against the stop, then back to a set-point that a controller without
            // windup reaches at once.
            for _ in 0..10_000 {
                control.cycle(axis.plant.end_stop + 0.3);
            }
            assert!(control.pid.integral.abs() <= axis.tuning.limit);
            let back = axis.plant.end_stop - 0.2;
            for _ in 0..500 {
                control.cycle(back);
            }
            let error = control.plant.state().angle - back;
            assert!(
                error.abs() < 0.01,
                "{}: {error} rad off half a second later",
                axis.name
            );
        }
    }

    #[test]
    fn output_stays_within_its_limit() {
        let axis = &AXES[0];
        let mut pid = Pid::new(Gains::place(&axis.plant, axis.tuning, 1e-3));
        for n in 0..1000 {
            let duty = pid.update(100.0, f64::from(n % 7), 1e-3);
            assert!(duty.abs() <= axis.tuning.limit);
        }
    }

    #[test]
    fn set_point_step_gives_no_derivative_kick() {
        let gains = Gains {
            proportional: 1.0,
            integral: 0.0,
            derivative: 1.0,
            filter: 1e-3,
            limit: 10.0,
        };
        let mut pid = Pid::new(gains);
        pid.update(0.0, 0.0, 1e-3);
        assert_eq!(pid.update(1.0, 0.0, 1e-3), 1.0);
    }

    #[test]
    fn derivative_is_that_of_the_measurement() {
        let gains = Gains {
            proportional: 0.0,
            integral: 0.0,
            derivative: 0.5,
            filter: 2e-3,
            limit: 10.0,
        };
        for sample_time in [2.5e-4, 1e-3, 1e-2] {
            let mut pid = Pid::new(gains);
            // A ramp of 3 rad/s, for fifty time constants of the filter.
            let samples = (0.1 / sample_time) as i32 + 50;
            let duty = (0..samples)
                .map(|n| pid.update(0.0, 3.0 * f64::from(n) * sample_time, sample_time))
                .last()
                .unwrap();
            assert!((duty + 1.5).abs() < 1e-6, "{duty} at {sample_time} s");
        }
    }

    #[test]
    fn integral_does_not_depend_on_the_sample_time() {
        let gains = Gains {
            proportional: 0.0,
            integral: 2.0,
            derivative: 0.0,
            filter: 1e-3,
            limit: 10.0,
        };
        for samples in [100, 1000, 4000] {
            let mut pid = Pid::new(gains);
            let duty = (0..samples)
                .map(|_| pid.update(1.0, 0.0, 1.0 / f64::from(samples)))
                .last()
                .unwrap();
            assert!((duty - 2.0).abs() < 1e-9);
        }
    }

    #[test]
    fn no_time_changes_nothing() {
        let axis = &AXES[0];
        let mut pid = Pid::new(Gains::place(&axis.plant, axis.tuning, 1e-3));
        pid.update(0.01, 0.0, 1e-3);
        let before = (pid.integral, pid.speed);
        pid.update(0.01, 1.0, 0.0);
        assert_eq!((pid.integral, pid.speed), before);
    }
}

//! The rules of the safety layer. Every signal between the controllers and the hardware passes it.
//!
//! 1. A duty is limited, changes at a limited rate, and does not push an axis beyond its guard.
//! 2. An encoder's reading that cannot be, a speed that no motor has, an axis that is driven while
//!    its sensor stands, or controllers that are silent, *stop* the head: all motors are off, until
//!    the end of the run.

use crate::messages::{Drive, EXPOSURES, Exposure, Readings, Seen};
use crate::parameters::{AXES, Axis, DRIVEN, DUTY_LIMIT, DUTY_RATE, HEAD, MOVED, PERIOD, SILENT};
use luna_plants::Decoder;
use luna_safety_blocks::{
    Blocked, Chain, EndStop, Limit, MaxRate, Range, RateLimit, Reaction, Sample, SettingError,
};

/// The safety of one axis.
#[derive(Debug)]
struct AxisSafety {
    decoder: Decoder,
    sensor: Chain,
    output: Chain,
    angle: f64,
}

impl AxisSafety {
    fn new(axis: &Axis) -> Result<Self, SettingError> {
        let motor = &axis.motor;
        let fastest = 1.2 * motor.supply / motor.joint_constant();
        // A stop gives way a little.
        let furthest = motor.end_stop + 0.1;
        let sensor = Chain::new(0.0)?
            .then(
                "range",
                Range::new(-furthest, furthest)?,
                Reaction::Emergency,
            )?
            .then("speed", MaxRate::new(fastest)?, Reaction::Emergency)?;
        let output = Chain::new(0.0)?
            .then(
                "limit",
                Limit::new(-DUTY_LIMIT, DUTY_LIMIT)?,
                Reaction::Warn,
            )?
            .then(
                "rate",
                RateLimit::new(DUTY_RATE)?.free_to(0.0)?,
                Reaction::Warn,
            )?
            .then(
                "guard",
                EndStop::new(-axis.guard, axis.guard)?,
                Reaction::Warn,
            )?
            .then(
                "motion",
                Blocked::new(DRIVEN, MOVED, axis.stuck_after)?,
                Reaction::Emergency,
            )?;
        Ok(Self {
            decoder: Decoder::new(motor.gear_ratio, 0),
            sensor,
            output,
            angle: 0.0,
        })
    }
}

/// The safety layer, without its channels. All its functions are for the real-time path: O(axes),
/// no allocation.
#[derive(Debug)]
pub struct Safety {
    axes: [AxisSafety; AXES],
    seen: Seen,
    /// Readings since the last duties.
    silent: u32,
    is_stopped: bool,
    changed: u64,
}

impl Safety {
    /// Of the whole head.
    ///
    /// # Errors
    ///
    /// None with the figures of [`parameters`](crate::parameters).
    pub fn new() -> Result<Self, SettingError> {
        let mut axes = Vec::with_capacity(AXES);
        for axis in &HEAD {
            axes.push(AxisSafety::new(axis)?);
        }
        Ok(Self {
            axes: axes.try_into().expect("as many as there are axes"),
            seen: Seen::default(),
            silent: 0,
            is_stopped: false,
            changed: 0,
        })
    }

    /// The readings of a cycle. Returns what the controllers see. More than [`SILENT`] readings
    /// without duties between them stop the head.
    pub fn readings(&mut self, readings: &Readings) -> Seen {
        self.seen.time = readings.time;
        self.silent += 1;
        self.is_stopped |= self.silent > SILENT;
        for (n, axis) in self.axes.iter_mut().enumerate() {
            let sample = Sample::new(axis.decoder.angle(readings.counts[n]), PERIOD);
            let stops = &mut self.is_stopped;
            let angle = axis
                .sensor
                .step(&sample, |alarm| *stops |= is_stop(alarm.reaction));
            // Of a sensor that reads what cannot be, the last good reading stays.
            if !*stops {
                axis.angle = angle;
            }
            self.seen.angles[n] = axis.angle;
        }
        let place = &mut self.seen.exposures[readings.image as usize % EXPOSURES];
        if place.image != readings.image {
            *place = Exposure {
                image: readings.image,
                time: readings.time,
                angles: self.seen.angles,
            };
        }
        self.seen
    }

    /// The controllers' duties. Returns what the motors get.
    pub fn duties(&mut self, duties: &[f64; AXES]) -> Drive {
        self.silent = 0;
        let mut drive = Drive::default();
        for (n, axis) in self.axes.iter_mut().enumerate() {
            let sample = Sample::new(duties[n], PERIOD).beside(axis.angle);
            let stops = &mut self.is_stopped;
            drive.duties[n] = axis
                .output
                .step(&sample, |alarm| *stops |= is_stop(alarm.reaction));
            let is_changed = !*stops && drive.duties[n] != duties[n];
            self.changed += u64::from(is_changed);
        }
        drive.is_stopped = self.is_stopped;
        if drive.is_stopped {
            drive.duties = [0.0; AXES];
        }
        drive
    }

    /// Whether it has stopped the head: all motors are to be off.
    pub fn is_stopped(&self) -> bool {
        self.is_stopped
    }

    /// How many duties it has changed.
    pub fn changed(&self) -> u64 {
        self.changed
    }
}

fn is_stop(reaction: Reaction) -> bool {
    reaction == Reaction::Emergency
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_plants::Encoder;

    /// Readings with the axis `moved` at `angle`.
    fn readings(moved: usize, angle: f64) -> Readings {
        let mut readings = Readings::default();
        readings.counts[moved] = Encoder::new(HEAD[moved].motor.gear_ratio, 0).count(angle);
        readings
    }

    #[test]
    fn duties_are_limited_in_size_and_rate() {
        let mut safety = Safety::new().unwrap();
        safety.readings(&Readings::default());
        let first = safety.duties(&[5.0; AXES]).duties[0];
        assert!((first - DUTY_RATE * 1e-3).abs() < 1e-12, "{first}");
        for _ in 0..10 {
            assert!(safety.duties(&[5.0; AXES]).duties[0] <= DUTY_LIMIT);
        }
        assert!(safety.changed() >= 11);
        assert_eq!(safety.duties(&[f64::NAN; AXES]).duties, [0.0; AXES]);
    }

    #[test]
    fn no_motor_pushes_beyond_the_guard() {
        let mut safety = Safety::new().unwrap();
        // Not in one cycle: that would be too fast to be true.
        for step in 0..=100 {
            safety.readings(&readings(
                0,
                (HEAD[0].guard + 0.01) * f64::from(step) / 100.0,
            ));
            safety.duties(&[0.0; AXES]);
        }
        assert_eq!(safety.duties(&[0.1; AXES]).duties[0], 0.0);
        assert!(safety.duties(&[-0.1; AXES]).duties[0] < 0.0);
    }

    #[test]
    fn a_reading_that_jumps_stops_all_axes_for_good() {
        let mut safety = Safety::new().unwrap();
        safety.readings(&Readings::default());
        safety.readings(&readings(3, 0.3));
        assert!(safety.is_stopped(), "it is known before the next duties");
        for _ in 0..3 {
            let drive = safety.duties(&[0.1; AXES]);
            assert!(drive.is_stopped);
            assert_eq!(drive.duties, [0.0; AXES]);
            safety.readings(&Readings::default());
        }
    }

    #[test]
    fn controllers_that_are_silent_stop_the_head() {
        let mut safety = Safety::new().unwrap();
        for _ in 0..2 {
            for _ in 0..SILENT {
                safety.readings(&Readings::default());
                assert!(!safety.is_stopped());
            }
            assert!(!safety.duties(&[0.0; AXES]).is_stopped);
        }
        for _ in 0..=SILENT {
            safety.readings(&Readings::default());
        }
        assert!(safety.is_stopped());
        assert!(safety.duties(&[0.0; AXES]).is_stopped);
    }

    #[test]
    fn a_driven_axis_whose_sensor_stands_stops_the_head() {
        let mut safety = Safety::new().unwrap();
        let mut duties = [0.0; AXES];
        duties[1] = 0.3;
        let cycles = (0..500).find(|_| {
            safety.readings(&Readings::default());
            safety.duties(&duties).is_stopped
        });
        let cycles = cycles.expect("it is found");
        assert!((70..90).contains(&cycles), "{cycles}");
    }

    #[test]
    fn exposures_keep_where_the_head_was() {
        let mut safety = Safety::new().unwrap();
        let mut seen = Seen::default();
        for cycle in 0..90 {
            let image = 1 + cycle / 33;
            let time = f64::from(cycle) * 1e-3;
            let readings = Readings {
                image,
                time,
                ..readings(0, time)
            };
            seen = safety.readings(&readings);
            safety.duties(&[0.0; AXES]);
        }
        for (image, time) in [(1, 0.0), (2, 0.033), (3, 0.066)] {
            let exposure = seen.exposures[image];
            assert_eq!((exposure.image, exposure.time), (image as u32, time));
            assert!((exposure.angles[0] - time).abs() < 1e-4);
        }
    }
}

//! The rules of the safety module, the last before the actuators. Every signal to them passes it.
//!
//! 1. A duty is limited, changes at a limited rate, and does not push a joint beyond its guard.
//! 2. An encoder's reading that cannot be, a speed that no motor has, a joint that is driven while
//!    its sensor stands, one that is far from its set-point, or controllers that are silent, *stop*
//!    the robot: all motors are off, until the end of the run.

use crate::messages::{Command, Drive, Readings, Seen};
use crate::parameters::{
    ASTRAY_AFTER, DRIVEN, DUTY_LIMIT, DUTY_RATE, FOLLOWS, JOINTS, Joint, MOVED, PERIOD, ROBOT,
    SILENT, STUCK_AFTER,
};
use luna_plants::Decoder;
use luna_safety_blocks::{
    Block, Blocked, Chain, Disagreement, EndStop, Limit, MaxRate, Range, RateLimit, Reaction,
    Sample, SettingError,
};

/// Of one joint. Its angle counts from its middle.
#[derive(Debug)]
struct JointSafety {
    decoder: Decoder,
    sensor: Chain,
    output: Chain,
    follows: Disagreement,
    middle: f64,
    angle: f64,
}

impl JointSafety {
    fn new(joint: &Joint) -> Result<Self, SettingError> {
        let motor = &joint.motor;
        let stop = Reaction::Emergency;
        let fastest = 1.3 * motor.supply / motor.joint_constant();
        // A stop gives way a little.
        let furthest = motor.end_stop + 0.1;
        let duty = Limit::new(-DUTY_LIMIT, DUTY_LIMIT)?;
        let guard = EndStop::new(-joint.guard(), joint.guard())?;
        Ok(Self {
            decoder: Decoder::new(motor.gear_ratio, 0),
            sensor: Chain::new(0.0)?
                .then("range", Range::new(-furthest, furthest)?, stop)?
                .then("speed", MaxRate::new(fastest)?, stop)?,
            output: Chain::new(0.0)?
                .then("limit", duty, Reaction::Warn)?
                .then(
                    "rate",
                    RateLimit::new(DUTY_RATE)?.free_to(0.0)?,
                    Reaction::Warn,
                )?
                .then("guard", guard, Reaction::Warn)?
                .then("motion", Blocked::new(DRIVEN, MOVED, STUCK_AFTER)?, stop)?,
            follows: Disagreement::new(FOLLOWS, ASTRAY_AFTER)?,
            middle: joint.middle,
            angle: 0.0,
        })
    }
}

/// The safety module, without its channels. All its functions are for the real-time path:
/// O(joints), no allocation.
#[derive(Debug)]
pub struct Safety {
    joints: [JointSafety; JOINTS],
    seen: Seen,
    /// Readings since the last command.
    silent: u32,
    changed: u64,
    is_stopped: bool,
}

impl Safety {
    /// Of the whole robot.
    ///
    /// # Errors
    ///
    /// None with the figures of [`parameters`](crate::parameters).
    pub fn new() -> Result<Self, SettingError> {
        let mut joints = Vec::with_capacity(JOINTS);
        for joint in &ROBOT {
            joints.push(JointSafety::new(joint)?);
        }
        Ok(Self {
            joints: joints.try_into().expect("as many as there are joints"),
            seen: Seen::default(),
            silent: 0,
            changed: 0,
            is_stopped: false,
        })
    }

    /// The readings of a cycle. Returns what the controllers see. More than [`SILENT`] readings
    /// without a command between them stop the robot.
    pub fn readings(&mut self, readings: &Readings) -> Seen {
        let stops = &mut self.is_stopped;
        self.silent += 1;
        *stops |= self.silent > SILENT;
        for (n, joint) in self.joints.iter_mut().enumerate() {
            let sample = Sample::new(joint.decoder.angle(readings.counts[n]), PERIOD);
            let angle = joint
                .sensor
                .step(&sample, |alarm| *stops |= is_stop(alarm.reaction));
            // Of a sensor that reads what cannot be, the last good reading stays.
            if !*stops {
                joint.angle = angle;
            }
            self.seen.joints[n] = joint.middle + joint.angle;
        }
        self.seen.contacts = readings.contacts;
        self.seen.body = readings.body;
        self.seen.time = readings.time;
        self.seen
    }

    /// The controllers' command. Returns what the motors get.
    pub fn command(&mut self, command: &Command) -> Drive {
        self.silent = 0;
        let mut drive = Drive::default();
        let stops = &mut self.is_stopped;
        for (n, joint) in self.joints.iter_mut().enumerate() {
            let sample = Sample::new(command.duties[n], PERIOD).beside(joint.angle);
            drive.duties[n] = joint
                .output
                .step(&sample, |alarm| *stops |= is_stop(alarm.reaction));
            let sample = Sample::new(command.set[n] - joint.middle, PERIOD).beside(joint.angle);
            *stops |= joint.follows.step(&sample).fault().is_some();
            let is_changed = !*stops && drive.duties[n] != command.duties[n];
            self.changed += u64::from(is_changed);
        }
        drive.is_stopped = self.is_stopped;
        if drive.is_stopped {
            drive.duties = [0.0; JOINTS];
        }
        drive
    }

    /// Whether it has stopped the robot: all motors are to be off.
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

    fn command(duty: f64) -> Command {
        Command {
            duties: [duty; JOINTS],
            set: ROBOT.each_ref().map(|joint| joint.middle),
        }
    }

    #[test]
    fn duties_are_limited_in_size_and_rate() {
        let mut safety = Safety::new().unwrap();
        safety.readings(&Readings::default());
        let first = safety.command(&command(5.0)).duties[0];
        assert!((first - DUTY_RATE * 1e-3).abs() < 1e-12, "{first}");
        for _ in 2..10 {
            assert!(safety.command(&command(5.0)).duties[0] <= DUTY_LIMIT);
        }
        assert_eq!(safety.command(&command(f64::NAN)).duties, [0.0; JOINTS]);
        assert!(safety.changed() >= 10);
    }

    #[test]
    fn controllers_that_are_silent_stop_the_robot() {
        let mut safety = Safety::new().unwrap();
        for _ in 0..2 {
            for _ in 0..SILENT {
                safety.readings(&Readings::default());
                assert!(!safety.is_stopped());
            }
            assert!(!safety.command(&command(0.0)).is_stopped);
        }
        for _ in 0..=SILENT {
            safety.readings(&Readings::default());
        }
        assert!(safety.is_stopped());
        assert!(safety.command(&command(0.0)).is_stopped);
    }

    #[test]
    fn a_joint_that_goes_astray_stops_the_robot() {
        let mut safety = Safety::new().unwrap();
        let cycles = (1_u64..100).find(|_| {
            safety.readings(&Readings::default());
            let mut command = command(0.0);
            command.set[3] += 2.0 * FOLLOWS;
            safety.command(&command).is_stopped
        });
        let after = ASTRAY_AFTER.as_millis() as u64;
        assert!(
            cycles.is_some_and(|cycles| cycles.abs_diff(after) <= 2),
            "{cycles:?}"
        );
    }
}

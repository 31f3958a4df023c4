//! What is behind a simulated subdevice's process data.

use super::abort;
use crate::SdoValue;
use std::fmt;
use std::time::Duration;

/// The machine behind a subdevice: what it does with outputs, and what it measures.
pub trait Application: fmt::Debug + Send {
    /// Lets `elapsed` pass with `outputs`, which are zeros unless the subdevice is operational, and
    /// updates `inputs`.
    ///
    /// Of a subdevice with a [`Dictionary`](super::Dictionary) these are all its outputs and
    /// inputs, in the order of the dictionary. An output that is not mapped is zero.
    fn step(&mut self, elapsed: Duration, outputs: &[u8], inputs: &mut [u8]);

    /// Takes the value of an object that is written over the mailbox, before it is stored. Nothing
    /// if not stated.
    ///
    /// # Errors
    ///
    /// The code with which the SDO is aborted: the value is not stored then.
    fn configure(&mut self, index: u16, sub: u8, value: SdoValue) -> Result<(), u32> {
        let _ = (index, sub, value);
        Ok(())
    }
}

/// No machine: inputs are what the test sets.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nothing;

impl Application for Nothing {
    fn step(&mut self, _: Duration, _: &[u8], _: &mut [u8]) {}
}

/// A drive that follows a velocity, or a position, as of
/// [`SubDevice::servo`](super::SubDevice::servo).
#[derive(Debug, Clone, Copy)]
pub struct Servo {
    /// Counts.
    position: f64,
    /// Counts a second.
    velocity: f64,
    mode: i8,
}

impl Default for Servo {
    fn default() -> Self {
        Self {
            position: 0.0,
            velocity: 0.0,
            mode: Self::VELOCITY,
        }
    }
}

impl Servo {
    /// The bit of the control word that enables the drive, and of the status word that says so.
    pub const ENABLED: u16 = 1 << 3;
    /// How fast it changes its velocity (counts/s²).
    pub const ACCELERATION: f64 = 1e6;
    /// The mode of operation (0x6060) in which it follows a velocity: its mode at first.
    pub const VELOCITY: i8 = 9;
    /// The mode in which it is where the target position is, at once.
    pub const POSITION: i8 = 8;
    const MODE: u16 = 0x6060;

    fn follow_velocity(&mut self, target: f64, time: f64) {
        let most = Self::ACCELERATION * time;
        let before = self.velocity;
        self.velocity += (target - before).clamp(-most, most);
        self.position += 0.5 * (before + self.velocity) * time;
    }

    fn follow_position(&mut self, target: f64, time: f64) {
        if time > 0.0 {
            self.velocity = (target - self.position) / time;
            self.position = target;
        }
    }
}

impl Application for Servo {
    fn step(&mut self, elapsed: Duration, outputs: &[u8], inputs: &mut [u8]) {
        let number = |at: usize| {
            let bytes = outputs.get(at..).and_then(<[u8]>::first_chunk);
            f64::from(bytes.map_or(0, |it| i32::from_le_bytes(*it)))
        };
        let (Some(control), 10..) = (outputs.first_chunk(), inputs.len()) else {
            return;
        };
        let is_enabled = u16::from_le_bytes(*control) & Self::ENABLED != 0;
        let time = elapsed.as_secs_f64();
        match (is_enabled, self.mode) {
            (false, _) => self.follow_velocity(0.0, time),
            (true, Self::POSITION) => self.follow_position(number(6), time),
            (true, _) => self.follow_velocity(number(2), time),
        }
        let status = if is_enabled { Self::ENABLED } else { 0 };
        inputs[..2].copy_from_slice(&status.to_le_bytes());
        // The counter wraps, as that of a drive.
        inputs[2..6].copy_from_slice(&(self.position as i64 as i32).to_le_bytes());
        inputs[6..10].copy_from_slice(&(self.velocity as i32).to_le_bytes());
        if let Some(mode) = inputs.get_mut(10) {
            *mode = self.mode.to_le_bytes()[0];
        }
    }

    fn configure(&mut self, index: u16, _: u8, value: SdoValue) -> Result<(), u32> {
        match (index, value) {
            (Self::MODE, SdoValue::I8(mode @ (Self::POSITION | Self::VELOCITY))) => {
                self.mode = mode;
            }
            (Self::MODE, _) => return Err(abort::VALUE),
            _ => {}
        }
        Ok(())
    }
}

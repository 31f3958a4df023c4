//! What is behind a simulated subdevice's process data.

use std::fmt;
use std::time::Duration;

/// The machine behind a subdevice: what it does with outputs, and what it measures.
pub trait Application: fmt::Debug + Send {
    /// Lets `elapsed` pass with `outputs`, which are zeros unless the subdevice is operational, and
    /// updates `inputs`.
    fn step(&mut self, elapsed: Duration, outputs: &[u8], inputs: &mut [u8]);
}

/// No machine: inputs are what the test sets.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nothing;

impl Application for Nothing {
    fn step(&mut self, _: Duration, _: &[u8], _: &mut [u8]) {}
}

/// A drive that follows a velocity, as of [`SubDevice::servo`](super::SubDevice::servo).
#[derive(Debug, Clone, Copy, Default)]
pub struct Servo {
    /// Counts.
    position: f64,
    /// Counts a second.
    velocity: f64,
}

impl Servo {
    /// The bit of the control word that enables the drive, and of the status word that says so.
    pub const ENABLED: u16 = 1 << 3;
    /// How fast it changes its velocity (counts/s²).
    pub const ACCELERATION: f64 = 1e6;
}

impl Application for Servo {
    fn step(&mut self, elapsed: Duration, outputs: &[u8], inputs: &mut [u8]) {
        let (Some((control, rest)), 10) = (outputs.split_first_chunk::<2>(), inputs.len()) else {
            return;
        };
        let is_enabled = u16::from_le_bytes(*control) & Self::ENABLED != 0;
        let target = rest
            .first_chunk::<4>()
            .map_or(0, |it| i32::from_le_bytes(*it));
        let target = if is_enabled { f64::from(target) } else { 0.0 };
        let time = elapsed.as_secs_f64();
        let most = Self::ACCELERATION * time;
        let before = self.velocity;
        self.velocity += (target - before).clamp(-most, most);
        self.position += 0.5 * (before + self.velocity) * time;
        let status = if is_enabled { Self::ENABLED } else { 0 };
        inputs[..2].copy_from_slice(&status.to_le_bytes());
        // The counter wraps, as that of a drive.
        inputs[2..6].copy_from_slice(&(self.position as i64 as i32).to_le_bytes());
        inputs[6..].copy_from_slice(&(self.velocity as i32).to_le_bytes());
    }
}

//! Playing a recording.

use super::{Deflection, Recording};

/// A recording being played: linear between samples, and from the start again after its last one. A
/// single sample lasts for ever.
#[derive(Debug, Clone)]
pub struct Playback {
    recording: Recording,
    /// At least 0.
    length: f64,
    /// When the current repetition began.
    start: f64,
    /// The sample that comes next.
    next: usize,
}

impl Playback {
    /// Plays `recording` from its start.
    pub(super) fn new(recording: Recording) -> Self {
        Self {
            length: recording.length(),
            recording,
            start: 0.0,
            next: 0,
        }
    }

    /// The deflection `time` seconds after the start. Allocates nothing; O(1) on average while
    /// `time` advances by less than the recording's length, and O(samples) otherwise. Time that
    /// runs backwards counts as time 0 of the current repetition.
    pub fn at(&mut self, time: f64) -> Deflection {
        let samples = &self.recording.samples;
        let first = samples[0];
        let mut within = (time - self.start).max(0.0);
        if within >= self.length {
            if self.length == 0.0 {
                return first.deflection;
            }
            let repetitions = (within / self.length).floor();
            self.start += repetitions * self.length;
            within -= repetitions * self.length;
            self.next = 0;
        }
        let now = first.time + within;
        // Samples before this one are not searched again, unless time went back.
        if self.next > 0 && samples[self.next - 1].time > now {
            self.next = 0;
        }
        while self.next < samples.len() && samples[self.next].time <= now {
            self.next += 1;
        }
        let before = samples[self.next.saturating_sub(1)];
        let Some(after) = samples.get(self.next) else {
            return before.deflection;
        };
        let part = (now - before.time) / (after.time - before.time).max(f64::MIN_POSITIVE);
        let between = |a: f64, b: f64| a + (b - a) * part;
        Deflection {
            pan: between(before.deflection.pan, after.deflection.pan),
            tilt: between(before.deflection.tilt, after.deflection.tilt),
        }
    }
}

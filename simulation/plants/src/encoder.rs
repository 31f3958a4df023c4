//! An incremental encoder on a motor's shaft, its counter card, and the way back to radians.

use std::f64::consts::TAU;

/// Edges for one turn of the motor: 500 lines, four edges each. A common size; the thesis states
/// none.
pub const COUNTS_PER_MOTOR_TURN: f64 = 2000.0;

/// The counter of one axis in a card: 32 bits that wrap, with any value at power-up.
///
/// ```
/// use luna_plants::{Decoder, Encoder};
///
/// // Behind a gear of 72; the counter is about to wrap.
/// let (encoder, mut decoder) = (Encoder::new(72.0, i32::MAX), Decoder::new(72.0, i32::MAX));
/// let count = encoder.count(0.5);
/// assert!(count < 0);
/// assert!((decoder.angle(count) - 0.5).abs() < 1e-4);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Encoder {
    counts_per_rad: f64,
    at_zero: i32,
}

impl Encoder {
    /// For an encoder on a motor with a gear of `gear_ratio`; the counter reads `at_zero` at angle
    /// 0.
    pub fn new(gear_ratio: f64, at_zero: i32) -> Self {
        Self {
            counts_per_rad: counts_per_rad(gear_ratio),
            at_zero,
        }
    }

    /// What the counter reads with the joint at `angle` (rad).
    pub fn count(&self, angle: f64) -> i32 {
        // An edge is counted when it is passed: round down. A counter keeps the low 32 bits.
        let edges = (angle * self.counts_per_rad).floor() as i64;
        self.at_zero.wrapping_add(edges as i32)
    }
}

/// Converts counts to the joint's angle, over any number of wraps.
///
/// Exact if the joint moves less than 2³¹ counts between two calls, which is thousands of turns.
#[derive(Debug, Clone, Copy)]
pub struct Decoder {
    rad_per_count: f64,
    last: i32,
    position: i64,
}

impl Decoder {
    /// For an encoder on a motor with a gear of `gear_ratio`; `at_zero` is the count that
    /// calibration found for angle 0.
    pub fn new(gear_ratio: f64, at_zero: i32) -> Self {
        Self {
            rad_per_count: 1.0 / counts_per_rad(gear_ratio),
            last: at_zero,
            position: 0,
        }
    }

    /// The angle (rad) when the counter reads `count`: the middle of the count. O(1).
    pub fn angle(&mut self, count: i32) -> f64 {
        self.position += i64::from(count.wrapping_sub(self.last));
        self.last = count;
        (self.position as f64 + 0.5) * self.rad_per_count
    }
}

fn counts_per_rad(gear_ratio: f64) -> f64 {
    COUNTS_PER_MOTOR_TURN * gear_ratio / TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    const GEAR: f64 = 72.0;

    #[test]
    fn counts_edges() {
        let encoder = Encoder::new(GEAR, 0);
        assert_eq!(encoder.count(0.0), 0);
        assert_eq!(encoder.count(TAU + 1e-6), 144_000);
        assert_eq!(encoder.count(-TAU - 1e-6), -144_001);
        assert_eq!(encoder.count(-1e-9), -1);
    }

    #[test]
    fn angle_comes_back_within_half_a_count() {
        let encoder = Encoder::new(GEAR, 7);
        let mut decoder = Decoder::new(GEAR, 7);
        for n in -2000..2000 {
            let angle = f64::from(n) * 1.234e-3;
            let error = decoder.angle(encoder.count(angle)) - angle;
            assert!(error.abs() <= 0.5001 * TAU / 144_000.0, "{error}");
        }
    }

    #[test]
    fn wraps_both_ways() {
        for at_zero in [i32::MAX, i32::MIN, i32::MAX - 100, i32::MIN + 100] {
            let encoder = Encoder::new(GEAR, at_zero);
            let mut decoder = Decoder::new(GEAR, at_zero);
            let mut wrapped = false;
            for n in 0..1000 {
                let angle = (f64::from(n) * 0.01).sin();
                let count = encoder.count(angle);
                wrapped |= (count < 0) != (at_zero < 0);
                assert!((decoder.angle(count) - angle).abs() < 1e-4);
            }
            assert!(wrapped);
        }
    }

    #[test]
    fn many_wraps_in_one_direction() {
        let encoder = Encoder::new(GEAR, 0);
        let mut decoder = Decoder::new(GEAR, 0);
        // Ten thousand turns a call: 1.44e9 counts each, so the counter wraps in most of them.
        for n in 0..20 {
            let angle = f64::from(n) * 10_000.0 * TAU;
            assert!((decoder.angle(encoder.count(angle)) - angle).abs() < 1e-4);
        }
    }
}

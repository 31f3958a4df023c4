//! Duties as what a generator's registers hold.

use crate::registers::pwm;

/// The generators' resolution: values are 0 to 4095 of 4096.
pub const BITS: u32 = 12;

/// The mode of a generator for a bridge with sign and magnitude: 12 bits, symmetrical,
/// double-buffered.
pub const MODE: u32 = pwm::BITS_12 | pwm::SYMMETRICAL | pwm::DOUBLE_BUFFERED;

/// The value register for `duty`, −1 to 1: magnitude and direction, in steps of 1/4096. Values
/// outside have the largest magnitude (4095/4096); NaN counts as 0.
///
/// ```
/// use hostmot2::pwm::{duty, value};
///
/// assert_eq!(value(0.5), 2048 << 16);
/// assert_eq!(value(-0.5), 1 << 31 | 2048 << 16);
/// assert_eq!(value(f64::NAN), 0);
/// assert_eq!(duty(value(2.0)), 4095.0 / 4096.0);
/// ```
pub fn value(duty: f64) -> u32 {
    // A cast saturates, and makes 0 of NaN.
    let magnitude = ((duty.abs() * 4096.0).round() as u32).min((1 << BITS) - 1);
    let direction = match duty < 0.0 && magnitude > 0 {
        true => pwm::DIRECTION,
        false => 0,
    };
    direction | magnitude << 16
}

/// The duty of a value register.
pub fn duty(value: u32) -> f64 {
    let magnitude = f64::from(value >> 16 & ((1 << BITS) - 1)) / 4096.0;
    if value & pwm::DIRECTION != 0 {
        -magnitude
    } else {
        magnitude
    }
}

/// The rate register for a PWM frequency (Hz) in the mode [`MODE`], with the card's `clock_high`
/// (Hz): the nearest possible one.
///
/// ```
/// // 200 MHz: 20 kHz take a generator clock of 20 kHz * 2^13.
/// assert_eq!(hostmot2::pwm::rate(20_000.0, 200_000_000), 53_687);
/// ```
pub fn rate(frequency: f64, clock_high: u32) -> u32 {
    let clock = frequency * f64::from(1 << (BITS + 1));
    let rate = clock * 65_536.0 / f64::from(clock_high.max(1));
    (rate.round() as u32).clamp(1, 65_535)
}

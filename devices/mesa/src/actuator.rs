//! What a link writes to.

use std::fmt;

/// A receiver of set-points: see [`Link::greatest_age`](crate::Link::greatest_age).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Actuator {
    /// The duty of the PWM generator of this number.
    Pwm(u8),
    /// Its enable output, if a channel controls it.
    Enable(u8),
    /// The pin of this number.
    Output(u8),
}

impl fmt::Display for Actuator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Actuator::Pwm(number) => write!(f, "PWM generator {number}"),
            Actuator::Enable(number) => write!(f, "the enable of PWM generator {number}"),
            Actuator::Output(pin) => write!(f, "pin {pin}"),
        }
    }
}

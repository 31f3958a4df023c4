//! What of a card is used.

use crate::idrom::Tag;
use crate::lbp16::PacketError;

/// What of a card is used, and how. Nothing at first.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// How many encoders, from number 0 on.
    pub encoders: u8,
    /// Of which of these the first index is latched, by their bits.
    pub latch_index: u64,
    /// How many PWM generators, from number 0 on.
    pub pwms: u8,
    /// Their frequency (Hz).
    pub pwm_frequency: f64,
    /// General-purpose pins that are outputs.
    pub outputs: Vec<OutputPin>,
    /// The watchdog's time (ns): if no write packet comes for this long, all pins become inputs
    /// with pull-up.
    pub watchdog_ns: u64,
}

/// A general-purpose pin that is an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutputPin {
    /// Its number on the card.
    pub pin: u8,
    /// The harmless level: at set-up, in an emergency and at the end.
    pub neutral: bool,
}

impl Default for Selection {
    fn default() -> Self {
        Self {
            encoders: 0,
            latch_index: 0,
            pwms: 0,
            pwm_frequency: 20_000.0,
            outputs: Vec::new(),
            watchdog_ns: 50_000_000,
        }
    }
}

/// Why a card cannot be used so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LayoutError {
    /// The card's configuration has too few units.
    #[error(
        "the card has {there} {tag}, {asked} are requested: request fewer, or give it another configuration"
    )]
    TooFew {
        /// Of what.
        tag: Tag,
        /// How many are requested.
        asked: u8,
        /// How many there are.
        there: u8,
    },
    /// The description has an impossible address for a module's register.
    #[error("the card's description of its {tag} has no place for all registers")]
    NoRegister {
        /// Of what.
        tag: Tag,
    },
    /// The card has no pin of this number.
    #[error("the card has no pin {pin}")]
    NoPin {
        /// Which.
        pin: u8,
    },
    /// The pin is used by a module, or requested twice.
    #[error("pin {pin} cannot be an output: it has another use")]
    PinTaken {
        /// Which.
        pin: u8,
    },
    /// A PWM generator has no pin on the card.
    #[error("PWM generator {pwm} has no pin on the card")]
    NoOutputPin {
        /// Which.
        pwm: u8,
    },
    /// The card's clock cannot count this time: it is too long, or too short.
    #[error(
        "the card's watchdog cannot wait {asked} ns: take more than 1 µs, and a second or so at most"
    )]
    WatchdogTime {
        /// How long (ns).
        asked: u64,
    },
    /// The packets would be too long.
    #[error(transparent)]
    Packet(#[from] PacketError),
}

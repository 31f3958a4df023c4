//! Why a bus cannot be set up.

use crate::{Expected, Found, Sdo, SdoValue};
use luna::devices::DeviceError;
use std::fmt;
use std::io;

/// Why a bus cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// The network interface cannot be used.
    #[error("{wire} cannot be used: {error}{}", hint(error))]
    Interface {
        /// Which.
        wire: String,
        /// The system's error.
        #[source]
        error: io::Error,
    },
    /// The bus is in use in this program.
    #[error("{0}")]
    Device(#[source] DeviceError),
    /// No frame comes back.
    #[error("no frame comes back on {wire}: check the subdevices' power and the cable")]
    Nobody {
        /// Where.
        wire: String,
    },
    /// Frames come back, and no subdevice has counted them.
    #[error("frames come back on {wire}, but from no subdevice: something else is connected")]
    Uncounted {
        /// Where.
        wire: String,
    },
    /// There are more subdevices than a bus can have.
    #[error("there are more than {most} subdevices")]
    TooMany {
        /// The limit.
        most: usize,
    },
    /// At a position is another subdevice than was expected.
    #[error("at position {position} {expected} was expected, and {found} was found")]
    Mismatch {
        /// From 0.
        position: usize,
        /// What was to be there.
        expected: Box<Expected>,
        /// What is there.
        found: Found,
    },
    /// The line ends before a subdevice that was expected.
    #[error(
        "at position {position} {expected} was expected, and the line has {count} subdevices: check its power and the cable before it"
    )]
    Missing {
        /// From 0.
        position: usize,
        /// What was to be there.
        expected: Expected,
        /// How many there are.
        count: usize,
    },
    /// The line has a subdevice more.
    #[error("at position {position} {found} was found, and nothing was expected")]
    Unexpected {
        /// From 0.
        position: usize,
        /// What is there.
        found: Found,
    },
    /// All process data has to be in one frame, so that its working counter has one value.
    #[error("the process data has {bytes} bytes, and one frame has room for {most}")]
    TooMuchData {
        /// How many there are.
        bytes: usize,
        /// The limit.
        most: usize,
    },
    /// An object of a subdevice could not be written, or has not the value that was expected.
    #[error("at position {position} `{name}`: {sdo}: {error}")]
    Sdo {
        /// From 0.
        position: usize,
        /// What the list calls it.
        name: String,
        /// Which object, and the value.
        sdo: Sdo,
        /// Why.
        #[source]
        error: SdoError,
    },
    /// A step has failed.
    #[error("{step} has failed: {error}")]
    Step {
        /// Which.
        step: &'static str,
        /// Why.
        #[source]
        error: StepError,
    },
}

/// Why an object cannot be written or compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SdoError {
    /// The subdevice has no objects.
    #[error("it has no mailbox: take the list of SDOs away from it")]
    NoMailbox,
    /// The subdevice refuses it.
    #[error("it was aborted with {code:#010x}: {reason}")]
    Aborted {
        /// The code.
        code: u32,
        /// What it means.
        reason: String,
    },
    /// Its mailbox, or the bus, does not answer in time.
    #[error("no answer came within a second: the subdevice hangs, or the cable is cut")]
    Silent,
    /// It has sent something else than an answer: an emergency message (the library does not say
    /// with what code), or that its mailbox has no CoE.
    #[error("it sent something else than an answer: an emergency of its own, or it has no CoE")]
    OtherMessage,
    /// It has another value than was expected.
    #[error("it is {there}")]
    Differs {
        /// What is there.
        there: SdoValue,
    },
    /// In the words of the library `ethercrab`.
    #[error("{0}")]
    Bus(String),
    /// The system cannot wait for the network interface.
    #[error("{0}")]
    System(#[source] io::Error),
    /// The library has panicked, with these words: it does so on some answers of subdevices.
    #[error("`ethercrab` has panicked: {0}")]
    Panicked(String),
}

/// Why a link cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// A setting is invalid.
    #[error("{0}")]
    Setting(&'static str),
    /// A value is connected at a position where no subdevice is.
    #[error("there is no subdevice at position {position}: the bus has {count}")]
    NoSubDevice {
        /// From 0.
        position: usize,
        /// How many there are.
        count: usize,
    },
    /// A value lies beyond the subdevice's process data.
    #[error("{place} is beyond the {bytes} bytes that {found} has there")]
    Outside {
        /// The value.
        place: Place,
        /// How many bytes there are.
        bytes: usize,
        /// The subdevice.
        found: Found,
    },
    /// Two channels have outputs of the same bits.
    #[error("{place} is written by two channels, or a part of it")]
    Twice {
        /// The second of them.
        place: Place,
    },
    /// No subdevice has a distributed clock of 64 bits that could be followed.
    #[error("no loop can follow the bus: its first distributed clock {why}")]
    NoClock {
        /// Why.
        why: &'static str,
    },
    /// A subdevice is to make pulses, but has no clock for them.
    #[error("{found} at position {position} makes no SYNC0 pulses")]
    NoSync {
        /// From 0.
        position: usize,
        /// What is there.
        found: Found,
    },
    /// A step has failed.
    #[error("{step} has failed: {error}")]
    Step {
        /// Which.
        step: &'static str,
        /// Why.
        #[source]
        error: StepError,
    },
    /// The system refuses another handle to the socket.
    #[error("no socket for the emergency: {0}")]
    Socket(#[source] io::Error),
    /// The bus' emergency function cannot be registered.
    #[error("{0}")]
    Emergency(#[source] luna::Error),
}

/// Where a value is in process data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Place {
    /// Of the subdevice, from 0.
    pub position: usize,
    /// Whether it is an output.
    pub is_output: bool,
    /// The first bit, counted from bit 0 of byte 0 of the subdevice's inputs or outputs.
    pub bit: usize,
    /// The number of bits.
    pub bits: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = if self.is_output { "output" } else { "input" };
        let (byte, bit) = (self.bit / 8, self.bit % 8);
        match self.bits {
            1 => write!(f, "{direction} bit {bit} of byte {byte}")?,
            bits => write!(f, "{direction} of {} bytes at byte {byte}", bits / 8)?,
        }
        write!(f, " at position {}", self.position)
    }
}

/// Why a step of the set-up has failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// In the words of the library `ethercrab`.
    #[error("{0}")]
    Bus(String),
    /// A subdevice has sent an emergency message in place of an answer.
    #[error("a subdevice reports an emergency of its own: look at their displays")]
    Emergency,
    /// The system cannot wait for the network interface.
    #[error("{0}")]
    System(#[source] io::Error),
    /// The library has panicked, with these words: it does so on some answers of subdevices.
    #[error("`ethercrab` has panicked: {0}")]
    Panicked(String),
}

fn hint(error: &io::Error) -> &'static str {
    match error.raw_os_error() {
        Some(libc::EPERM | libc::EACCES) => "; it needs CAP_NET_RAW",
        Some(libc::ENODEV | libc::ENXIO) => "; there is no such network interface",
        Some(libc::ENETDOWN) => "; the network interface is to be up",
        _ => "",
    }
}

impl From<ethercrab::error::Error> for StepError {
    fn from(error: ethercrab::error::Error) -> Self {
        Self::Bus(error.to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interface_that_is_down_is_to_be_up() {
        let open = |code| OpenError::Interface {
            wire: "ethercat:eth0".to_owned(),
            error: io::Error::from_raw_os_error(code),
        };
        let [down, denied] = [libc::ENETDOWN, libc::EPERM].map(|code| open(code).to_string());
        assert!(
            down.ends_with("; the network interface is to be up"),
            "{down}"
        );
        assert!(denied.ends_with("; it needs CAP_NET_RAW"), "{denied}");
    }
}

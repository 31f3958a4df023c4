//! The states of a subdevice.

use std::fmt;

/// The state of a subdevice's application layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum State {
    /// It did not answer.
    Silent,
    /// No communication but of registers.
    Init,
    /// Configured; no process data.
    PreOp,
    /// Firmware may be loaded.
    Bootstrap,
    /// Inputs are valid; outputs are in the subdevice's own safe state.
    SafeOp,
    /// Inputs and outputs are valid.
    Op,
    /// A number without a meaning.
    Other(u8),
}

impl State {
    pub(crate) fn of(bits: u8) -> Self {
        match bits {
            0 => Self::Silent,
            1 => Self::Init,
            2 => Self::PreOp,
            3 => Self::Bootstrap,
            4 => Self::SafeOp,
            8 => Self::Op,
            other => Self::Other(other),
        }
    }

    pub(crate) const fn bits(self) -> u8 {
        match self {
            Self::Silent => 0,
            Self::Init => 1,
            Self::PreOp => 2,
            Self::Bootstrap => 3,
            Self::SafeOp => 4,
            Self::Op => 8,
            Self::Other(bits) => bits,
        }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => f.write_str("silent"),
            Self::Init => f.write_str("INIT"),
            Self::PreOp => f.write_str("PRE-OP"),
            Self::Bootstrap => f.write_str("BOOT"),
            Self::SafeOp => f.write_str("SAFE-OP"),
            Self::Op => f.write_str("OP"),
            Self::Other(bits) => write!(f, "state {bits:#x}"),
        }
    }
}

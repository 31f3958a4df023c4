//! Why a device cannot be used.

use crate::Error;
use luna_external::OsError;
use std::fmt;
use std::sync::Arc;

/// Why a device cannot be opened, or was lost. Each has a remedy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// There is no such device.
    #[error("there is no {kind} `{device}`: plug it in, load its driver, or correct the name")]
    Missing {
        /// The device's name.
        device: String,
        /// The expected kind: "serial port".
        kind: &'static str,
    },
    /// The device is in use and not shared.
    #[error("`{device}` is in use {}", in_use(.by))]
    Busy {
        /// The device's name.
        device: String,
        /// The holder of the device.
        by: Holder,
    },
    /// This user may not open it.
    #[error("this user may not open `{device}`: {remedy}")]
    NoPermission {
        /// The device's name.
        device: String,
        /// Which group or udev rule allows it.
        remedy: String,
    },
    /// It is of another kind.
    #[error("`{device}` is no {expected} but {found}")]
    WrongKind {
        /// The device's name.
        device: String,
        /// The expected kind.
        expected: &'static str,
        /// The kind that it has.
        found: String,
    },
    /// Its settings make no sense, or the device cannot have them.
    #[error("`{device}`: {reason}")]
    Settings {
        /// The device's name.
        device: String,
        /// What is wrong with them.
        reason: String,
    },
    /// The system refused it for another reason.
    #[error("the system does not open `{device}`: {error}")]
    Refused {
        /// The device's name.
        device: String,
        /// The system's error.
        error: OsError,
    },
    /// It was there, and is gone or does not answer.
    #[error("the {kind} `{device}` is lost: {error}")]
    Lost {
        /// The device's name.
        device: Arc<str>,
        /// What it was: "serial port".
        kind: &'static str,
        /// The error that showed it. Boxed, since all errors would be as large as this else.
        #[source]
        error: Box<Error>,
    },
}

/// The holder of a busy device.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Holder {
    /// This program itself: another part of it, or another of its systems.
    ThisProgram,
    /// Another process.
    Process {
        /// Its number.
        pid: u32,
        /// Its name, as far as the system gives it.
        name: String,
    },
    /// A holder that the kernel knows by a name alone.
    Named {
        /// The name.
        name: String,
    },
    /// A holder that the system does not show, or not to this user.
    Unknown,
}

impl fmt::Display for Holder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Holder::ThisProgram => f.write_str("this program"),
            Holder::Process { pid, name } => write!(f, "process {pid} (`{name}`)"),
            Holder::Named { name } => write!(f, "`{name}`"),
            Holder::Unknown => f.write_str("an unknown holder"),
        }
    }
}

/// The holder of a device in use, and what to do about it.
fn in_use(by: &Holder) -> String {
    match by {
        Holder::ThisProgram => {
            "in this program: open it once and clone its handle, or open it as shared everywhere"
                .to_owned()
        }
        by => format!("by {by}: end that first"),
    }
}

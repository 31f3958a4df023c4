//! Errors of an FMU, before it runs and while it does.

use super::Version;
use crate::error::{Side, listed};
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// The status of an FMU's function other than OK.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FmuStatus {
    /// fmi2Discard, fmi3Discard: it could not, for these values or this step.
    Discard,
    /// fmi2Error, fmi3Error: the instance cannot go on.
    Error,
    /// fmi2Fatal, fmi3Fatal: no instance of the FMU can go on. It is never called again, not even
    /// to be freed.
    Fatal,
    /// It asks for the end of the simulation, or ended a step early, which was not allowed.
    Ended,
    /// A status that the standard does not allow here: fmi2Pending without a callback for it, or an
    /// unknown number.
    Unknown,
}

impl fmt::Display for FmuStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FmuStatus::Discard => "discards it",
            FmuStatus::Error => "returns an error",
            FmuStatus::Fatal => "returns a fatal error",
            FmuStatus::Ended => "asks for the end of the simulation",
            FmuStatus::Unknown => "returns an invalid status",
        })
    }
}

/// Why an FMU cannot go on. Creating one allocates nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FmuFault {
    /// One of its functions failed.
    #[error("the FMU's {call} {status}")]
    Call {
        /// Which: "doStep", "get", "set".
        call: &'static str,
        /// The status that it returned.
        status: FmuStatus,
    },
    /// It only takes steps of one length, that of the first, and was given one that is not a
    /// multiple of it.
    #[error("the FMU takes steps of one length, which was {first:?}, and not of {step:?}")]
    StepSize {
        /// The first.
        first: Duration,
        /// The requested one.
        step: Duration,
    },
}

/// Why an FMU cannot become a plant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FmuError {
    /// The file cannot be read, or is no archive.
    #[error("{} is no FMU that can be read: {reason}", .path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Its modelDescription.xml is missing or malformed.
    #[error("the FMU's description: {reason}")]
    Description {
        /// Why.
        reason: String,
    },
    /// It is of another version of the standard than 2 or 3.
    #[error("the FMU is of FMI {found}; export it for version 2 or 3")]
    Version {
        /// The version in the description.
        found: String,
    },
    /// It is not for co-simulation.
    #[error("the FMU is not for co-simulation; export it as one that brings its solver")]
    NoCoSimulation,
    /// Its code cannot be loaded: there is none for this platform, or a function is missing.
    #[error("the FMU's code cannot be loaded: {reason}")]
    Library {
        /// Why.
        reason: String,
    },
    /// Its code is of another version than its description.
    #[error("the FMU's description is of {description}, and its code of FMI {code}")]
    VersionOfCode {
        /// Of the description.
        description: Version,
        /// The version that the code reports.
        code: String,
    },
    /// It has no variable of that name.
    #[error("the FMU has no `{name}`; it has {}", listed(.known))]
    NoSuchVariable {
        /// The name.
        name: String,
        /// The names of those of the causality that was looked for.
        known: Vec<String>,
    },
    /// A variable has another causality than required.
    #[error("`{name}` of the FMU is no {wanted}, but of causality {found}")]
    Causality {
        /// Its name.
        name: String,
        /// What it was to be.
        wanted: &'static str,
        /// What it is.
        found: String,
    },
    /// A variable's type is not one of a plant's port or parameter: text, an array, a clock.
    #[error(
        "`{name}` of the FMU is a {found}; reals, 32-bit integers and booleans can be connected"
    )]
    Type {
        /// Its name.
        name: String,
        /// Its type.
        found: String,
    },
    /// A parameter cannot have that value.
    #[error("parameter `{name}` of the FMU cannot be {value}: {reason}")]
    Value {
        /// Its name.
        name: String,
        /// The value.
        value: f64,
        /// Why not.
        reason: String,
    },
    /// It does not get through its initialization.
    #[error("the FMU's {call} {status}{}", reason(.said))]
    Refused {
        /// Which of its functions fails: "instantiate", "enterInitializationMode".
        call: &'static str,
        /// The status that it returned.
        status: FmuStatus,
        /// What it has logged of warnings and errors, but for what is beyond 1 KiB; empty if it has
        /// not.
        said: String,
    },
}

/// What is known of why it refuses.
fn reason(said: &str) -> String {
    match said {
        "" => ": it has logged no reason; `Fmu::debug_log` lets it log more".to_owned(),
        said => format!(": {said}"),
    }
}

impl From<FmuError> for luna::Error {
    fn from(error: FmuError) -> luna::Error {
        luna::Error::other(error)
    }
}

/// The standard's word for a side.
pub(super) fn causality(side: Side) -> &'static str {
    match side {
        Side::Input => "input",
        Side::Output => "output",
    }
}

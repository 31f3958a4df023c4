//! Why a plant cannot be connected, or has failed.

use crate::Port;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Which side of a plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// What actuators apply to it.
    Input,
    /// What sensors read of it.
    Output,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Side::Input => "input",
            Side::Output => "output",
        })
    }
}

/// Why a plant cannot be stepped, or its values are invalid. The failure is final: see
/// [`Checked`](crate::Checked).
///
/// Creating and cloning one does not allocate, except for what a plant of your own puts into
/// [`Model`](PlantError::Model).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlantError {
    /// A value is not a number, or infinite where the range does not saturate.
    #[error("{side} `{port}` is {value}")]
    NotFinite {
        /// Of an input or an output.
        side: Side,
        /// Of which.
        port: Arc<str>,
        /// What it is.
        value: f64,
    },
    /// A value is outside of a range that does not saturate.
    #[error("{side} `{}` is {value} {unit}, outside of {} to {} {unit}", .port.name(), .port.min(), .port.max(), unit = .port.unit())]
    OutOfRange {
        /// Of an input or an output.
        side: Side,
        /// Of which, with its range.
        port: Port,
        /// What it is.
        value: f64,
    },
    /// A value cannot be represented in the type of its channel or of its variable: 300 in a `u8`,
    /// 0.5 in an integer.
    #[error("{side} `{port}` is {value}, which is no {into}")]
    DoesNotFit {
        /// Of an input or an output.
        side: Side,
        /// Of which.
        port: Arc<str>,
        /// What it is.
        value: f64,
        /// The type.
        into: &'static str,
    },
    /// A step is zero or longer than the plant can take.
    #[error("a step of {step:?} was requested; it must be above zero and at most {longest:?}")]
    Step {
        /// How long it was to be.
        step: Duration,
        /// The longest.
        longest: Duration,
    },
    /// A dead time has no room for the changes of its input: the steps are shorter than stated.
    #[error(
        "more than {room} changes of the input lie within the dead time: state the shortest step that is made"
    )]
    NoRoom {
        /// How many there is room for.
        room: usize,
    },
    /// The model's own.
    #[error("{0}")]
    Model(Arc<str>),
    /// An FMU's.
    #[cfg(feature = "fmi")]
    #[error("{0}")]
    Fmu(crate::fmu::FmuFault),
}

impl PlantError {
    /// A failure of a model of your own, as text.
    ///
    /// ```
    /// let error = luna_plants::PlantError::model("the tank has run over");
    /// assert_eq!(error.to_string(), "the tank has run over");
    /// ```
    pub fn model(why: &str) -> PlantError {
        PlantError::Model(Arc::from(why))
    }
}

/// The failure that ended the system, with the plant's name.
///
/// The process of a [`PlantLink`](crate::PlantLink) raises it as an emergency: it is the source in
/// [`Error::Other`](luna::Error::Other).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("plant `{plant}` failed: {error}")]
pub struct PlantFailure {
    /// The plant's name.
    pub plant: Arc<str>,
    /// Why it failed.
    #[source]
    pub error: PlantError,
}

/// Why a plant and channels cannot be connected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The plant has no port of that name.
    #[error("plant `{plant}` has no {side} `{port}`; it has {}", listed(.known))]
    NoSuchPort {
        /// The plant's name.
        plant: String,
        /// On which side it was looked for.
        side: Side,
        /// The name.
        port: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// An input has an actuator already.
    #[error("input `{port}` of plant `{plant}` has an actuator already")]
    Taken {
        /// The plant's name.
        plant: String,
        /// The input.
        port: String,
    },
    /// An input has no actuator, and is not held.
    #[error("plant `{plant}` has inputs without an actuator: {}; connect them, or give them a value with `hold`", listed(.ports))]
    NotConnected {
        /// The plant's name.
        plant: String,
        /// The inputs.
        ports: Vec<String>,
    },
    /// A plant's outputs do not match the inputs of the plant behind it in number or unit.
    #[error("outputs ({}) do not fit inputs ({}): as many are needed, of the same units", listed(.outputs), listed(.inputs))]
    Mismatch {
        /// The outputs, with units.
        outputs: Vec<String>,
        /// The inputs, with units.
        inputs: Vec<String>,
    },
    /// An input cannot be held at the given value.
    #[error("plant `{plant}`: {error}")]
    Refused {
        /// The plant's name.
        plant: String,
        /// Why.
        error: PlantError,
    },
    /// A step of zero.
    #[error("plant `{plant}` has a step of zero; give it a time above zero")]
    ZeroStep {
        /// The plant's name.
        plant: String,
    },
}

impl From<ConnectError> for luna::Error {
    fn from(error: ConnectError) -> luna::Error {
        luna::Error::other(error)
    }
}

pub(crate) fn listed(names: &[String]) -> String {
    if names.is_empty() {
        return "none".to_owned();
    }
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    quoted.join(", ")
}

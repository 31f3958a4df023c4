//! Parameters, as the scope sees them.

use serde::Serialize;
use serde_json::Value;

/// The parameters that a program shows to its viewers and, with the token, lets them set. Called on
/// threads of the scope, which may block. Those of a system are some:
/// `Settings::parameters(Arc::new(system.parameters()))`.
///
/// ```
/// use luna_scope::{Parameter, Parameters};
/// use serde_json::Value;
/// use std::sync::Mutex;
///
/// struct Gain(Mutex<f64>);
///
/// impl Parameters for Gain {
///     fn list(&self) -> Vec<Parameter> {
///         vec![Parameter::new("pan/gain", *self.0.lock().unwrap()).unit("V/rad").range(0.0, 50.0)]
///     }
///
///     fn set(&self, name: &str, value: &Value) -> Result<(), String> {
///         let gain = value
///             .as_f64()
///             .filter(|gain| name == "pan/gain" && (0.0..=50.0).contains(gain));
///         *self.0.lock().unwrap() = gain.ok_or("a gain is a number from 0 to 50")?;
///         Ok(())
///     }
/// }
///
/// let gain = Gain(Mutex::new(8.0));
/// assert!(gain.set("pan/gain", &99.into()).is_err());
/// gain.set("pan/gain", &9.into())?;
/// assert_eq!(gain.list()[0].value, 9.0);
/// # Ok::<(), String>(())
/// ```
pub trait Parameters: Send + Sync {
    /// All of them, in the order of presentation.
    fn list(&self) -> Vec<Parameter>;

    /// Sets one.
    ///
    /// # Errors
    ///
    /// Why it was not set, for the viewer to read.
    fn set(&self, name: &str, value: &Value) -> Result<(), String>;
}

/// A parameter with its value.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Parameter {
    /// Its name.
    pub name: String,
    /// A number, a boolean, a text, or an array of them.
    pub value: Value,
    /// Its unit; empty if it has none.
    pub unit: String,
    /// What it is; may be empty.
    pub description: String,
    /// The least value that it may have, in its unit; none if unlimited.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least: Option<f64>,
    /// The greatest value that it may have, in its unit; none if unlimited.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub greatest: Option<f64>,
}

impl Parameter {
    /// A parameter without a unit, a description or a range.
    pub fn new(name: impl Into<String>, value: impl Into<Value>) -> Self {
        Self {
            name: name.into(),
            value: value.into(),
            unit: String::new(),
            description: String::new(),
            least: None,
            greatest: None,
        }
    }

    /// Its unit.
    pub fn unit(mut self, unit: impl Into<String>) -> Self {
        self.unit = unit.into();
        self
    }

    /// What it is.
    pub fn description(mut self, text: impl Into<String>) -> Self {
        self.description = text.into();
        self
    }

    /// Sets its range, in its unit, both ends included.
    pub fn range(mut self, least: f64, greatest: f64) -> Self {
        (self.least, self.greatest) = (Some(least), Some(greatest));
        self
    }
}

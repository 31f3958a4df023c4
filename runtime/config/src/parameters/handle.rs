//! Parameters, as seen from outside of the processes.

use super::error::{SetError, Source};
use super::sources::{self, Given};
use super::store::Store;
use super::value::Value;
use std::fmt;
use std::sync::Arc;

/// The parameters of a system, to look at and to replace: from
/// `System::parameters`.
///
/// For threads beside the processes: a console, a scope. Not for the real-time path: its functions
/// allocate, and take a plain lock, which no process on the real-time path waits for; a process
/// with a thread of its own may call them. Clones are the same.
///
/// ```
/// use luna::parameters::{SetError, Value};
/// use luna::prelude::*;
/// use std::time::Duration;
///
/// let mut system = System::new("oven");
/// let main = system.executor("main").build()?;
/// let heater = main.process("heater");
/// let target = heater.parameter("heater/target", 20.0).unit("°C").range(0.0..=60.0).register()?;
/// heater.spawn(async move {
///     let mut tick = luna::periodic("heater", Duration::from_millis(1))?;
///     while target.get() < 40.0 {
///         tick.next().await;
///     }
///     Ok(())
/// })?;
/// let parameters = system.parameters();
/// system.thread("console").process("operator").spawn(async move {
///     let error = parameters.set([("heater/traget", 40.0)]).unwrap_err();
///     assert_eq!(
///         error.to_string(),
///         "no parameter was set: `heater/traget` = 40.0: there is no such parameter; did you mean `heater/target`?"
///     );
///     let error = parameters.set([("heater/target", 61.0)]).unwrap_err();
///     assert!(matches!(error, SetError::Refused(refused) if refused[0].name == "heater/target"));
///     parameters.set([("heater/target", 45.0)])?;
///     assert_eq!(parameters.list()[0].value, Value::Float(45.0));
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Clone)]
pub struct Parameters(Arc<Store>);

impl Parameters {
    #[doc(hidden)]
    pub fn new(store: Arc<Store>) -> Self {
        Self(store)
    }

    /// All parameters that were declared, by name, with their values; before the start with
    /// their defaults. O(parameters × processes).
    pub fn list(&self) -> Vec<Info> {
        self.0.infos()
    }

    /// Replaces the values of these parameters, all or none; others keep theirs. Gives the number
    /// of the set, which counts from 1.
    ///
    /// Each process takes the set as a whole, at the next begin of a cycle of its loop, or when it
    /// [latches](super::Parameter::latch). If several come before that it takes what they have made
    /// together: no set is lost, and none is seen by halves. O(values × processes that have
    /// parameters).
    ///
    /// # Errors
    ///
    /// [`SetError::Refused`] names every value that cannot be taken, and why.
    /// [`SetError::NotRunning`] before the start and after the end, [`SetError::Replayed`] in a
    /// replay.
    pub fn set<N: Into<String>, V: Into<Value>>(
        &self,
        values: impl IntoIterator<Item = (N, V)>,
    ) -> Result<u64, SetError> {
        let given = values.into_iter().map(|(name, value)| Given {
            name: name.into(),
            value: value.into(),
            source: Source::Program,
        });
        self.0.set(given.collect())
    }

    /// As [`set`](Self::set), of text such as `pan/kp=2.5,tilt/gains=[1, 2]`.
    ///
    /// # Errors
    ///
    /// As `set`, and [`SetError::Syntax`].
    pub fn set_text(&self, text: &str) -> Result<u64, SetError> {
        self.0.set(sources::assignments(text, &Source::Program)?)
    }

    /// Reads the file again: then all parameters have the values that a start would give them, as
    /// one set. The environment and `set_parameter` override the
    /// file, a parameter in neither has its default, and what [`set`](Self::set) made is gone. To
    /// change the file, write another and rename it: of a file that is written in place, a part may
    /// be read.
    ///
    /// # Errors
    ///
    /// As [`set`](Self::set), and [`SetError::File`] and [`SetError::NoFile`].
    pub fn reload(&self) -> Result<u64, SetError> {
        self.0.reload()
    }

    /// Whether every process that has parameters reads what the set of this number made of them, or
    /// a later one. False for a set that is yet to come; once true it stays true. Processes that
    /// have ended, with no handles and loops left, are not waited for.
    pub fn is_taken(&self, set: u64) -> bool {
        self.0.is_taken(set)
    }
}

luna_platform::debug_fields!(Parameters);

/// A parameter, as [listed](Parameters::list).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Info {
    /// Its name.
    pub name: String,
    /// What it is measured in; empty for none.
    pub unit: String,
    /// What it is, in a few words.
    pub description: String,
    /// `f64`, `[f32; 3]`, `bool`, `choice`.
    pub type_name: String,
    /// The choices; empty if it is no choice.
    pub choices: Vec<String>,
    /// The least that it, or each of its elements, may be.
    pub least: Option<Value>,
    /// The most.
    pub most: Option<Value>,
    /// Its default.
    pub default: Value,
    /// What was set last, or at the start.
    pub value: Value,
    /// In which set that was; 0: at the start.
    pub set: u64,
    /// The processes that read it, as long as they live.
    pub processes: Vec<String>,
    /// Whether all of them have taken it: each does so when its next cycle begins.
    pub taken: bool,
}

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}", self.name, self.value)?;
        if !self.unit.is_empty() {
            write!(f, " {}", self.unit)?;
        }
        write!(f, " ({}, default {}", self.type_name, self.default)?;
        if let (Some(least), Some(most)) = (&self.least, &self.most) {
            write!(f, ", {least} to {most}")?;
        }
        if !self.choices.is_empty() {
            write!(f, ", one of {}", self.choices.join(", "))?;
        }
        f.write_str(")")
    }
}

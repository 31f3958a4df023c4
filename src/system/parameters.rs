//! Where a system's parameters come from.

use super::System;
use crate::error::Result;
use crate::parameters::{Parameters, Value};
use std::path::PathBuf;
use std::time::Duration;

/// How often the file is looked at.
const LOOK: Duration = Duration::from_millis(250);

impl System {
    /// The [parameters](crate::parameters) of the system, to look at and to replace while it runs.
    pub fn parameters(&self) -> Parameters {
        Parameters::new(self.plan.parameters.clone())
    }

    /// Reads the values of [parameters](crate::parameters) from a TOML file when the system starts.
    /// Tables are the first part of names: `kp = 2.5` below `[pan]` is `pan/kp`.
    ///
    /// Where the program names no file, the environment may: `LUNA_PARAMETERS=machine.toml`. Values
    /// that come over those of the file: `LUNA_SET="pan/kp=2.5,tilt/kd=0.1"`, and over these
    /// [`set_parameter`](Self::set_parameter). A file that cannot be read, a name that no process
    /// has declared when all `pre_run` are over, or a value that its parameter cannot have fails
    /// the start: [`SetupError::Parameters`](crate::error::SetupError::Parameters) names each, with
    /// its line.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("camera");
    /// system.parameters_from("/nowhere/machine.toml");
    /// let error = system.run().unwrap_err();
    /// assert!(error.to_string().starts_with("no parameter was set: /nowhere/machine.toml: "));
    /// ```
    pub fn parameters_from(&mut self, file: impl Into<PathBuf>) -> &mut Self {
        self.plan.parameters.read_from(file.into());
        self
    }

    /// Sets the value of a parameter at the start, over file and environment; also when the file is
    /// [read again](Parameters::reload). A name or value that is wrong fails the start.
    pub fn set_parameter(&mut self, name: &str, value: impl Into<Value>) -> &mut Self {
        self.plan.parameters.give_value(name, value.into());
        self
    }

    /// Takes `NAME=VALUE` from a command line, as [`set_parameter`](Self::set_parameter).
    ///
    /// # Errors
    ///
    /// [`SetError::Syntax`](crate::parameters::SetError::Syntax).
    pub fn set_parameter_text(&mut self, assignment: &str) -> Result<&mut Self> {
        let taken = self.plan.parameters.take_assignment(assignment);
        taken.inspect_err(|_| self.plan.note_refusal())?;
        Ok(self)
    }

    /// Takes `--parameters FILE` and `--set NAME=VALUE`, as often as they come, out of a program's
    /// arguments; gives the others, in their order. What follows `--` is left alone.
    ///
    /// # Errors
    ///
    /// [`SetError::Syntax`](crate::parameters::SetError::Syntax): one of them without what belongs
    /// to it.
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let mut system = System::new("camera");
    /// let arguments = ["--fast", "--set", "pan/kp=2.5", "--set=pan/kd=0.1", "--parameters", "machine.toml"];
    /// let others = system.parameter_arguments(arguments.map(String::from))?;
    /// assert_eq!(others, ["--fast"]);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn parameter_arguments(
        &mut self,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Vec<String>> {
        let others = self.plan.parameters.take_arguments(arguments);
        Ok(others.inspect_err(|_| self.plan.note_refusal())?)
    }

    /// Reads the file of parameters again whenever it has changed: a thread without priority
    /// looks at its time, length and number four times a second, and reads it when two looks have
    /// found the same. What is refused then is reported on standard error, and the values stay. An
    /// empty file counts as one that is not written yet. Not on a virtual clock, where the time of
    /// a look is undefined.
    ///
    /// Write another file and rename it: then it is never there by halves. What is written in place
    /// with a pause of half a second in the middle is read as it is then.
    pub fn reload_parameters_on_change(&mut self) -> &mut Self {
        self.plan.settings().look_at_parameters = Some(LOOK);
        self
    }
}

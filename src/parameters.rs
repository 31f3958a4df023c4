//! Parameters: numbers and choices that a process declares, files and people set, and the real-time
//! path reads.
//!
//! A process' [`Parameter`]s are declared where it is described, with
//! [`ProcessBuilder::parameter`](crate::system::ProcessBuilder::parameter): name, default, unit,
//! range. At the start they get their values from a TOML file
//! ([`System::parameters_from`](crate::System::parameters_from)), the environment and the command
//! line. While the system runs, they get them from the file again, or through [`Parameters`]. A set
//! is taken as a whole: if it has a name that is not declared, or a value out of range, nothing of
//! it is taken, and the error names each.
//!
//! A process sees one set during a whole cycle. [`Periodic::next`](crate::Periodic::next) takes the
//! latest one for all parameters of its process at once; a process without a loop takes it with
//! [`Parameter::latch`]. Reading is a load, without a lock. `docs/parameters.md` has more.
//!
//! ```
//! use luna::prelude::*;
//! use std::time::Duration;
//!
//! let mut system = System::new("camera");
//! system.set_parameter("pan/kp", 2.5);
//! let main = system.executor("main").build()?;
//! let pan = main.process("pan");
//! let kp = pan.parameter("pan/kp", 2.0).unit("1/rad").range(0.0..=50.0).description("of the controller").register()?;
//! let kd = pan.parameter("pan/kd", 0.1).unit("s/rad").range(0.0..=5.0).register()?;
//! pan.spawn(async move {
//!     let mut tick = luna::periodic("pan", Duration::from_millis(1))?;
//!     for _ in 0..10 {
//!         tick.next().await;
//!         assert_eq!((kp.get(), kd.get()), (2.5, 0.1));
//!     }
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

pub use luna_config::parameters::{
    Choice, DeclareError, Info, Number, Parameter, ParameterBuilder, Parameters, Reason, Refusal,
    SetError, Source, Tunable, Value,
};

use crate::System;
use crate::error::Result;
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
    /// [`SetError::Syntax`].
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
    /// [`SetError::Syntax`]: one of them without what belongs
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

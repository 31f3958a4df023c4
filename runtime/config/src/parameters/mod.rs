//! Parameters: numbers and choices that a process declares, files and people set, and the real-time
//! path reads.
//!
//! A process' [`Parameter`]s are declared where it is described, with
//! `ProcessBuilder::parameter`: name, default, unit,
//! range. At the start they get their values from a TOML file
//! (`System::parameters_from`), the environment and the command
//! line. While the system runs, they get them from the file again, or through [`Parameters`]. A set
//! is taken as a whole: if it has a name that is not declared, or a value out of range, nothing of
//! it is taken, and the error names each.
//!
//! A process sees one set during a whole cycle. `Periodic::next` takes the
//! latest one for all parameters of its process at once; a process without a loop takes it with
//! [`Parameter::latch`]. Reading is a load, without a lock. `docs/parameters.md` has more.

mod cells;
mod error;
mod form;
mod handle;
mod parameter;
mod sources;
mod store;
mod types;
mod value;
mod watch;

pub use cells::Reader;
pub use error::{DeclareError, Reason, Refusal, SetError, Source};
pub use handle::{Info, Parameters};
pub use parameter::{Parameter, ParameterBuilder};
pub use store::{Notify, Store};
pub use types::{Choice, Number, Tunable};
pub use value::Value;
pub use watch::{FileValues, FileWatch, read};

use crate::arguments::take_options;
use sources::Given;

impl Store {
    /// Gives a value that comes over that of the file.
    pub fn give_value(&self, name: &str, value: Value) {
        self.give(Given {
            name: name.to_owned(),
            value,
            source: Source::Program,
        });
    }

    /// Takes `--parameters FILE` and `--set NAME=VALUE` out of these arguments. Returns the others.
    ///
    /// # Errors
    ///
    /// [`SetError::Syntax`], or no file is named.
    pub fn take_arguments(
        &self,
        arguments: impl IntoIterator<Item = String>,
    ) -> Result<Vec<String>, SetError> {
        take_options(arguments, &["--parameters", "--set"], |option, value| {
            if option == "--set" {
                return self.take_assignment(&value);
            }
            if value.is_empty() {
                return Err(SetError::File {
                    path: option.to_owned(),
                    line: None,
                    message: "it needs the name of a file".to_owned(),
                });
            }
            self.read_from(value.into());
            Ok(())
        })
    }

    /// Takes `NAME=VALUE`, as if it were behind `--set`.
    ///
    /// # Errors
    ///
    /// [`SetError::Syntax`].
    pub fn take_assignment(&self, text: &str) -> Result<(), SetError> {
        self.give(sources::assignment(text, &Source::Argument)?);
        Ok(())
    }
}

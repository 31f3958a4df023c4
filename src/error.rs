//! Errors: [`Error`] for all that a process' body and a system can meet, and its parts.
//!
//! Each error of a channel, lock or set-up turns into an [`Error`] with `?`. Errors of one
//! operation are with it: in [`channel`](mod@crate::channel), [`sync`](crate::sync),
//! [`parameters`](crate::parameters) and so on.
//!
//! ```
//! use luna::error::{Error, SetupError};
//! use luna::prelude::*;
//!
//! let mut system = System::new("arm");
//! let refused = system.executor("control").policy(Policy::fifo(200)).build();
//! let Err(Error::Setup(SetupError::Attributes(error))) = refused else { panic!("too high") };
//! println!("{error}"); // what is wrong, with which value, and what to do
//! ```

pub(crate) use luna_error::Failures;
pub use luna_error::{Error, Errors, OtherError, Problem, Result, SetupError, Several};

use crate::csp::supervised::Failure;

impl From<Failure> for Error {
    fn from(Failure { name, consecutive }: Failure) -> Error {
        Error::Overrun {
            name: name.to_string(),
            consecutive,
        }
    }
}

impl From<crate::time::StampError> for Error {
    fn from(error: crate::time::StampError) -> Error {
        Error::other(error)
    }
}

impl From<crate::safety::ResetError> for Error {
    fn from(error: crate::safety::ResetError) -> Error {
        Error::other(error)
    }
}

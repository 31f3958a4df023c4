//! Why a command did not do what it was asked for, and the exit code that says so.

use crate::joystick;
use luna::SetupError;
use std::fmt;
use std::path::PathBuf;

/// What went wrong.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The joystick's recording cannot be used.
    Joystick {
        /// Of the recording.
        path: PathBuf,
        /// Why.
        error: joystick::Error,
    },
    /// The histogram cannot be written.
    Histogram {
        /// Of the histogram.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// The system could not be set up, or ended with an error.
    Luna(luna::Error),
    /// Standard output is closed.
    Output(std::io::Error),
}

impl Failure {
    /// 2 for what the user can put right on the command line, as clap has it; 1 for the rest.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Joystick { .. } | Self::Histogram { .. } => 2,
            Self::Luna(luna::Error::Setup(
                SetupError::NoSuchCore { .. } | SetupError::Attributes(_),
            )) => 2,
            Self::Luna(_) | Self::Output(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Joystick { path, error } => {
                write!(f, "joystick recording {}: {error}", path.display())
            }
            Self::Histogram { path, error } => write!(f, "histogram {}: {error}", path.display()),
            Self::Luna(error) => error.fmt(f),
            Self::Output(error) => write!(f, "standard output: {error}"),
        }
    }
}

impl std::error::Error for Failure {}

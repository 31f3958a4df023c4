//! Why a command failed, and its exit code.

use luna::error::SetupError;
use luna::replay::RecordError;
use std::fmt::Display;
use std::path::Path;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// What the user can put right: a file, an address, a core or a channel that cannot be used, a
    /// model that is wrong, a simulated card that cannot start.
    #[error("{0}")]
    Unusable(String),
    /// Options that do not go together.
    #[error("{0}")]
    Options(&'static str),
    /// The system could not be set up, or ended with an error.
    #[error(transparent)]
    Luna(#[from] luna::Error),
    /// The exchange with another program has ended early.
    #[cfg(target_os = "linux")]
    #[error("{name}: {error}")]
    BrokenOff {
        /// The channel's name.
        name: String,
        /// Why.
        error: String,
    },
    /// What the programs of this computer share cannot be looked at.
    #[cfg(target_os = "linux")]
    #[error("the folder of shared memory, /dev/shm, cannot be read: {0}")]
    SharedMemory(std::io::Error),
    /// Standard output is closed.
    #[error("standard output: {0}")]
    Output(std::io::Error),
}

/// [`Failure::Unusable`]: what cannot be used, and why.
pub fn unusable(what: impl Display, why: impl Display) -> Failure {
    Failure::Unusable(format!("{what}: {why}"))
}

/// As [`unusable`], for the error of a path.
pub fn failed<E: Display>(path: &Path) -> impl Fn(E) -> Failure {
    move |error| unusable(path.display(), error)
}

impl Failure {
    /// 2 for what the user can put right, as clap has it; 1 for the rest.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Unusable(_) | Self::Options(_) => 2,
            Self::Luna(luna::Error::Setup(
                SetupError::NoSuchCore { .. }
                | SetupError::Attributes(_)
                | SetupError::Deployment(_)
                | SetupError::DeploymentFile { .. }
                | SetupError::Parameters(_),
            )) => 2,
            Self::Luna(luna::Error::Record(
                RecordError::NameOfTheLogger { .. } | RecordError::IsThere { .. },
            )) => 2,
            // A device that cannot be opened; a later loss is the error of a process.
            #[cfg(unix)]
            Self::Luna(luna::Error::Device(_)) => 2,
            #[cfg(target_os = "linux")]
            Self::BrokenOff { .. } | Self::SharedMemory(_) => 1,
            Self::Luna(_) | Self::Output(_) => 1,
        }
    }
}

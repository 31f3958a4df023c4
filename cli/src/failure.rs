//! Why a command failed, and its exit code.

use luna::error::SetupError;
use luna::replay::RecordError;
use luna_jiwy::joystick;
use luna_platform::facts::parse::write_core_list;
use std::fmt;
use std::net::SocketAddr;
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
    /// A recording of a run cannot be replayed.
    Recording {
        /// Of the recording.
        path: PathBuf,
        /// Why.
        error: Box<RecordError>,
    },
    /// The histogram cannot be written.
    Histogram {
        /// Of the histogram.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// The folder with a machine's files is none.
    Root {
        /// As given.
        path: PathBuf,
    },
    /// The machine has no such core, or it is switched off.
    Core {
        /// As given.
        core: usize,
        /// Those that are there.
        online: Vec<usize>,
    },
    /// The card cannot be had.
    Card(Box<dyn std::error::Error + Send + Sync>),
    /// A recording cannot be read at all.
    Log {
        /// Of the recording.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// What a recording is converted to cannot be written.
    Converted {
        /// Of the output.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// The address cannot be listened on.
    Listen {
        /// As given.
        address: String,
        /// Why.
        error: std::io::Error,
    },
    /// The scope cannot be served.
    Scope {
        /// Where.
        address: SocketAddr,
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
            Self::Joystick { .. }
            | Self::Recording { .. }
            | Self::Histogram { .. }
            | Self::Root { .. }
            | Self::Log { .. }
            | Self::Converted { .. }
            | Self::Listen { .. }
            | Self::Scope { .. }
            | Self::Core { .. } => 2,
            Self::Luna(luna::Error::Setup(
                SetupError::NoSuchCore { .. }
                | SetupError::Attributes(_)
                | SetupError::Parameters(_),
            )) => 2,
            Self::Card(_) => 2,
            // A device that cannot be opened; a later loss is the error of a process.
            #[cfg(unix)]
            Self::Luna(luna::Error::Device(_)) => 2,
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
            Self::Recording { path, error } => write!(f, "--replay {}: {error}", path.display()),
            Self::Histogram { path, error } => write!(f, "histogram {}: {error}", path.display()),
            Self::Log { path, error } | Self::Converted { path, error } => {
                write!(f, "{}: {error}", path.display())
            }
            Self::Listen { address, error } => write!(f, "--listen {address}: {error}"),
            Self::Root { path } => write!(f, "--root {}: there is no such folder", path.display()),
            Self::Core { core, online } => write!(
                f,
                "--core {core}: the machine has the cores {}",
                write_core_list(online)
            ),
            Self::Scope { address, error } => write!(f, "scope {address}: {error}"),
            Self::Card(error) => write!(f, "card: {error}"),
            Self::Luna(error) => error.fmt(f),
            Self::Output(error) => write!(f, "standard output: {error}"),
        }
    }
}

impl std::error::Error for Failure {}

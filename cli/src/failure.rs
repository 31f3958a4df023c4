//! Why a command failed, and its exit code.

use luna::error::SetupError;
use luna::replay::RecordError;
use luna_jiwy::joystick;
use luna_platform::facts::parse::write_core_list;
use std::net::SocketAddr;
use std::path::PathBuf;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// The joystick's recording cannot be used.
    #[error("joystick {}: {error}", .path.display())]
    Joystick {
        /// Of the recording.
        path: PathBuf,
        /// Why.
        error: joystick::Error,
    },
    /// A replay log cannot be replayed.
    #[error("--replay {}: {error}", .path.display())]
    Recording {
        /// Of the replay log.
        path: PathBuf,
        /// Why.
        error: Box<RecordError>,
    },
    /// The histogram cannot be written.
    #[error("histogram {}: {error}", .path.display())]
    Histogram {
        /// Of the histogram.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// The folder with a machine's files is none.
    #[error("--root {}: there is no such folder", .path.display())]
    Root {
        /// As given.
        path: PathBuf,
    },
    /// The machine has no such core, or it is switched off.
    #[error("--core {core}: the machine has the cores {}", write_core_list(.online))]
    Core {
        /// As given.
        core: usize,
        /// Those that are there.
        online: Vec<usize>,
    },
    /// The card cannot be had.
    #[error("card: {0}")]
    Card(Box<dyn std::error::Error + Send + Sync>),
    /// A recording cannot be read at all.
    #[error("{}: {error}", .path.display())]
    Log {
        /// Of the recording.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// A model file cannot be read or written.
    #[error("{}: {error}", .path.display())]
    ModelFile {
        /// Of the file.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// A model is wrong: with its file, line and column.
    #[error(transparent)]
    Model(Box<luna_model::Problem>),
    /// A package cannot be generated there.
    #[error("{}: {why}", .path.display())]
    Package {
        /// A folder, or a file in it.
        path: PathBuf,
        /// What is wrong, and what to do.
        why: &'static str,
    },
    /// A project cannot have this name.
    #[error("`{name}` cannot be the name of a project: {why}")]
    ProjectName {
        /// As given.
        name: String,
        /// What is wrong, and what to change.
        why: String,
    },
    /// A model cannot be exported to CSPm.
    #[error("{}: {error}", .path.display())]
    Cspm {
        /// Of the model.
        path: PathBuf,
        /// Why.
        error: luna_model::CspmError,
    },
    /// Options that do not go together.
    #[error("{0}")]
    Options(&'static str),
    /// What a recording is converted to cannot be written.
    #[error("{}: {error}", .path.display())]
    Converted {
        /// Of the output.
        path: PathBuf,
        /// Why.
        error: String,
    },
    /// The address cannot be listened on.
    #[error("--listen {address}: {error}")]
    Listen {
        /// As given.
        address: String,
        /// Why.
        error: std::io::Error,
    },
    /// The scope cannot be served.
    #[error("scope {address}: {error}")]
    Scope {
        /// Where.
        address: SocketAddr,
        /// Why.
        error: std::io::Error,
    },
    /// The picture cannot be read.
    #[error("picture {}: {error}", .path.display())]
    Picture {
        /// Of the picture.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// Foxglove cannot be served.
    #[cfg(feature = "foxglove")]
    #[error("--foxglove {address}: {error}")]
    Foxglove {
        /// Where.
        address: SocketAddr,
        /// Why.
        error: std::io::Error,
    },
    /// The system could not be set up, or ended with an error.
    #[error(transparent)]
    Luna(luna::Error),
    /// A channel or blackboard of other programs cannot be used as asked.
    #[cfg(target_os = "linux")]
    #[error("{name}: {error}")]
    Unusable {
        /// Its name.
        name: String,
        /// Why.
        error: String,
    },
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

impl Failure {
    /// 2 for what the user can put right on the command line, as clap has it; 1 for the rest.
    pub(crate) fn exit_code(&self) -> u8 {
        match self {
            Self::Joystick { .. }
            | Self::Recording { .. }
            | Self::Histogram { .. }
            | Self::Root { .. }
            | Self::Log { .. }
            | Self::ModelFile { .. }
            | Self::Model(_)
            | Self::Package { .. }
            | Self::ProjectName { .. }
            | Self::Cspm { .. }
            | Self::Options(_)
            | Self::Converted { .. }
            | Self::Listen { .. }
            | Self::Scope { .. }
            | Self::Picture { .. }
            | Self::Core { .. } => 2,
            #[cfg(feature = "foxglove")]
            Self::Foxglove { .. } => 2,
            Self::Luna(luna::Error::Setup(
                SetupError::NoSuchCore { .. }
                | SetupError::Attributes(_)
                | SetupError::Deployment(_)
                | SetupError::DeploymentFile { .. }
                | SetupError::Parameters(_),
            )) => 2,
            Self::Card(_) => 2,
            Self::Luna(luna::Error::Record(RecordError::NameOfTheLogger { .. })) => 2,
            // A device that cannot be opened; a later loss is the error of a process.
            #[cfg(unix)]
            Self::Luna(luna::Error::Device(_)) => 2,
            #[cfg(target_os = "linux")]
            Self::Unusable { .. } => 2,
            #[cfg(target_os = "linux")]
            Self::BrokenOff { .. } | Self::SharedMemory(_) => 1,
            Self::Luna(_) | Self::Output(_) => 1,
        }
    }
}

//! With the logger.

pub use luna_logger::{
    FileSink, Level, Logging, LoggingReport, MessagesReport, RegisterError, Sample, Signal,
    SignalBuilder, SignalReport, Sink, StartError, TcpSink, Tee, UdpSink, WriterSink,
    install as install_facades, message,
};

use crate::error::{Error, SetupError};
use luna_logger::{Entered, Hub, Recorder, TimeBase};
use std::sync::Arc;

/// The variable of the environment that names where to record to: a file, `tcp://HOST:PORT` or `udp://HOST:PORT`.
const VARIABLE: &str = "LUNA_LOG";

impl From<RegisterError> for Error {
    fn from(error: RegisterError) -> Error {
        Error::Setup(SetupError::Signal(error))
    }
}

/// What the user asks to be recorded.
pub(crate) type Asked = Option<Logging>;

/// A system's logger.
#[derive(Clone)]
pub(crate) struct Log(Arc<Hub>);

impl Log {
    pub(crate) fn new(system: &str, is_virtual: bool) -> Self {
        let base = if is_virtual {
            TimeBase::OfThread
        } else {
            TimeBase::Machine
        };
        Self(Hub::new(system, base))
    }

    /// What the calling thread registers belongs to the system until the guard is dropped.
    pub(crate) fn enter(&self) -> Entered {
        self.0.enter()
    }

    /// What the calling thread registers and records belongs to the system from now on, and there is room for it.
    #[inline]
    pub(crate) fn enter_thread(&self) {
        self.0.enter_thread();
    }

    /// Begins to record, if that is asked for, in the program or by who started it.
    pub(crate) fn start(&self, asked: Asked) -> Result<Session, SetupError> {
        let by_variable = || {
            std::env::var_os(VARIABLE)
                .filter(|path| !path.is_empty())
                .map(Logging::to_place)
        };
        asked
            .or_else(by_variable)
            .map(|recording| Recorder::start(&self.0, recording))
            .transpose()
            .map(Session)
            .map_err(SetupError::Logging)
    }
}

/// A recording that is under way, if there is one.
pub(crate) struct Session(Option<Recorder>);

impl Session {
    /// Ends it.
    pub(crate) fn finish(self) -> Option<LoggingReport> {
        self.0.map(Recorder::finish)
    }
}

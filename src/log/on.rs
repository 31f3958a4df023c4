//! With the logger.

pub use luna_logger::{
    FileSink, Level, Logging, RegisterError, Sample, Signal, SignalBuilder, Sink, StartError,
    TcpSink, Tee, UdpSink, WriterSink, install, message,
};

use super::Shown;
use crate::error::{Result, SetupError};
use crate::notice::notice;
use crate::system::Opening;
use luna_config::parameters::Parameters;
use luna_logger::{Entered, Hub, LoggingReport, Recorder, TimeBase};
use std::sync::Arc;

/// The variable of the environment that names where to record to: a file, `tcp://HOST:PORT` or
/// `udp://HOST:PORT`.
const VARIABLE: &str = "LUNA_LOG";

/// The variable with the number of events that each ring of such a recording has room for.
#[cfg(feature = "events")]
const EVENTS: &str = "LUNA_LOG_EVENTS";

/// The recordings that the user asks for.
pub(crate) type Asked = Option<Logging>;

/// A system's logger.
#[derive(Debug, Clone)]
pub(crate) struct Log(Arc<Hub>);

impl Log {
    pub(crate) fn new(system: &str) -> Self {
        Self(Hub::of_system(system))
    }

    /// A signal of the system to be.
    pub(crate) fn signal<T: Sample>(&self, name: &str) -> SignalBuilder<T> {
        self.0.signal(name)
    }

    /// The calling thread may register signals, which belong to the system, until the guard is
    /// dropped: around each `pre_run`.
    pub(crate) fn enter(&self) -> Entered {
        self.0.enter()
    }

    /// Whether messages are kept.
    pub(crate) fn is_recording(&self) -> bool {
        self.0.is_recording()
    }

    /// From now on, what the calling thread records belongs to the system. Makes room for it.
    #[inline]
    pub(crate) fn enter_thread(&self) {
        self.0.enter_thread();
    }

    /// Chooses the clock, and begins to record, if the program or its environment asks for it.
    pub(crate) fn start(
        &self,
        is_virtual: bool,
        asked: Asked,
        replaces: bool,
        opening: &Opening,
        parameters: Parameters,
    ) -> Result<Session> {
        self.0.set_time(if is_virtual {
            TimeBase::OfThread
        } else {
            TimeBase::Machine
        });
        let by_variable = || {
            std::env::var_os(VARIABLE)
                .filter(|path| !path.is_empty())
                .map(|path| with_events(Logging::to_place(path)))
        };
        let asked = asked.or_else(by_variable);
        #[cfg(feature = "scope")]
        let (asked, shown) = Shown::open(asked, parameters, opening, |sink| {
            let recording = Logging::to_sink(sink);
            #[cfg(feature = "events")]
            let recording = recording.events();
            with_events(recording)
        })?;
        #[cfg(not(feature = "scope"))]
        let (_, shown) = (parameters, Shown::none());
        let Some(recording) = asked else {
            return Ok(Session(None, shown));
        };
        let recording = if replaces {
            recording.replacing()
        } else {
            recording
        };
        let hub = self.0.clone();
        let asked = recording.place();
        let started = opening.wait_for(format!("record to {asked}"), move || {
            Recorder::start(&hub, recording)
        });
        let recorder = started?.map_err(SetupError::Logging)?;
        if recorder.place() != asked {
            let place = recorder.place();
            notice!("luna: {asked} is there already, so this run is recorded to {place}");
        }
        let session = Session(Some(recorder), shown);
        #[cfg(feature = "events")]
        if self.0.records_events() {
            // Those that are made from now on are named as they are made.
            for place in luna_channels::inspect::wait_points() {
                if let Some(kind) = place.kind.in_events() {
                    let (number, of) = (place.id as u32, place.buffer_in_events());
                    self.0.name(kind, number, of, place.name_in_events());
                }
            }
        }
        Ok(session)
    }

    /// A process is about to run on the calling thread, or on the executor that it is now.
    #[inline]
    pub(crate) fn enter_executor(&self) {
        #[cfg(feature = "events")]
        self.0.enter_executor();
    }

    /// Records an event that happens outside of executors.
    #[cfg_attr(
        not(feature = "events"),
        expect(unused_variables, reason = "there are none")
    )]
    pub(crate) fn report(&self, code: u16, of: u32, arguments: [u64; 2]) {
        #[cfg(feature = "events")]
        self.0.report(code, of, arguments);
    }
}

/// With events, if the environment asks for them.
fn with_events(recording: Logging) -> Logging {
    #[cfg(feature = "events")]
    if let Some(room) = std::env::var(EVENTS)
        .ok()
        .and_then(|room| room.parse().ok())
    {
        return recording.room_for_events(room);
    }
    recording
}

/// A recording that is under way, if there is one, and the scope that shows it.
pub(crate) struct Session(Option<Recorder>, Shown);

impl Session {
    /// Ends it; once it `is_hurried`, without a wait for the sink.
    pub(crate) fn finish(self, is_hurried: impl Fn() -> bool) -> (Option<LoggingReport>, Shown) {
        let Self(recorder, shown) = self;
        (
            recorder.map(|recorder| recorder.finish_unless(is_hurried)),
            shown,
        )
    }
}

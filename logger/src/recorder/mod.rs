//! Who moves what the rings hold to where it is kept.
//!
//! ```text
//!   rings of all threads ── merged by time ──> encoder ── a block ──> sink
//!                            every round                  (file)
//! ```
//!
//! It works in rounds, on an ordinary thread, and nobody wakes it: the real-time path makes no system call for it. `queue` is a ring's reading end, `timeline` turns
//! counter ticks into nanoseconds, `output` makes blocks and counts, `drain` is the thread, `sink` where blocks go.

mod drain;
#[cfg(feature = "events")]
mod events;
mod output;
mod queue;
mod report;
mod sink;
mod timeline;

#[cfg(feature = "events")]
pub use report::EventsReport;
pub use report::{LoggingReport, MessagesReport, SignalReport};
pub use sink::{FileSink, Sink, WriterSink};

use crate::format::{Encoder, Level};
use crate::hub::{Hub, Rooms};
use drain::Drain;
use luna_platform::thread::{Attributes, Policy, Thread, spawn};
use std::convert::Infallible;
use std::fmt;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

/// Where a recording goes, and how much room there is on the way.
///
/// ```
/// use luna_logger::{Level, Logging};
/// use std::time::Duration;
///
/// let recording = Logging::to_file("run.luna")
///     .room_for_samples(100_000) // of each thread, until they are moved on
///     .every(Duration::from_millis(5))
///     .show_messages(Level::Warn);
/// assert!(format!("{recording:?}").contains("run.luna"));
/// ```
#[derive(Debug)]
pub struct Logging {
    target: Target,
    rooms: Rooms,
    period: Duration,
    show: Option<Level>,
}

enum Target {
    File(PathBuf),
    Sink(Box<dyn Sink>),
}

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Target::File(path) => path.fmt(f),
            Target::Sink(_) => f.write_str("a sink"),
        }
    }
}

impl Logging {
    /// Into a new file; one that is there is replaced.
    pub fn to_file(path: impl Into<PathBuf>) -> Self {
        Self::to(Target::File(path.into()))
    }

    /// Into something else.
    pub fn to_sink(sink: impl Sink + 'static) -> Self {
        Self::to(Target::Sink(Box::new(sink)))
    }

    fn to(target: Target) -> Self {
        Self {
            target,
            // For a million samples a second, three rounds long.
            rooms: Rooms {
                samples: 3 * 32_768,
                messages: 8192,
                #[cfg(feature = "events")]
                events: 0,
            },
            period: Duration::from_millis(10),
            show: None,
        }
    }

    /// Makes room for so many samples of one element in each thread's ring; 32 768 if not stated. What they take is allocated when the thread starts: 24 bytes each. A sample of `n`
    /// elements takes 16 + 8 n bytes.
    pub fn room_for_samples(mut self, samples: usize) -> Self {
        self.rooms.samples = samples.saturating_mul(3).min(MOST_ROOM);
        self
    }

    /// Makes room for so many bytes of messages in each thread's other ring, at 32 a message beside its text; 64 KiB if not stated.
    pub fn room_for_messages(mut self, bytes: usize) -> Self {
        self.rooms.messages = bytes.div_ceil(8).min(MOST_ROOM);
        self
    }

    /// Records CSP events too, with room for 65 536 in the ring of each executor and OS-thread process.
    #[cfg(feature = "events")]
    pub fn events(self) -> Self {
        self.room_for_events(1 << 16)
    }

    /// Records CSP events too, with room for so many in the ring of each executor and OS-thread process, rounded up to a power of two; 0 is none. What they take is
    /// allocated when the thread starts: 32 bytes each.
    ///
    /// ```
    /// use luna_logger::Logging;
    /// let recording = Logging::to_file("run.luna").room_for_events(10_000);
    /// # drop(recording);
    /// ```
    #[cfg(feature = "events")]
    pub fn room_for_events(mut self, events: usize) -> Self {
        self.rooms.events = events.min(MOST_ROOM / 4);
        self
    }

    /// Moves on what the rings hold every so often, 1 ms to 10 s; 10 ms if not stated. What a killed program leaves is complete but for the last such time.
    pub fn every(mut self, period: Duration) -> Self {
        self.period = period.clamp(Duration::from_millis(1), Duration::from_secs(10));
        self
    }

    /// Shows messages of `most` and what matters more on standard error too, from the recorder's thread.
    pub fn show_messages(mut self, most: Level) -> Self {
        self.show = Some(most);
        self
    }
}

/// The most words of a ring: 1 GiB.
const MOST_ROOM: usize = 1 << 27;

/// The thread that records. Dropping it ends the recording as [`finish`](Self::finish) does.
#[must_use = "the recording ends when this is dropped"]
pub struct Recorder {
    hub: Arc<Hub>,
    to: String,
    thread: Option<Thread<LoggingReport>>,
    ending: Arc<Ending>,
}

impl Recorder {
    /// Begins to record what the threads of `hub` do. To be called before they enter it, so that their rings are made then.
    ///
    /// Not for the real-time path: it opens the file and makes a thread, which has no real-time policy.
    ///
    /// # Errors
    ///
    /// The file cannot be made, or the thread, or the hub records already.
    pub fn start(hub: &Arc<Hub>, recording: Logging) -> Result<Recorder, StartError> {
        let Logging {
            target,
            rooms,
            period,
            show,
        } = recording;
        let (to, sink) = match target {
            Target::File(path) => {
                let to = path.display().to_string();
                (
                    to,
                    FileSink::create(&path).map(|sink| Box::new(sink) as Box<dyn Sink>),
                )
            }
            Target::Sink(sink) => ("a sink".to_owned(), Ok(sink)),
        };
        let sink = sink
            .and_then(|mut sink| sink.begin(&Encoder::head()).map(|()| sink))
            .map_err(|error| StartError::Sink {
                to: to.clone(),
                error: error.to_string(),
            })?;
        if !hub.begin_recording(rooms) {
            return Err(StartError::Twice);
        }
        let ending = Arc::new(Ending::default());
        let drain = Drain::new(hub.clone(), to.clone(), sink, show);
        let awaited = ending.clone();
        let started = spawn(
            Attributes::framework("luna-recorder", Policy::Other),
            move |_| Ok::<_, Infallible>(drain),
            move |drain| drain.run(|| awaited.wait(period)),
        );
        match started {
            Ok(thread) => Ok(Recorder {
                hub: hub.clone(),
                to,
                thread: Some(thread),
                ending,
            }),
            Err(error) => {
                hub.end_recording();
                Err(StartError::Thread(error.to_string()))
            }
        }
    }

    /// Ends the recording: writes what the rings hold, and says what became of all samples and messages. To be called when the threads have ended, or do not record any
    /// more: what they record meanwhile may be missing without being counted.
    ///
    /// Waits as long as the sink takes.
    pub fn finish(mut self) -> LoggingReport {
        self.stop()
            .unwrap_or_else(|| LoggingReport::broken(std::mem::take(&mut self.to)))
    }

    fn stop(&mut self) -> Option<LoggingReport> {
        let thread = self.thread.take()?;
        self.hub.end_recording();
        self.ending.end();
        thread.join().ok()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

impl fmt::Debug for Recorder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recorder")
            .field("to", &self.to)
            .finish_non_exhaustive()
    }
}

/// How the thread is told to end.
#[derive(Default)]
struct Ending {
    has_come: Mutex<bool>,
    comes: Condvar,
}

impl Ending {
    fn end(&self) {
        *self.has_come.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.comes.notify_all();
    }

    /// Waits for `period`, or until the end has come, which it says.
    fn wait(&self, period: Duration) -> bool {
        let has_come = self.has_come.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self
            .comes
            .wait_timeout_while(has_come, period, |has_come| !*has_come);
        *waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Why a recording cannot begin.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum StartError {
    /// Where it is to go cannot be written.
    Sink {
        /// Where that is.
        to: String,
        /// The system's words.
        error: String,
    },
    /// The recorder's thread could not be made.
    Thread(String),
    /// The hub records already, or has done.
    Twice,
}

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StartError::Sink { to, error } => write!(f, "cannot record to {to}: {error}"),
            StartError::Thread(error) => write!(f, "cannot record: {error}"),
            StartError::Twice => f.write_str("a hub is recorded once"),
        }
    }
}

impl std::error::Error for StartError {}

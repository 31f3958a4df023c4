//! Who moves what the rings hold to where it is kept.
//!
//! ```text
//!   rings of all threads ── merged by time ──> encoder ── a block ──> sink
//!                            every round                  (file)
//! ```
//!
//! It works in rounds, on an ordinary thread, and nobody wakes it: the real-time path makes no system call for it. `queue` is a ring's reading end, `timeline` turns
//! counter ticks into nanoseconds, `output` makes blocks and counts, `drain` is the thread, `sink` where blocks go, `tee` to several of them, `handoff` the thread that a sink
//! works on, `show` the one that shows messages.

mod drain;
#[cfg(feature = "events")]
mod events;
mod handoff;
mod monitor;
mod output;
mod queue;
mod report;
mod show;
mod sink;
mod tee;
mod timeline;

#[cfg(feature = "events")]
pub use report::EventsReport;
pub use report::{LoggingReport, MessagesReport, SignalReport};
pub use sink::{FileSink, Sink, WriterSink};
pub use tee::Tee;

use crate::format::{Encoder, Level};
use crate::hub::{Hub, Rooms};
use crate::net::{TcpSink, UdpSink};
use drain::Drain;
use handoff::{Handoff, Limiter};
use luna_platform::thread::{Attributes, Policy, Thread, spawn};
use output::Way;
use show::Show;
use std::convert::Infallible;
use std::ffi::OsStr;
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
    sync: Option<Duration>,
    end_within: Duration,
}

enum Target {
    File(PathBuf),
    Sink(String, Box<dyn Sink>),
}

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Target::File(path) => path.fmt(f),
            Target::Sink(to, _) => f.write_str(to),
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
        Self::to(Target::Sink("a sink".to_owned(), Box::new(sink)))
    }

    /// To a [`Receiver`](crate::Receiver) over TCP, such as `luna record --listen ADDR` on another computer: `address` is `HOST:PORT`.
    ///
    /// It need not be there: the connection is made in the background, and again when it is lost. What is not acknowledged waits in the memory, at most 4 MiB of blocks;
    /// then blocks are refused, lost and counted. What is recorded, by the report, is acknowledged. See [`TcpSink`]. At the end it waits two seconds at most, unless
    /// [`end_within`](Self::end_within) says otherwise.
    ///
    /// ```
    /// use luna_logger::{Hub, Logging, Recorder};
    ///
    /// let hub = Hub::new("bench", Default::default());
    /// let nobody = Logging::to_tcp("localhost:9").end_within(std::time::Duration::ZERO);
    /// let report = Recorder::start(&hub, nobody)?.finish();
    /// assert!(report.error.is_some());
    /// # Ok::<(), luna_logger::StartError>(())
    /// ```
    pub fn to_tcp(address: impl Into<String>) -> Self {
        let address = address.into();
        let to = format!("{TCP}{address}");
        Self::to(Target::Sink(to, Box::new(TcpSink::new(address)))).end_within(AT_PEERS)
    }

    /// To a [`Receiver`](crate::Receiver) by UDP datagrams: `address` is `HOST:PORT`. Nobody acknowledges them: recorded, by the report, is what was sent, and the receiver counts
    /// what does not come. See [`UdpSink`].
    ///
    /// ```
    /// use luna_logger::Logging;
    /// assert!(format!("{:?}", Logging::to_udp("localhost:9000")).contains("udp://localhost:9000"));
    /// ```
    pub fn to_udp(address: impl Into<String>) -> Self {
        let address = address.into();
        let to = format!("{UDP}{address}");
        Self::to(Target::Sink(to, Box::new(UdpSink::new(address)))).end_within(AT_PEERS)
    }

    /// To what a text names: `tcp://HOST:PORT`, `udp://HOST:PORT`, or a file.
    ///
    /// ```
    /// use luna_logger::Logging;
    /// assert!(format!("{:?}", Logging::to_place("tcp://localhost:9000")).contains("tcp://"));
    /// assert!(format!("{:?}", Logging::to_place("run.luna")).contains("\"run.luna\""));
    /// ```
    pub fn to_place(place: impl AsRef<OsStr>) -> Self {
        let place = place.as_ref();
        let text = place.to_str().unwrap_or_default();
        if let Some(address) = text.strip_prefix(TCP) {
            Self::to_tcp(address)
        } else if let Some(address) = text.strip_prefix(UDP) {
            Self::to_udp(address)
        } else {
            Self::to_file(place)
        }
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
            sync: None,
            end_within: AT_END,
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

    /// Shows messages of `most` and what matters more on standard error too, from a thread of its own. If nobody reads there fast enough, at most 1 MiB of lines waits; what has no room is
    /// recorded, not shown, and its number told there. The end waits for them one second at most.
    pub fn show_messages(mut self, most: Level) -> Self {
        self.show = Some(most);
        self
    }

    /// Has a file's blocks brought to the disk (`fdatasync`) when so much time has gone by since that was done last, and at the end. If not stated, the kernel does that when it
    /// likes: a program that is killed loses nothing by it, but a power failure does. The recorder waits for the disk meanwhile, so the rings have to hold as much longer.
    pub fn sync_every(mut self, period: Duration) -> Self {
        self.sync = Some(period);
        self
    }

    /// Waits at most so long for the sink when the recording ends, at most a day; 10 s if not stated, and 2 s for a recorder on another computer. What it has not taken until then is lost, and counted as
    /// such; a block that is under way counts as lost too, though the sink may take it still. A sink that does not answer is waited for five seconds more; then its thread is
    /// left alone with it. One that has answered by then is asked to end, and waited for five seconds again at most, until it has: in all the limit and ten seconds. One that is left alone
    /// cannot say what it has lost of what it had taken before: that still counts as recorded.
    pub fn end_within(mut self, limit: Duration) -> Self {
        self.end_within = limit;
        self
    }
}

/// What a place begins with that is on another computer.
const TCP: &str = "tcp://";
const UDP: &str = "udp://";

/// How long the end of a recording waits at most, for a sink here and for one on another computer.
const AT_END: Duration = Duration::from_secs(10);
const AT_PEERS: Duration = Duration::from_secs(2);

/// The most words of a ring: 1 GiB.
const MOST_ROOM: usize = 1 << 27;

/// The thread that records. Dropping it ends the recording as [`finish`](Self::finish) does.
#[must_use = "the recording ends when this is dropped"]
pub struct Recorder {
    hub: Arc<Hub>,
    to: String,
    thread: Option<Thread<LoggingReport>>,
    ending: Arc<Ending>,
    limiter: Limiter,
    end_within: Duration,
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
            sync,
            end_within,
        } = recording;
        let (to, sink) = match target {
            Target::File(path) => {
                let to = path.display().to_string();
                (
                    to,
                    FileSink::create(&path).map(|sink| {
                        Box::new(match sync {
                            Some(period) => sink.sync_every(period),
                            None => sink,
                        }) as Box<dyn Sink>
                    }),
                )
            }
            Target::Sink(to, sink) => (to, Ok(sink)),
        };
        let sink = sink
            .and_then(|mut sink| {
                sink.is_of(&hub.system);
                sink.begin(&Encoder::head()).map(|()| sink)
            })
            .map_err(|error| StartError::Sink {
                to: to.clone(),
                error: error.to_string(),
            })?;
        let show = match show {
            Some(most) => Some((most, Show::start().map_err(StartError::Thread)?)),
            None => None,
        };
        let begun = hub.begin_recording(rooms).ok_or(StartError::Twice)?;
        let block_size = sink.block_size();
        let sink = Handoff::start(sink).map_err(|error| {
            hub.end_recording();
            StartError::Thread(error)
        })?;
        let limiter = sink.limiter();
        let ending = Arc::new(Ending::default());
        let way = Way {
            sink,
            block_size,
            begun,
        };
        let drain = Drain::new(hub.clone(), to.clone(), way, show);
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
                limiter,
                end_within,
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
    /// Waits as long as the sink takes, at most as long as [`Logging::end_within`] says, and the ten seconds more that it names; and one second for messages
    /// that are shown.
    pub fn finish(mut self) -> LoggingReport {
        self.stop()
            .unwrap_or_else(|| LoggingReport::broken(std::mem::take(&mut self.to)))
    }

    fn stop(&mut self) -> Option<LoggingReport> {
        let thread = self.thread.take()?;
        self.hub.end_recording();
        self.limiter.end_within(self.end_within);
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
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// Where it is to go cannot be written.
    #[error("cannot record to {to}: {error}")]
    Sink {
        /// Where that is.
        to: String,
        /// The system's words.
        error: String,
    },
    /// The recorder's thread could not be made.
    #[error("cannot record: {0}")]
    Thread(String),
    /// The hub records already, or has done.
    #[error("a hub is recorded once")]
    Twice,
}

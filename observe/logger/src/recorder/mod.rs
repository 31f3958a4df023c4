//! The recorder: moves entries from the rings to the sink.
//!
//! ```text
//!   rings of all threads ── merged by time ──> encoder ── a block ──> sink
//!                            every round                  (file)
//! ```
//!
//! It works in rounds on an ordinary thread. It is not woken by the real-time path, which therefore
//! makes no system call for it. `queue` is a ring's reading end, `timeline` converts counter ticks
//! to nanoseconds, `output` makes blocks and counts, `drain` is the thread, `sink` has the sinks,
//! `tee` the one that copies to several, `handoff` the sink's thread, `show` the thread that shows
//! messages.

mod drain;
#[cfg(feature = "events")]
mod events;
mod handoff;
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
use crate::thread::start;
use drain::Drain;
use handoff::{Handoff, Limiter};
use luna_platform::thread::Thread;
use output::Way;
use show::Show;
use std::ffi::OsStr;
use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
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
    replaces: bool,
    beside: Beside,
}

/// Sinks beside the first one.
#[derive(Default)]
struct Beside(Vec<Box<dyn Sink>>);

luna_platform::debug_fields!(Beside, |beside| sinks: beside.0.len());

enum Target {
    File(PathBuf),
    Sink(Box<dyn Sink>),
}

impl fmt::Debug for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Target::File(path) => path.fmt(f),
            Target::Sink(sink) => f.write_str(&sink.place()),
        }
    }
}

impl Logging {
    /// Into a new file. What is there stays: if the name is taken, also by a program that records
    /// to it now, the recording goes to the first free one of `run-2.luna`, `run-3.luna` and so on,
    /// which the report names. A name that ends in `.replay` is refused when the recording begins:
    /// that is a replay log.
    pub fn to_file(path: impl Into<PathBuf>) -> Self {
        Self::to(Target::File(path.into()))
    }

    /// Replaces the file of [`to_file`](Self::to_file) if it is there: its former content is lost.
    /// One that another program writes is an error.
    ///
    /// ```
    /// use luna_logger::Logging;
    /// let recording = Logging::to_file("last-run.luna").replacing();
    /// # drop(recording);
    /// ```
    pub fn replacing(mut self) -> Self {
        self.replaces = true;
        self
    }

    /// Into something else.
    pub fn to_sink(sink: impl Sink + 'static) -> Self {
        Self::to(Target::Sink(Box::new(sink)))
    }

    /// Records to a [`Receiver`](crate::Receiver) over TCP, such as `luna record --listen ADDR` on
    /// another computer: `address` is `HOST:PORT`.
    ///
    /// The receiver may be absent: the connection is made in the background, and again when it is
    /// lost. Blocks wait in memory, at most 4 MiB, until they are acknowledged; beyond that they
    /// are refused, lost and counted. The report counts acknowledged data as recorded. See
    /// [`TcpSink`]. At the end it waits at most two seconds, unless
    /// [`end_within`](Self::end_within) sets another limit.
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
        Self::to_sink(TcpSink::new(address)).end_within(AT_PEERS)
    }

    /// Records to a [`Receiver`](crate::Receiver) by UDP datagrams: `address` is `HOST:PORT`. There
    /// are no acknowledgements: the report counts sent data as recorded, and the receiver counts
    /// missing blocks. See [`UdpSink`].
    ///
    /// ```
    /// use luna_logger::Logging;
    /// assert!(
    ///     format!("{:?}", Logging::to_udp("localhost:9000")).contains("udp://localhost:9000")
    /// );
    /// ```
    pub fn to_udp(address: impl Into<String>) -> Self {
        Self::to_sink(UdpSink::new(address)).end_within(AT_PEERS)
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

    /// Where it goes, as the report and errors name it.
    ///
    /// ```
    /// assert_eq!(luna_logger::Logging::to_file("run.luna").place(), "run.luna");
    /// ```
    pub fn place(&self) -> String {
        match &self.target {
            Target::File(path) => path.display().to_string(),
            Target::Sink(sink) => sink.place(),
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
            replaces: false,
            beside: Beside::default(),
        }
    }

    /// Into `sink` too, as [`Tee`] has it: what it refuses is missing there alone.
    ///
    /// ```
    /// use luna_logger::{Hub, Logging, Recorder, WriterSink};
    ///
    /// let hub = Hub::new("bench", Default::default());
    /// let first = WriterSink::new(std::io::sink());
    /// let recording = Logging::to_sink(first).beside(WriterSink::new(std::io::sink()));
    /// let report = Recorder::start(&hub, recording)?.finish();
    /// assert!(report.error.is_none());
    /// # Ok::<(), luna_logger::StartError>(())
    /// ```
    pub fn beside(mut self, sink: impl Sink + 'static) -> Self {
        self.beside.0.push(Box::new(sink));
        self
    }

    /// Room in each thread's ring, in samples of one element; default 32 768. It is allocated when
    /// the thread starts: 24 bytes each. A sample of `n` elements takes 16 + 8 n bytes.
    pub fn room_for_samples(mut self, samples: usize) -> Self {
        self.rooms.samples = samples.saturating_mul(3).min(MAX_ROOM);
        self
    }

    /// Room for messages in each thread's other ring, in bytes: a message takes 32 and its text;
    /// default 64 KiB.
    pub fn room_for_messages(mut self, bytes: usize) -> Self {
        self.rooms.messages = bytes.div_ceil(8).min(MAX_ROOM);
        self
    }

    /// Records CSP events too, with room for 65 536 in the ring of each executor and OS-thread
    /// process.
    #[cfg(feature = "events")]
    pub fn events(self) -> Self {
        self.room_for_events(1 << 16)
    }

    /// Records CSP events too, with room for `events` of them in the ring of each executor and
    /// OS-thread process, rounded up to a power of two; 0 turns them off. It is allocated when the
    /// thread starts: 32 bytes each.
    ///
    /// ```
    /// use luna_logger::Logging;
    /// let recording = Logging::to_file("run.luna").room_for_events(10_000);
    /// # drop(recording);
    /// ```
    #[cfg(feature = "events")]
    pub fn room_for_events(mut self, events: usize) -> Self {
        self.rooms.events = events.min(MAX_ROOM / 4);
        self
    }

    /// The period of the recorder's rounds, 1 ms to 10 s; default 10 ms. A killed program leaves
    /// all entries but those of the last period.
    pub fn every(mut self, period: Duration) -> Self {
        self.period = period.clamp(Duration::from_millis(1), Duration::from_secs(10));
        self
    }

    /// Shows messages of level `most` or more severe on standard error too, from a thread of its
    /// own. At most 1 MiB of lines waits for a slow reader; messages beyond that are recorded, but
    /// not shown, and their number is shown. The end waits at most one second for them.
    pub fn show_messages(mut self, most: Level) -> Self {
        self.show = Some(most);
        self
    }

    /// Writes a file's blocks to the disk (`fdatasync`) when this time has passed since the last
    /// time, and at the end. Without it the kernel decides when: a killed program loses nothing by
    /// that, but a power failure does. The recorder waits for the disk meanwhile, so the rings need
    /// that much more room.
    pub fn sync_every(mut self, period: Duration) -> Self {
        self.sync = Some(period);
        self
    }

    /// The longest wait for the sink when the recording ends, at most a day; default 10 s, and 2 s
    /// for a recorder on another computer. What the sink has not taken by then counts as lost, also
    /// a block in progress, though the sink may still take it.
    ///
    /// A sink that does not answer gets five more seconds; then its thread is detached. A sink that
    /// has answered is asked to end, and gets another five seconds for that: the limit and ten
    /// seconds in all. A detached sink cannot report losses among what it had taken: that still
    /// counts as recorded.
    pub fn end_within(mut self, limit: Duration) -> Self {
        self.end_within = limit;
        self
    }
}

/// The sink, with those beside it.
fn with_others(sink: Box<dyn Sink>, Beside(beside): Beside) -> Box<dyn Sink> {
    match beside.is_empty() {
        true => sink,
        false => Box::new(beside.into_iter().fold(Tee::of(sink), Tee::and_boxed)),
    }
}

/// What a place begins with that is on another computer.
pub(crate) const TCP: &str = "tcp://";
pub(crate) const UDP: &str = "udp://";

/// Default limits at the end of a recording, for a sink here and for one on another computer.
const AT_END: Duration = Duration::from_secs(10);
const AT_PEERS: Duration = Duration::from_secs(2);

/// How long a sink has once the end is hurried, and the longest pause between two looks at that.
const HURRIED: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_millis(5);

/// The most words of a ring: 1 GiB.
const MAX_ROOM: usize = 1 << 27;

/// The thread that records. Dropping it ends the recording as [`finish`](Self::finish) does.
#[must_use = "the recording ends when this is dropped"]
pub struct Recorder {
    hub: Arc<Hub>,
    to: String,
    thread: Option<Thread<LoggingReport>>,
    running: Option<mpsc::Sender<()>>,
    limiter: Limiter,
    end_within: Duration,
}

impl Recorder {
    /// Starts recording the threads of `hub`. Call it before they enter the hub, so that their
    /// rings are created then.
    ///
    /// Not for the real-time path: it opens the file and creates a thread without real-time policy.
    ///
    /// # Errors
    ///
    /// The file or the thread cannot be created, or the hub records already.
    pub fn start(hub: &Arc<Hub>, recording: Logging) -> Result<Recorder, StartError> {
        let Logging {
            target,
            rooms,
            period,
            show,
            sync,
            end_within,
            replaces,
            beside,
        } = recording;
        let (to, sink) = match target {
            Target::File(path) => {
                let sink = match replaces {
                    true => FileSink::replace(&path),
                    false => FileSink::create_numbered(&path),
                };
                let to = sink
                    .as_ref()
                    .map_or_else(|_| path.display().to_string(), FileSink::place);
                let sink = sink.map(|sink| -> Box<dyn Sink> {
                    Box::new(match sync {
                        Some(period) => sink.sync_every(period),
                        None => sink,
                    })
                });
                (to, sink)
            }
            Target::Sink(sink) => (sink.place(), Ok(sink)),
        };
        let no_thread = |error: io::Error| StartError::Thread(error.to_string());
        let sink = sink
            .map(|sink| with_others(sink, beside))
            .and_then(|mut sink| {
                sink.is_of(&hub.system);
                sink.begin(&Encoder::head()).map(|()| sink)
            })
            .map_err(|error| StartError::Sink {
                to: to.clone(),
                error: error.to_string(),
            })?;
        let show = match show {
            Some(most) => Some((most, Show::start().map_err(no_thread)?)),
            None => None,
        };
        let begun = hub.begin_recording(rooms).ok_or(StartError::Twice)?;
        let block_size = sink.block_size();
        let sink = Handoff::start(sink).map_err(|error| {
            hub.end_recording();
            no_thread(error)
        })?;
        let limiter = sink.limiter();
        // The thread ends when the sender is dropped.
        let (running, stopped) = mpsc::channel::<()>();
        let way = Way {
            sink,
            block_size,
            begun,
        };
        let drain = Drain::new(hub.clone(), to.clone(), way, show);
        let wait = move || stopped.recv_timeout(period) == Err(RecvTimeoutError::Disconnected);
        let thread = start("luna-recorder", move || drain.run(wait)).map_err(|error| {
            hub.end_recording();
            no_thread(error)
        })?;
        Ok(Recorder {
            hub: hub.clone(),
            to,
            thread: Some(thread),
            running: Some(running),
            limiter,
            end_within,
        })
    }

    /// Where it records to, as the report names it: the file that it has got.
    pub fn place(&self) -> &str {
        &self.to
    }

    /// Ends the recording: writes the rest of the rings, and reports what became of all samples and
    /// messages. Call it when the threads have ended or do not record any more: what they record
    /// meanwhile may be missing without being counted.
    ///
    /// Waits for the sink, at most the limit of [`Logging::end_within`] and the ten seconds named
    /// there, and one second for messages that are shown.
    pub fn finish(self) -> LoggingReport {
        self.finish_unless(|| false)
    }

    /// As [`finish`](Self::finish); once it `is_hurried`, the sink gets a twentieth of a second
    /// more. What it has not taken by then is lost and counted, and its thread is detached. For a
    /// program that is asked to end meanwhile. `is_hurried` is asked every few milliseconds.
    ///
    /// ```
    /// use luna_logger::{Hub, Logging, Recorder};
    ///
    /// let hub = Hub::new("bench", Default::default());
    /// let recorder = Recorder::start(&hub, Logging::to_tcp("localhost:9"))?;
    /// assert!(recorder.finish_unless(|| true).error.is_some());
    /// # Ok::<(), luna_logger::StartError>(())
    /// ```
    pub fn finish_unless(mut self, is_hurried: impl Fn() -> bool) -> LoggingReport {
        self.stop(&is_hurried)
            .unwrap_or_else(|| LoggingReport::broken(std::mem::take(&mut self.to)))
    }

    fn stop(&mut self, is_hurried: &dyn Fn() -> bool) -> Option<LoggingReport> {
        let thread = self.thread.take()?;
        self.hub.end_recording();
        self.limiter.end_within(self.end_within);
        self.running = None;
        let mut pause = Duration::from_micros(20);
        while !thread.is_finished() {
            if is_hurried() {
                self.limiter.give_up_within(HURRIED);
                break;
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
        thread.join().ok()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        let _ = self.stop(&|| false);
    }
}

luna_platform::debug_fields!(Recorder, |recorder| to: recorder.to);

/// Why a recording cannot begin.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// Where it is to go cannot be written.
    #[error("cannot record to {to}: {error}")]
    Sink {
        /// Where that is.
        to: String,
        /// The system's error.
        error: String,
    },
    /// The recorder's thread could not be made.
    #[error("cannot record: {0}")]
    Thread(String),
    /// The hub records already, or has done.
    #[error("a hub is recorded once")]
    Twice,
}

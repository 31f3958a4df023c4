//! Recording a run, and replaying it: see [`System::record`](crate::System::record) and
//! [`System::replay`](crate::System::replay).
//!
//! A process that communicates by channels with one sender and one receiver, and makes no choices,
//! sees the same in every run, however long anything takes (Kahn, 1974). So only nondeterministic
//! events are recorded: which guard an alternative chose, whether an operation at once or with a
//! timeout succeeded, the clock as it was read, how an operation failed, what came from outside
//! ([`input`]), and in which order processes got through where several compete. A replay on a
//! virtual clock reproduces all that, and compares what goes outside ([`output`]).
//! `docs/record-and-replay.md` lists what is recorded, and what is not.
//!
//! ```
//! use luna::prelude::*;
//! use luna::replay::{self, Recording};
//!
//! fn system(read: impl Fn() -> u32 + Send + 'static) -> luna::Result<System> {
//!     let mut system = System::new("thermometer");
//!     let main = system.executor("main").build()?;
//!     main.process("display").spawn(async move {
//!         let degrees = replay::input("sensor", read);
//!         replay::output("display", &(degrees * 10));
//!         Ok(())
//!     })?;
//!     Ok(system)
//! }
//!
//! # let path = std::env::temp_dir().join(format!("luna-record-doc-{}", std::process::id()));
//! let mut recorded = system(|| 21)?;
//! recorded.record(&path);
//! recorded.run()?;
//!
//! let mut replayed = system(|| unreachable!("the outside is not touched"))?;
//! replayed.replay(&Recording::open(&path)?);
//! replayed.run()?;
//! # std::fs::remove_file(&path).unwrap();
//! # Ok::<(), luna::Error>(())
//! ```

mod error;
mod event;
mod file;
pub(crate) mod recorder;
mod recording;
mod replayer;
mod value;

pub use error::{Divergence, RecordError};
pub(crate) use recorder::ROOM;
pub use recording::Recording;
pub use value::Value;

use crate::error::Result;
use crate::system::Opening;
use luna_core::ProcessSpec;
use luna_core::current;
use luna_core::replay_log::{About, Event, LogInstaller, Turn};
use recorder::{RecordReport, Recorder};
use replayer::Replayer;
use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
pub(crate) use value::LONGEST;
use value::name_of;

/// Whether the process that calls this is recorded or replayed: for what can be done in two ways,
/// of which one cannot be recorded. Real-time path: yes; O(1).
///
/// ```
/// assert!(!luna::replay::is_recorded());
/// ```
pub fn is_recorded() -> bool {
    current::has_replay_log()
}

/// Takes a value from outside: calls `read` and records what it gave; in a replay gives what was
/// recorded, and does not call it.
///
/// For all that comes from elsewhere than from other processes: a sensor's register, a device, a
/// random number. Outside of a recorded process it is `read` alone. Real-time path: yes; O(size of
/// the value), no allocation, no lock. In a replay that has [diverged](RecordError::Diverged) the
/// value is that of zero bytes.
///
/// ```
/// assert_eq!(luna::replay::input("sensor", || 7_u16), 7);
/// ```
pub fn input<T: Value>(name: &str, read: impl FnOnce() -> T) -> T {
    const { assert!(T::SIZE <= LONGEST, "a value has at most 256 bytes") };
    if !current::has_replay_log() {
        return read();
    }
    let mut bytes = [0; LONGEST];
    let bytes = &mut bytes[..T::SIZE];
    let mut given = None;
    input_bytes(name, bytes, |bytes| given.insert(read()).write(bytes));
    given.unwrap_or_else(|| T::read(bytes))
}

/// As [`input`], for bytes that `fill` writes: returns whether the recording gave them instead.
pub(crate) fn input_bytes(name: &str, bytes: &mut [u8], fill: impl FnOnce(&mut [u8])) -> bool {
    let name = name_of(name);
    match current::replay_log(|log| log.is_replay()) {
        None => false,
        Some(true) => current::replay_log(|log| log.get(About::Input, name, bytes).is_some())
            .unwrap_or_default(),
        Some(false) => {
            // Outside of the log: it may be the user's code.
            fill(bytes);
            current::replay_log(|log| log.put(About::Input, name, bytes));
            false
        }
    }
}

/// Passes what goes outside, so that a replay compares it: the first difference ends the replay
/// with [`RecordError::Diverged`].
///
/// It does not deliver the value: that is done beside it. Real-time path: yes; O(size of the
/// value), no allocation, no lock.
///
/// ```
/// luna::replay::output("motor", &0.5_f64);
/// ```
pub fn output<T: Value>(name: &str, value: &T) {
    const { assert!(T::SIZE <= LONGEST, "a value has at most 256 bytes") };
    if current::has_replay_log() {
        let mut bytes = [0; LONGEST];
        value.write(&mut bytes[..T::SIZE]);
        current::replay_log(|log| log.put(About::Output, name_of(name), &bytes[..T::SIZE]));
    }
}

/// A cycle of a periodic loop: its data.
const CYCLE: u32 = 0;

/// Lets a loop's wait in. `true`: it is replayed, and does not wait for the time.
pub(crate) async fn enters_cycle() -> bool {
    enters().await;
    current::replay_log(|log| log.is_replay()).unwrap_or_default()
}

/// Records a loop's cycle.
pub(crate) fn note_cycle(cycle: [u64; 4]) {
    let mut bytes = [0; 32];
    cycle.write(&mut bytes);
    current::replay_log(|log| log.put(About::Cycle, CYCLE, &bytes));
}

/// The cycle of a replayed loop.
pub(crate) fn cycle() -> Option<[u64; 4]> {
    let mut bytes = [0; 32];
    current::replay_log(|log| log.get(About::Cycle, CYCLE, &mut bytes)).flatten()?;
    Some(<[u64; 4]>::read(&bytes))
}

/// Waits until the loop may go on.
pub(crate) async fn hold() {
    std::future::poll_fn(|cx| {
        current::replay_log(|log| log.hold(cx)).unwrap_or(std::task::Poll::Ready(()))
    })
    .await;
}

/// Calls `call` on a thread that may block, as [`blocking`](crate::blocking) does, and records what
/// it gave; in a replay gives that, and does not call it.
///
/// Its result has a byte form, so that it can be recorded. A plain `blocking` is not recorded, and
/// a recorded system that uses it gets an error. Cancel-safe as `blocking`: dropped, the call still
/// runs to its end, and its result is lost.
///
/// ```
/// # luna::run(async {
/// let length = || std::fs::metadata("/").map_or(0, |about| about.len());
/// let bytes = luna::replay::blocking("disk", length).await;
/// # let _ = bytes;
/// # Ok(())
/// # })?;
/// # Ok::<(), luna::Error>(())
/// ```
pub async fn blocking<T: Value + Send + 'static>(
    name: &str,
    call: impl FnOnce() -> T + Send + 'static,
) -> T {
    let given = match current::replay_log(|log| log.is_replay()) {
        Some(true) => None,
        _ => Some(Untaped(luna_core::blocking(call)).await),
    };
    input(name, || match given {
        Some(given) => given,
        None => unreachable!("a replay does not ask"),
    })
}

/// What a process does within an operation that is recorded as a whole.
pub(crate) struct Untaped<F>(pub(crate) F);

impl<F: Future> Future for Untaped<F> {
    type Output = F::Output;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        // SAFETY: the future is pinned with the whole.
        let inner = unsafe { self.map_unchecked_mut(|this| &mut this.0) };
        current::without_replay_log(|| inner.poll(cx))
    }
}

/// Begins an operation that waits for something outside: returns whether it is to be done.
pub(crate) async fn enters() -> Turn {
    std::future::poll_fn(|cx| {
        current::replay_log(|log| log.enter(cx)).unwrap_or(Poll::Ready(Turn::Record))
    })
    .await
}

/// Reports the result of an operation that has begun by [`enters`].
pub(crate) fn leave(event: Event) {
    current::replay_log(|log| log.leave(event));
}

/// Records what an operation that has begun by [`enters`] has read.
pub(crate) fn note_read(bytes: &[u8]) {
    current::replay_log(|log| log.put(About::Read, 0, bytes));
}

/// Gives what the recorded operation had read.
pub(crate) fn read(into: &mut [u8]) -> Option<usize> {
    current::replay_log(|log| log.get(About::Read, 0, into))?
}

/// Records what is written outside, or compares it.
pub(crate) fn note_written(bytes: &[u8]) {
    current::replay_log(|log| log.put(About::Output, 0, bytes));
}

/// Whether a system is to be recorded or replayed.
#[derive(Default)]
pub(crate) struct TapePlan {
    pub(crate) mode: Mode,
    /// What the recording is to keep.
    pub(crate) note: String,
    /// What parameters begin with, unless it is their default: names and values.
    pub(crate) parameters: Vec<(String, String)>,
}

#[derive(Default)]
pub(crate) enum Mode {
    #[default]
    None,
    /// To this file, with so much room of each process.
    Record(PathBuf, usize),
    Replay(Arc<Replayer>),
}

impl TapePlan {
    pub(crate) fn replay(&mut self, recording: &Recording) {
        self.mode = Mode::Replay(Replayer::new(recording));
    }

    /// What the parameters of a recorded run began with.
    pub(crate) fn recorded_parameters(&self) -> Option<Vec<(String, String)>> {
        match &self.mode {
            Mode::Replay(replayer) => Some(replayer.parameters().to_vec()),
            _ => None,
        }
    }

    pub(crate) fn start(
        self,
        system: &str,
        replaces: bool,
        opening: &Opening,
    ) -> Result<ReplayLogs> {
        Ok(match self.mode {
            Mode::None => ReplayLogs::None,
            Mode::Record(path, room) => {
                let (note, parameters, system) = (self.note, self.parameters, system.to_owned());
                let what = format!("make the replay log `{}`", path.display());
                let started = opening.wait_for(what, move || {
                    let file = Recorder::file(&path, replaces)?;
                    Recorder::start(&path, file, room, &system, &note, &parameters)
                });
                ReplayLogs::Record(started??)
            }
            Mode::Replay(replayer) => {
                replayer.check_system(system)?;
                ReplayLogs::Replay(replayer)
            }
        })
    }
}

/// What records or replays a system that runs.
pub(crate) enum ReplayLogs {
    None,
    Record(Arc<Recorder>),
    Replay(Arc<Replayer>),
}

impl ReplayLogs {
    /// Whether processes have replay logs.
    #[inline]
    pub(crate) fn are_there(&self) -> bool {
        !matches!(self, ReplayLogs::None)
    }

    /// Gives the process its replay log.
    #[cold]
    pub(crate) fn give_log(&self, spec: ProcessSpec) -> ProcessSpec {
        let parent = current::replay_log(|log| log.process()).unwrap_or_default();
        let track = match self {
            ReplayLogs::None => return spec,
            ReplayLogs::Record(recorder) => Track::Record(recorder.track(parent, spec.name())),
            ReplayLogs::Replay(replayer) => Track::Replay(replayer.track(parent, spec.name())),
        };
        spec.with_replay_log(Arc::new(track))
    }

    pub(crate) fn is_replay(&self) -> bool {
        matches!(self, ReplayLogs::Replay(_))
    }

    /// What was done in a recorded run that is not recorded.
    pub(crate) fn outside(&self) -> Option<RecordError> {
        match self {
            ReplayLogs::Record(recorder) => recorder.outside(),
            _ => None,
        }
    }

    /// To be called when all processes have ended. Waits for the file, but not once it `is_hurried`.
    pub(crate) fn finish(
        &self,
        is_hurried: &dyn Fn() -> bool,
    ) -> Result<Option<RecordReport>, RecordError> {
        match self {
            ReplayLogs::None => Ok(None),
            ReplayLogs::Record(recorder) => recorder.finish(is_hurried).map(Some),
            ReplayLogs::Replay(replayer) => replayer.finish().map(Some),
        }
    }
}

/// What records or replays a process: used in its polls, and as its body goes.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one in an allocation of its own for each process"
)]
enum Track {
    Record(recorder::Track),
    Replay(replayer::Track),
}

// SAFETY: a process is polled, and its body dropped, by one thread at a time, and nothing else uses
// its track.
unsafe impl Send for Track {}
// SAFETY: the record of the process is the only owner, and uses the track within polls and as the
// body goes alone: so no two threads use it at the same time.
unsafe impl Sync for Track {}

impl LogInstaller for Track {
    fn poll(
        &self,
        cx: &mut Context<'_>,
        poll: &mut dyn FnMut(&mut Context<'_>) -> Poll<()>,
    ) -> Poll<()> {
        match self {
            Track::Record(track) => current::with_replay_log(track, || poll(cx)),
            Track::Replay(track) => {
                if !track.begins(cx) {
                    return Poll::Pending;
                }
                let polled = match track.rests() {
                    true => Poll::Pending,
                    false => current::with_replay_log(track, || poll(cx)),
                };
                if polled.is_pending() && track.is_over(cx) {
                    return Poll::Ready(());
                }
                polled
            }
        }
    }

    fn completed(&self) {
        match self {
            Track::Record(track) => track.end(),
            Track::Replay(track) => track.end(),
        }
    }

    fn end(&self) {
        if let Track::Record(track) = self {
            track.cut();
        }
    }
}

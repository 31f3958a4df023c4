//! Recording a run, and replaying it: see [`System::record`](crate::System::record) and [`System::replay`](crate::System::replay).
//!
//! A process that communicates by channels with one sender and one receiver, and makes no choices, sees the same in every run, however long anything takes (Kahn, 1974).
//! So recorded is only what could have been otherwise: which guard an alternative chose, whether an operation at once or with a
//! timeout succeeded, what the clock said, how an operation failed, what came from outside ([`input`]), and in which order processes got through where several compete. A replay on
//! a virtual clock gives all that again, and compares what goes outside ([`output`]). `docs/record-and-replay.md` says what is recorded, and what is not.
//!
//! ```
//! use luna::prelude::*;
//! use luna::record::{self, Recording};
//!
//! fn system(read: impl Fn() -> u32 + Send + 'static) -> luna::Result<System> {
//!     let mut system = System::new("thermometer");
//!     let main = system.executor("main").build()?;
//!     main.process("display").spawn(async move {
//!         let degrees = record::input("sensor", read);
//!         record::output("display", &(degrees * 10));
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
mod recorder;
mod recording;
mod replayer;
mod ring;
mod value;

pub use error::{Divergence, RecordError};
pub(crate) use recorder::ROOM;
pub use recorder::RecordReport;
pub use recording::Recording;
pub use value::Value;

use crate::error::Result;
use luna_platform::clock::Instant;
use luna_platform::current;
use luna_platform::reclaim::Shared;
use luna_platform::tape::{About, Event, Tape, Turn, What};
use recorder::Recorder;
use replayer::Replayer;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::Context;
use value::{LONGEST, name_of};

/// Takes a value from outside: calls `read` and records what it gave; in a replay gives what was recorded, and does not call it.
///
/// For all that comes from elsewhere than from other processes: a sensor's register, a device, a random number. Outside of a recorded process it is `read` alone.
/// Real-time path: yes; O(size of the value), no allocation, no lock. In a replay that has [diverged](RecordError::Diverged) the value is that of zero bytes.
///
/// ```
/// assert_eq!(luna::record::input("sensor", || 7_u16), 7);
/// ```
pub fn input<T: Value>(name: &str, read: impl FnOnce() -> T) -> T {
    const { assert!(T::SIZE <= LONGEST, "a value has at most 256 bytes") };
    let mut bytes = [0; LONGEST];
    match current::tape(|tape| tape.is_replay()) {
        None => read(),
        Some(true) => {
            current::tape(|tape| tape.get(About::Input, name_of(name), &mut bytes[..T::SIZE]));
            T::read(&bytes[..T::SIZE])
        }
        Some(false) => {
            let value = read();
            value.write(&mut bytes[..T::SIZE]);
            current::tape(|tape| tape.put(About::Input, name_of(name), &bytes[..T::SIZE]));
            value
        }
    }
}

/// Says what goes outside, so that a replay compares it: the first that differs ends the replay with [`RecordError::Diverged`].
///
/// It gives the value to nobody: that is done beside it. Real-time path: yes; O(size of the value), no allocation, no lock.
///
/// ```
/// luna::record::output("motor", &0.5_f64);
/// ```
pub fn output<T: Value>(name: &str, value: &T) {
    const { assert!(T::SIZE <= LONGEST, "a value has at most 256 bytes") };
    if current::is_taped() {
        let mut bytes = [0; LONGEST];
        value.write(&mut bytes[..T::SIZE]);
        current::tape(|tape| tape.put(About::Output, name_of(name), &bytes[..T::SIZE]));
    }
}

/// The time, in a process with a tape.
#[cold]
pub(crate) fn now() -> Instant {
    /// So that time goes on also where the recording does not.
    static BEYOND: AtomicU64 = AtomicU64::new(0);
    let turn = current::tape(|tape| tape.call(false));
    match turn {
        Some(Turn::Given(event)) => {
            current::tape(|tape| tape.leave(Event::new(What::Time, event.number, 0)));
            Instant::from_nanos(event.number)
        }
        Some(Turn::Look) => {
            let beyond = BEYOND.fetch_add(1_000_000, Ordering::Relaxed);
            Instant::from_nanos(Instant::now().as_nanos().saturating_add(beyond))
        }
        _ => {
            let now = Instant::now();
            current::tape(|tape| tape.leave(Event::new(What::Time, now.as_nanos(), 0)));
            now
        }
    }
}

/// A cycle of a periodic loop: what it is told.
const CYCLE: u32 = 0;

/// Lets a loop's wait in. `true`: it is replayed, and does not wait for the time.
pub(crate) async fn enters_cycle() -> bool {
    std::future::poll_fn(|cx| {
        current::tape(|tape| tape.enter(cx)).unwrap_or(std::task::Poll::Ready(Turn::Record))
    })
    .await;
    current::tape(|tape| tape.is_replay()).unwrap_or_default()
}

/// Records what a loop is told.
pub(crate) fn note_cycle(told: [u64; 4]) {
    let mut bytes = [0; 32];
    told.write(&mut bytes);
    current::tape(|tape| tape.put(About::Cycle, CYCLE, &bytes));
}

/// What a replayed loop is told.
pub(crate) fn cycle() -> Option<[u64; 4]> {
    let mut bytes = [0; 32];
    current::tape(|tape| tape.get(About::Cycle, CYCLE, &mut bytes)).flatten()?;
    Some(<[u64; 4]>::read(&bytes))
}

/// Waits until the loop may go on.
pub(crate) async fn hold() {
    std::future::poll_fn(|cx| {
        current::tape(|tape| tape.hold(cx)).unwrap_or(std::task::Poll::Ready(()))
    })
    .await;
}

/// Whether a system is to be recorded or replayed.
#[derive(Default)]
pub(crate) enum TapePlan {
    #[default]
    None,
    Record(PathBuf, usize),
    Replay(Arc<Replayer>),
}

impl TapePlan {
    pub(crate) fn replay(recording: &Recording) -> Self {
        TapePlan::Replay(Replayer::new(recording))
    }

    pub(crate) fn start(self, system: &str) -> Result<Tapes> {
        Ok(match self {
            TapePlan::None => Tapes::None,
            TapePlan::Record(path, room) => Tapes::Record(Recorder::start(&path, room, system)?),
            TapePlan::Replay(replayer) => {
                replayer.check_system(system)?;
                Tapes::Replay(replayer)
            }
        })
    }
}

/// What records or replays a system that runs.
pub(crate) enum Tapes {
    None,
    Record(Arc<Recorder>),
    Replay(Arc<Replayer>),
}

impl Tapes {
    /// What records or replays a process of this name.
    pub(crate) fn track(&self, name: &str) -> Option<Kept> {
        match self {
            Tapes::None => None,
            Tapes::Record(recorder) => Some(Kept::new(Track::Record(recorder.track(name)))),
            Tapes::Replay(replayer) => Some(Kept::new(Track::Replay(replayer.track(name)))),
        }
    }

    pub(crate) fn is_replay(&self) -> bool {
        matches!(self, Tapes::Replay(_))
    }

    /// To be called when all processes have ended.
    pub(crate) fn finish(&self) -> Result<Option<RecordReport>, RecordError> {
        match self {
            Tapes::None => Ok(None),
            Tapes::Record(recorder) => recorder.finish().map(Some),
            Tapes::Replay(replayer) => replayer.finish().map(Some),
        }
    }
}

/// What records or replays a process.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one in a box of its own for each process"
)]
pub(crate) enum Track {
    Record(recorder::Track),
    Replay(replayer::Track),
}

/// A track whose memory is freed off the real-time path, wherever its process ends.
pub(crate) struct Kept(Shared<Alone>);

struct Alone(Track);

// SAFETY: its only handle is never cloned, and goes from thread to thread with its process' body; so one thread at a time reaches it.
unsafe impl Sync for Alone {}

impl Kept {
    fn new(track: Track) -> Self {
        Kept(Shared::new(Alone(track)))
    }

    pub(crate) fn track(&self) -> &Track {
        &self.0.0
    }
}

impl Track {
    /// The body is gone: whether it had ended or not.
    pub(crate) fn cut(&self) {
        if let Track::Record(track) = self {
            track.cut();
        }
    }

    pub(crate) fn tape(&self) -> &dyn Tape {
        match self {
            Track::Record(track) => track,
            Track::Replay(track) => track,
        }
    }

    /// Whether the body may be polled.
    pub(crate) fn begins(&self, cx: &mut Context<'_>) -> bool {
        match self {
            Track::Record(_) => true,
            Track::Replay(track) => track.begins(cx),
        }
    }

    /// Whether the body, which waits, is to be dropped: nothing more comes.
    pub(crate) fn is_over(&self, cx: &mut Context<'_>) -> bool {
        match self {
            Track::Record(_) => false,
            Track::Replay(track) => track.is_over(cx),
        }
    }

    /// The process has returned.
    pub(crate) fn end(&self) {
        match self {
            Track::Record(track) => track.end(),
            Track::Replay(track) => track.end(),
        }
    }
}

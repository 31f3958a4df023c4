//! Recording a run, and replaying it.
//!
//! A process that communicates by channels with one sender and one receiver, and makes no choices,
//! sees the same in every run, however long anything takes (Kahn, 1974). So only nondeterministic
//! events are recorded: which guard an alternative chose, whether an operation at once or with a
//! timeout succeeded, the clock as it was read, how an operation failed, what came from outside
//! ([`input`]), and in which order processes got through where several compete. A replay on a
//! virtual clock reproduces all that, and compares what goes outside ([`output`]).
//! `docs/record-and-replay.md` lists what is recorded, and what is not.

mod error;
mod event;
mod file;
pub mod log;
mod recorder;
mod recording;
mod replayer;
pub mod session;
mod value;

pub use error::{Divergence, RecordError};
pub use recorder::RecordReport;
pub use recording::Recording;
pub use value::Value;

use log::{Unrecorded, input_bytes};
use luna_core::current;
use luna_core::replay_log::About;
use luna_platform::clock::Instant;
use value::{LONGEST, name_of};

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

/// Calls `call` on a thread that may block, as `luna::blocking` does, and records what
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
        _ => Some(Unrecorded(luna_core::blocking(call)).await),
    };
    input(name, || match given {
        Some(given) => given,
        None => unreachable!("a replay does not ask"),
    })
}

/// The time on the clock of the system. Real-time path: yes; O(1), no system call (24 ns on the
/// reference machine).
///
/// ```
/// let start = luna::now();
/// assert!(luna::now() >= start);
/// ```
#[inline]
pub fn now() -> Instant {
    if current::has_replay_log() {
        return luna_core::replay_log::now();
    }
    Instant::now()
}

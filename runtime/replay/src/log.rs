//! What LUNA's own crates record and replay: cycles of loops, and operations on files. It may
//! change with each release.

pub use crate::value::LONGEST;

use crate::value::{Value, name_of};
use luna_core::current;
use luna_core::replay_log::{About, Event, Turn};
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::task::{Context, Poll};

/// As [`input`](crate::input()), for bytes that `fill` writes: returns whether the recording gave
/// them instead.
pub fn input_bytes(name: &str, bytes: &mut [u8], fill: impl FnOnce(&mut [u8])) -> bool {
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

/// A cycle of a periodic loop: its data.
const CYCLE: u32 = 0;

/// Lets a loop's wait in. `true`: it is replayed, and does not wait for the time.
pub async fn enters_cycle() -> bool {
    enters().await;
    current::replay_log(|log| log.is_replay()).unwrap_or_default()
}

/// Records a loop's cycle.
pub fn note_cycle(cycle: [u64; 4]) {
    let mut bytes = [0; 32];
    cycle.write(&mut bytes);
    current::replay_log(|log| log.put(About::Cycle, CYCLE, &bytes));
}

/// The cycle of a replayed loop.
pub fn cycle() -> Option<[u64; 4]> {
    let mut bytes = [0; 32];
    current::replay_log(|log| log.get(About::Cycle, CYCLE, &mut bytes)).flatten()?;
    Some(<[u64; 4]>::read(&bytes))
}

/// Waits until the loop may go on.
pub async fn hold() {
    poll_fn(|cx| current::replay_log(|log| log.hold(cx)).unwrap_or(Poll::Ready(()))).await;
}

/// What a process does within an operation that is recorded as a whole.
#[derive(Debug)]
pub struct Unrecorded<F>(pub F);

impl<F: Future> Future for Unrecorded<F> {
    type Output = F::Output;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        // SAFETY: the future is pinned with the whole.
        let inner = unsafe { self.map_unchecked_mut(|this| &mut this.0) };
        current::without_replay_log(|| inner.poll(cx))
    }
}

/// Begins an operation that waits for something outside: returns whether it is to be done.
pub async fn enters() -> Turn {
    poll_fn(|cx| current::replay_log(|log| log.enter(cx)).unwrap_or(Poll::Ready(Turn::Record)))
        .await
}

/// Reports the result of an operation that has begun by [`enters`].
pub fn leave(event: Event) {
    current::replay_log(|log| log.leave(event));
}

/// Records what an operation that has begun by [`enters`] has read.
pub fn note_read(bytes: &[u8]) {
    current::replay_log(|log| log.put(About::Read, 0, bytes));
}

/// Gives what the recorded operation had read.
pub fn read(into: &mut [u8]) -> Option<usize> {
    current::replay_log(|log| log.get(About::Read, 0, into))?
}

/// Records what is written outside, or compares it.
pub fn note_written(bytes: &[u8]) {
    current::replay_log(|log| log.put(About::Output, 0, bytes));
}

//! Counts events for crews of threads: who waits sees that the count has changed, or is woken.
//!
//! A workers is threads that all act on an event alike, so that it is enough if one of them hears of it, and wakes the others when they are needed. To wake a thread on another core takes a while (20 µs on a
//! virtual machine); so one whose wait a handler of signals has interrupted [need not](EventCount::announce_here) before it acts. Where several crews wait, each has to hear of each event.
//!
//! ```
//! use luna_platform::clock::Instant;
//! use luna_platform::event_count::EventCount;
//!
//! static EVENTS: EventCount = EventCount::new();
//! EVENTS.join();
//! let seen = EVENTS.get(); // before looking for work
//! std::thread::spawn(|| EVENTS.announce());
//! assert_ne!(EVENTS.wait(seen, Instant::NEVER), seen);
//! EVENTS.leave();
//! ```

use crate::clock::Instant;
use crate::futex::{Futex, Waited};
use crate::path::{self, Call};
use crate::sync::atomic::{AtomicU32, Ordering, fence};

/// A count that threads can wait for. Its announcements are async-signal-safe on Linux.
#[derive(Debug)]
pub struct EventCount {
    count: Futex,
    /// How many crews wait.
    crews: AtomicU32,
}

impl EventCount {
    /// Nothing has happened, and nobody waits.
    #[cfg(not(loom))]
    #[expect(
        clippy::new_without_default,
        reason = "what it counts for is said where it is made"
    )]
    pub const fn new() -> Self {
        Self {
            count: Futex::new(0),
            crews: AtomicU32::new(0),
        }
    }

    /// Nothing has happened, and nobody waits.
    #[cfg(loom)]
    #[expect(
        clippy::new_without_default,
        reason = "what it counts for is said where it is made"
    )]
    pub fn new() -> Self {
        Self {
            count: Futex::new(0),
            crews: AtomicU32::new(0),
        }
    }

    /// One more workers waits from now on: to be called before any of it does.
    pub fn join(&self) {
        self.crews.fetch_add(1, Ordering::AcqRel);
        // Against that of `announce_here`: who does not know of this workers has counted before the workers first looks.
        fence(Ordering::SeqCst);
    }

    /// A workers that has [joined](Self::join) waits no more.
    pub fn leave(&self) {
        self.crews.fetch_sub(1, Ordering::AcqRel);
    }

    /// How many events there were; wraps. To be read before looking at what they are about, and given to [`wait`](Self::wait).
    pub fn get(&self) -> u32 {
        self.count.word().load(Ordering::Acquire)
    }

    /// Waits until there was an event after `seen` was read, or until `deadline`; returns the count as it is then.
    ///
    /// The same number as `seen` means that the deadline came. One futex wait, and one more for each wake without a cause.
    pub fn wait(&self, seen: u32, deadline: Instant) -> u32 {
        loop {
            let count = self.get();
            if count != seen || self.count.wait(seen, deadline) == Waited::TimedOut {
                return self.get();
            }
        }
    }

    /// Counts an event and wakes who waits. One system call, O(threads that wait).
    pub fn announce(&self) {
        self.count.word().fetch_add(1, Ordering::AcqRel);
        path::expected(Call::Wake, || self.count.wake_all());
    }

    /// Counts an event, of which the calling thread hears, since it is in a handler of signals that has interrupted its [`wait`](Self::wait): that returns after the handler. If several crews
    /// wait, all are woken. No system call if one does.
    pub fn announce_here(&self) {
        self.count.word().fetch_add(1, Ordering::AcqRel);
        fence(Ordering::SeqCst);
        if self.crews.load(Ordering::Relaxed) > 1 {
            path::expected(Call::Wake, || self.count.wake_all());
        }
    }
}

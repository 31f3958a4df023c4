//! Counts events for groups of threads: a waiting thread sees that the count has changed, or is
//! woken.
//!
//! The threads of a group all handle an event alike, so it is enough to notify one of them, which
//! wakes the others when they are needed. Waking a thread on another core takes a while (20 µs on a
//! virtual machine). A thread that a signal handler interrupts in its wait therefore [does not wake
//! the others](EventCount::announce_here) before it acts. If several groups wait, each has to be
//! notified of each event.
//!
//! ```
//! use luna_platform::clock::Instant;
//! use luna_machine::event_count::EventCount;
//!
//! static EVENTS: EventCount = EventCount::new();
//! EVENTS.join();
//! let seen = EVENTS.get(); // before looking for work
//! std::thread::spawn(|| EVENTS.announce());
//! assert_ne!(EVENTS.wait(seen, Instant::NEVER), seen);
//! EVENTS.leave();
//! ```

use luna_platform::clock::Instant;
use luna_platform::futex::{Futex, Waited};
use luna_platform::path::{self, Call};
use luna_platform::sync::atomic::{AtomicU32, Ordering, fence};

/// A count that threads can wait for. Its announcements are async-signal-safe on Linux.
#[derive(Debug)]
pub struct EventCount {
    count: Futex,
    /// The number of groups that wait.
    crews: AtomicU32,
}

impl EventCount {
    /// No event, and no waiting group.
    #[cfg(not(loom))]
    pub const fn new() -> Self {
        Self {
            count: Futex::new(0),
            crews: AtomicU32::new(0),
        }
    }

    /// No event, and no waiting group.
    #[cfg(loom)]
    pub fn new() -> Self {
        Self {
            count: Futex::new(0),
            crews: AtomicU32::new(0),
        }
    }

    /// One more group waits from now on: call it before any of its threads waits.
    pub fn join(&self) {
        self.crews.fetch_add(1, Ordering::AcqRel);
        // Pairs with the fence in `announce_here`: an announcement that does not see this group has
        // counted its event before the group first reads the count.
        fence(Ordering::SeqCst);
    }

    /// A group that has [joined](Self::join) waits no more.
    pub fn leave(&self) {
        self.crews.fetch_sub(1, Ordering::AcqRel);
    }

    /// The number of events; wraps. Read it before checking for work, and pass it to
    /// [`wait`](Self::wait).
    pub fn get(&self) -> u32 {
        self.count.word().load(Ordering::Acquire)
    }

    /// Waits until there was an event after `seen` was read, or until `deadline`; returns the count
    /// as it is then.
    ///
    /// The same number as `seen` means that the deadline came. One futex wait, and one more for
    /// each wake without a cause.
    pub fn wait(&self, seen: u32, deadline: Instant) -> u32 {
        loop {
            let count = self.get();
            if count != seen || self.count.wait(seen, deadline) == Waited::TimedOut {
                return self.get();
            }
        }
    }

    /// Counts an event and wakes the waiting threads. One system call, O(threads that wait).
    pub fn announce(&self) {
        self.count.word().fetch_add(1, Ordering::AcqRel);
        path::expected(Call::Wake, || self.count.wake_all());
    }

    /// Counts an event from a signal handler that has interrupted this thread's
    /// [`wait`](Self::wait), which returns after the handler. If several groups wait, all are
    /// woken. No system call if one does.
    pub fn announce_here(&self) {
        self.count.word().fetch_add(1, Ordering::AcqRel);
        fence(Ordering::SeqCst);
        if self.crews.load(Ordering::Relaxed) > 1 {
            path::expected(Call::Wake, || self.count.wake_all());
        }
    }
}

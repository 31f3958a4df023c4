//! Whether the favoured home is inside a lock: a priority-inheriting futex that its owner takes and leaves by plain stores.
//!
//! The word holds the owner's thread number, 0 when nobody is inside, and the kernel's note (`FUTEX_WAITERS`) when somebody waits. One thread at a time
//! waits for the owner, which the lock around this sees to. The owner's plain store of 0 can erase the note. So an owner that
//! finds itself not favoured any more afterwards puts both back, if the word is still 0, and lets the kernel hand over; if it is not, who
//! waited has come through already. A wait that begins after the store finds 0, and does not wait.

use super::lock::{futex_pi, known_thread_id, lock_pi, thread_id};
use std::hint::spin_loop;
use std::sync::atomic::{AtomicU32, Ordering};

/// How often the word is looked at before the kernel is asked: a section takes some tens of nanoseconds, and its owner may be on another core.
const LOOKS: u32 = 40;

/// The word of a biased lock that says whether its owner is inside.
#[derive(Debug)]
pub struct Inside {
    word: AtomicU32,
}

impl Default for Inside {
    fn default() -> Self {
        Self::new()
    }
}

impl Inside {
    /// Not entered.
    pub const fn new() -> Self {
        Self {
            word: AtomicU32::new(0),
        }
    }

    /// Whether somebody is inside: for the favoured home's thread, whether it is itself.
    #[inline(always)]
    pub fn is_entered(&self) -> bool {
        self.word.load(Ordering::Relaxed) != 0
    }

    /// The favoured home's thread enters.
    #[inline(always)]
    pub fn enter(&self) {
        let me = known_thread_id();
        if self.word.load(Ordering::Relaxed) != 0 {
            entered_twice();
        }
        // Not asked for here: then all that the way at home has in its hands would have to be kept across a call, each time.
        if me == 0 {
            unknown();
        }
        self.word.store(me, Ordering::Relaxed);
    }

    /// Panics if this thread is inside.
    pub fn assert_not_here(&self) {
        if self.word.load(Ordering::Relaxed) & libc::FUTEX_TID_MASK == thread_id() {
            entered_twice();
        }
    }

    /// The favoured home's thread leaves.
    #[inline(always)]
    pub fn leave(&self) {
        self.word.store(0, Ordering::Release);
    }

    /// The home's thread has left, and found that it is not favoured any more: somebody may wait in the kernel without a note of it.
    #[cold]
    pub fn leave_revoked(&self) {
        let noted = thread_id() | libc::FUTEX_WAITERS;
        let left = self
            .word
            .compare_exchange(0, noted, Ordering::AcqRel, Ordering::Relaxed);
        if left.is_ok() {
            // Hands over to who waits; frees the word if nobody does.
            let outcome = crate::path::expected(crate::path::Call::Lock, || {
                futex_pi(&self.word, libc::FUTEX_UNLOCK_PI)
            });
            debug_assert!(outcome.is_ok(), "handing over failed: {outcome:?}");
        }
    }

    /// Waits until the home's thread is outside, and lends it the caller's priority meanwhile. The caller has ended its favour, and
    /// executed the heavy fence.
    pub fn wait_until_left(&self) {
        for _ in 0..LOOKS {
            if self.word.load(Ordering::Acquire) == 0 {
                return;
            }
            spin_loop();
        }
        lock_pi(&self.word);
        super::lock::unlock_pi(&self.word);
    }
}

#[cold]
#[inline(never)]
fn entered_twice() -> ! {
    panic!("a thread locked a lock that it holds already")
}

#[cold]
#[inline(never)]
fn unknown() -> ! {
    panic!("a thread that has never locked is the home of a lock")
}

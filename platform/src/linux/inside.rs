//! Whether the owner of a bias is inside a lock: a priority-inheriting futex that the owner takes
//! and leaves by plain stores.
//!
//! The word holds the owner's thread id, 0 when it is outside, and the kernel's mark
//! (`FUTEX_WAITERS`) when a thread waits. One thread at a time waits for the owner; the lock around
//! this ensures that. The owner's plain store of 0 can erase the mark. So an owner that finds the
//! bias revoked afterwards puts both back, if the word is still 0, and lets the kernel hand over.
//! If the word is not 0, the waiting thread has got it already. A wait that begins after the store
//! finds 0, and does not wait.

use super::lock::{futex_pi, lock_pi, thread_id};
use std::hint::spin_loop;
use std::sync::atomic::{AtomicU32, Ordering};

/// The number of looks at the word before the kernel is asked: a critical section takes some tens
/// of nanoseconds, and its owner may be on another core.
const LOOKS_BEFORE_KERNEL: u32 = 40;

/// The word of a biased lock that holds whether its owner is inside.
#[derive(Debug)]
pub struct Inside {
    word: AtomicU32,
}

impl Inside {
    /// Not entered.
    pub const fn new() -> Self {
        Self {
            word: AtomicU32::new(0),
        }
    }

    /// Whether the owner of the bias is inside; its own thread learns whether it is itself.
    #[inline(always)]
    pub fn is_entered(&self) -> bool {
        self.word.load(Ordering::Relaxed) != 0
    }

    /// What the calling thread writes when it enters. A system call at its first lock.
    pub fn id_of_this_thread() -> u32 {
        thread_id()
    }

    /// The thread of the owner enters.
    ///
    /// # Safety
    ///
    /// `me` is the [id of the calling thread](Self::id_of_this_thread), which is not inside.
    #[inline(always)]
    pub unsafe fn enter_unchecked(&self, me: u32) {
        debug_assert!(!self.is_entered() && me == thread_id());
        self.word.store(me, Ordering::Relaxed);
    }

    /// Panics if this thread is inside.
    pub fn assert_not_here(&self) {
        if self.word.load(Ordering::Relaxed) & libc::FUTEX_TID_MASK == thread_id() {
            entered_twice();
        }
    }

    /// The thread of the owner leaves.
    #[inline(always)]
    pub fn leave(&self) {
        self.word.store(0, Ordering::Release);
    }

    /// The owner has left, and found the bias revoked: a thread may wait in the kernel without a
    /// mark of it.
    #[cold]
    pub fn leave_revoked(&self) {
        let noted = thread_id() | libc::FUTEX_WAITERS;
        let left = self
            .word
            .compare_exchange(0, noted, Ordering::AcqRel, Ordering::Relaxed);
        if left.is_ok() {
            // Hands over to the waiting thread; frees the word if there is none.
            let outcome = crate::path::expected(crate::path::Call::Lock, || {
                futex_pi(&self.word, libc::FUTEX_UNLOCK_PI)
            });
            debug_assert!(outcome.is_ok(), "handing over failed: {outcome:?}");
        }
    }

    /// Waits until the owner is outside, and boosts it to the caller's priority meanwhile. The
    /// caller has revoked the bias, and executed the heavy fence.
    pub fn wait_until_left(&self) {
        for _ in 0..LOOKS_BEFORE_KERNEL {
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

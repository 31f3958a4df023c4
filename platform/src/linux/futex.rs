//! A word to wait on: one system call to sleep until an absolute deadline, one to wake.

use super::clock::timespec;
use crate::clock::Instant;
use crate::futex::Waited;
use nix::errno::Errno;
use std::ptr;
use std::sync::atomic::AtomicU32;

/// A 32-bit word that threads can wait on.
///
/// Change the word first, through [`word`](Self::word), then wake: a thread that is about to wait
/// sees the change or the wake.
#[derive(Debug)]
#[repr(transparent)]
pub struct Futex {
    word: AtomicU32,
}

impl Futex {
    /// A word that holds `value`.
    pub const fn new(value: u32) -> Self {
        Self {
            word: AtomicU32::new(value),
        }
    }

    /// The word itself.
    #[inline]
    pub fn word(&self) -> &AtomicU32 {
        &self.word
    }

    /// Waits while the word holds `expected`, at most until `deadline` ([`Instant::NEVER`]: without
    /// end).
    ///
    /// One system call. May end without a cause, so call it in a loop.
    pub fn wait(&self, expected: u32, deadline: Instant) -> Waited {
        let until = timespec(deadline.as_nanos());
        let until: *const libc::timespec = if deadline == Instant::NEVER {
            ptr::null()
        } else {
            &until
        };
        // SAFETY: the word outlives the call, `until` is null or points to a timespec on this
        // stack. FUTEX_WAIT_BITSET takes its deadline as absolute on CLOCK_MONOTONIC.
        let outcome = unsafe {
            libc::syscall(
                libc::SYS_futex,
                self.word.as_ptr(),
                libc::FUTEX_WAIT_BITSET | libc::FUTEX_PRIVATE_FLAG,
                expected,
                until,
                ptr::null::<u32>(),
                libc::FUTEX_BITSET_MATCH_ANY,
            )
        };
        if outcome == -1 && Errno::last_raw() == libc::ETIMEDOUT {
            Waited::TimedOut
        } else {
            Waited::Woken
        }
    }

    /// Wakes one waiting thread: the one of highest priority. One system call. Async-signal-safe.
    pub fn wake_one(&self) {
        self.wake(1);
    }

    /// Wakes all waiting threads. One system call, O(threads). Async-signal-safe.
    pub fn wake_all(&self) {
        self.wake(i32::MAX);
    }

    fn wake(&self, threads: i32) {
        // SAFETY: FUTEX_WAKE only uses the address as a key.
        unsafe {
            libc::syscall(
                libc::SYS_futex,
                self.word.as_ptr(),
                libc::FUTEX_WAKE | libc::FUTEX_PRIVATE_FLAG,
                threads,
            );
        }
    }
}

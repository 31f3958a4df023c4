//! A word to wait on, as a mutex and a condition variable beside an atomic.

use crate::clock::Instant;
use crate::futex::Waited;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A 32-bit word that threads can wait on.
///
/// Change the word first, through [`word`](Self::word), then wake: a thread that is about to wait
/// sees the change or the wake.
#[derive(Debug)]
pub struct Futex {
    word: AtomicU32,
    lock: Mutex<()>,
    changed: Condvar,
}

impl Futex {
    /// A word that holds `value`.
    pub const fn new(value: u32) -> Self {
        Self {
            word: AtomicU32::new(value),
            lock: Mutex::new(()),
            changed: Condvar::new(),
        }
    }

    /// The word itself.
    #[inline]
    pub fn word(&self) -> &AtomicU32 {
        &self.word
    }

    /// Waits while the word holds `expected`, at most until `deadline` ([`Instant::NEVER`]: without
    /// end).
    pub fn wait(&self, expected: u32, deadline: Instant) -> Waited {
        let guard = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        if self.word.load(Ordering::SeqCst) != expected {
            return Waited::Woken;
        }
        if deadline == Instant::NEVER {
            drop(
                self.changed
                    .wait(guard)
                    .unwrap_or_else(PoisonError::into_inner),
            );
            return Waited::Woken;
        }
        let left: Duration = deadline - Instant::now_real();
        if left.is_zero() {
            return Waited::TimedOut;
        }
        let (guard, outcome) = self
            .changed
            .wait_timeout(guard, left)
            .unwrap_or_else(PoisonError::into_inner);
        drop(guard);
        // The clock of the caller decides, not the condition variable's.
        if outcome.timed_out() && Instant::now_real() >= deadline {
            Waited::TimedOut
        } else {
            Waited::Woken
        }
    }

    /// Wakes one waiting thread.
    pub fn wake_one(&self) {
        // Taking the lock orders this wake after the check of a thread that is about to wait.
        drop(self.lock.lock().unwrap_or_else(PoisonError::into_inner));
        self.changed.notify_one();
    }

    /// Wakes all waiting threads.
    pub fn wake_all(&self) {
        drop(self.lock.lock().unwrap_or_else(PoisonError::into_inner));
        self.changed.notify_all();
    }
}

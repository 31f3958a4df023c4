//! A word that the program waits on, idling.

use super::{is_interrupt, port::port};
use crate::clock::Instant;
use crate::futex::Waited;
use core::sync::atomic::{AtomicU32, Ordering};

/// A 32-bit word that the program can wait on, and interrupts can change.
///
/// Change the word first, through [`word`](Self::word), then wake: a program that is about to wait
/// sees the change or the wake.
#[derive(Debug)]
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
    /// end). Idles once.
    ///
    /// # Panics
    ///
    /// In an interrupt: what it waits for would have to wait for its end.
    pub fn wait(&self, expected: u32, deadline: Instant) -> Waited {
        assert!(!is_interrupt(), "an interrupt cannot wait");
        if self.word.load(Ordering::SeqCst) != expected {
            return Waited::Woken;
        }
        let is_over = || deadline != Instant::NEVER && Instant::now_real() >= deadline;
        if is_over() {
            return Waited::TimedOut;
        }
        // A wake since the load ends it at once, as `Port::idle` requires.
        port().idle(deadline);
        if self.word.load(Ordering::SeqCst) == expected && is_over() {
            Waited::TimedOut
        } else {
            Waited::Woken
        }
    }

    /// Wakes the program, if it waits.
    pub fn wake_one(&self) {
        port().wake();
    }

    /// Wakes the program, if it waits.
    pub fn wake_all(&self) {
        port().wake();
    }
}

//! How a process has ended, and the exit value until it is taken.

use super::Record;
use crate::events::{self, code::ended};
use crate::process::exit_value::{ErasedExitValue, ExitValue};
use crate::process::{Exit, panic_message};
use alloc::boxed::Box;
use alloc::string::String;
use core::any::Any;
use core::sync::atomic::Ordering;

/// How it ended, before any query: the message of a panic is made off the real-time path.
pub(crate) enum RawExit {
    Completed,
    /// Completed, with an exit value.
    Value(ErasedExitValue),
    Cancelled,
    Panicked(Box<dyn Any + Send>),
}

/// How a process has ended, readable without the lock.
pub(in crate::process) struct Outcome;

impl Outcome {
    pub(in crate::process) const NONE: u8 = 0;
    pub(in crate::process) const COMPLETED: u8 = 1;
    pub(in crate::process) const CANCELLED: u8 = 2;
    /// The panic's payload is behind the lock.
    pub(in crate::process) const PANICKED: u8 = 3;
    /// Completed, and the exit value is behind the lock.
    pub(in crate::process) const WITH_VALUE: u8 = 4;
}

impl Record {
    /// How it ended, if it has. The message of a panic is made here.
    #[inline]
    pub(in crate::process) fn exit(&self) -> Option<Exit> {
        Some(match self.outcome.load(Ordering::Acquire) {
            Outcome::NONE => return None,
            Outcome::COMPLETED | Outcome::WITH_VALUE => Exit::Completed,
            Outcome::CANCELLED => Exit::Cancelled,
            _ => self.panicked(),
        })
    }

    #[cold]
    #[inline(never)]
    pub(in crate::process) fn panicked(&self) -> Exit {
        Exit::Panicked(match &self.shown.lock().exit {
            RawExit::Panicked(payload) => panic_message(&**payload),
            _ => String::new(),
        })
    }

    /// The exit value, if it is of this type and was not taken.
    #[inline]
    pub(in crate::process) fn take_exit_value<O: ExitValue>(&self) -> Option<O> {
        if self.outcome.load(Ordering::Acquire) != Outcome::WITH_VALUE {
            return None;
        }
        self.take_stored_exit_value()
    }

    #[cold]
    pub(in crate::process) fn take_stored_exit_value<O: ExitValue>(&self) -> Option<O> {
        let mut shown = self.shown.lock();
        // Checked in place: if they were taken out and put back, they would be missing meanwhile.
        let exit = match &shown.exit {
            RawExit::Value(value) if value.are::<O>() => {
                core::mem::replace(&mut shown.exit, RawExit::Completed)
            }
            _ => return None,
        };
        drop(shown);
        // Outside of the lock: it frees.
        match exit {
            RawExit::Value(value) => value.take().ok(),
            _ => None,
        }
    }

    /// Publishes how the process has ended, once, to its waiters.
    pub(crate) fn finish(&self, exit: RawExit) {
        let mut shown = self.shown.lock();
        debug_assert!(!self.has_ended());
        let (outcome, event) = match &exit {
            RawExit::Completed => (Outcome::COMPLETED, ended::OK),
            RawExit::Value(_) => (Outcome::WITH_VALUE, ended::OK),
            RawExit::Cancelled => (Outcome::CANCELLED, ended::CANCELLED),
            RawExit::Panicked(_) => (Outcome::PANICKED, ended::PANICKED),
        };
        events::done(self.id.get(), event);
        shown.exit = exit;
        // No further query to the process itself can come. SAFETY: the lock is held.
        unsafe { self.seen.forget() };
        self.outcome.store(outcome, Ordering::Release);
        // One by one, so that the lock is never held for more than a few steps.
        while let Some(wake) = shown.joining.take(|()| true) {
            // No further waiter can come.
            let is_last = shown.joining.is_empty();
            drop(shown);
            // The other waiters are notified all the same.
            wake.wake_contained();
            if is_last {
                return;
            }
            shown = self.shown.lock();
        }
    }
}

//! How a process has ended, and the exit value until it is taken: what a process returns as it
//! ends, for the code that reaps it. It is kept in the room of the body, since a process ends on
//! the real-time path.

use super::handle::{Exit, panic_message};
use super::{Process, ProcessRef, state};
use crate::events::{self, code::ended};
use crate::waiting::OpList;
use alloc::boxed::Box;
use core::any::{Any, TypeId};
use core::mem::MaybeUninit;

/// What a body ends with, beyond that it has ended: an error, say. Most end with nothing.
pub trait ExitValue: Send + 'static {
    /// Whether there is nothing to be kept. Called on the real-time path.
    fn is_nothing(&self) -> bool;

    /// What a process ends with that has [failed](crate::current::fail_current), whatever its
    /// body returned. Called on the real-time path, in the turn in which it failed.
    fn failed() -> Self;
}

impl ExitValue for () {
    fn is_nothing(&self) -> bool {
        true
    }

    fn failed() {}
}

/// What a panic carried.
pub(super) type Payload = Box<dyn Any + Send>;

/// How a body ended that has not completed.
#[derive(Debug)]
pub(super) enum Abandoned {
    /// Its replay log has no further events: dropped where it waits.
    Over,
    Cancelled,
    /// It has [failed](crate::current::fail_current).
    Failed,
    Panicked(Payload),
}

/// State that other threads read and change.
pub(super) struct Shown {
    pub(super) joining: OpList<()>,
    /// Of a process that has panicked. The message of a panic is made off the real-time path.
    panic: Option<Payload>,
    /// An exit value lies in the body's room.
    has_value: bool,
}

impl Shown {
    pub(super) const fn new() -> Self {
        Self {
            joining: OpList::new(),
            panic: None,
            has_value: false,
        }
    }
}

impl Process {
    /// How it ended, if it has. The message of a panic is made here.
    #[inline]
    pub(super) fn exit(&self) -> Option<Exit> {
        Some(match self.outcome()? {
            state::CANCELLED => Exit::Cancelled,
            state::PANICKED => {
                let shown = self.record.shown.lock();
                Exit::Panicked(
                    shown
                        .panic
                        .as_deref()
                        .map(panic_message)
                        .unwrap_or_default(),
                )
            }
            _ => Exit::Completed,
        })
    }

    /// The exit value, if it is of this type and was not taken.
    #[inline]
    pub(super) fn take_exit_value<O: ExitValue>(&self) -> Option<O> {
        let of_body = &self.methods().of_body;
        if self.outcome() != Some(state::WITH_VALUE)
            || (of_body.value)() != TypeId::of::<O>()
            || !core::mem::take(&mut self.record.shown.lock().has_value)
        {
            return None;
        }
        let mut value = MaybeUninit::<O>::uninit();
        // SAFETY: by the flag, which was taken, the exit value is there and this call's alone. It
        // is of the type for which there is room, and is moved out once.
        unsafe {
            (of_body.take_value)(self.whole(), value.as_mut_ptr().cast());
            Some(value.assume_init())
        }
    }

    /// Publishes how the process has ended, once, to its waiters.
    ///
    /// # Safety
    ///
    /// As for [`set_ended`](Process::set_ended): this is the executor's thread, or the process was
    /// never built. With `WITH_VALUE` the exit value lies in the body's room, where nothing else
    /// accesses it any more.
    pub(super) unsafe fn finish(&self, outcome: u8, panic: Option<Payload>) {
        let mut shown = self.record.shown.lock();
        debug_assert!(!self.has_ended());
        let event = match outcome {
            state::CANCELLED => ended::CANCELLED,
            state::PANICKED => ended::PANICKED,
            _ => ended::OK,
        };
        events::done(self.id.get(), event);
        shown.panic = panic;
        shown.has_value = outcome == state::WITH_VALUE;
        // SAFETY: the caller promises what is demanded there.
        unsafe { self.set_ended(outcome) };
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
            shown = self.record.shown.lock();
        }
    }

    /// Reports the end of this process, which has [finished](Self::finish), to the registry that
    /// counts and lists it.
    pub(super) fn report(&self) {
        if let Some(executor) = &self.record.executor {
            let in_a_hurry = !self.record.is_unhurried || self.outcome() != Some(state::COMPLETED);
            let listed = self.record.is_listed.then(|| ProcessRef::to(self));
            executor.registry.leave(listed, in_a_hurry);
        }
    }
}

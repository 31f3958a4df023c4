//! The body of a process, and the work around each of its polls.

use super::exit_value::{ErasedExitValue, ExitValue};
use super::record::{RawExit, Record};
use crate::current;
use alloc::boxed::Box;
use core::any::Any;
use core::future::Future;
use core::hint::unreachable_unchecked;
use core::pin::Pin;
use core::ptr;
use core::task::{Context, Poll};
use luna_platform::panics::catch_unwind;

/// How a body ended, with its exit value before that is published.
pub(crate) enum End<O> {
    Completed(O),
    Abandoned(Abandoned),
}

/// How a body ended that has not completed.
pub(crate) enum Abandoned {
    /// Its replay log has no further events: dropped where it waits.
    Over,
    Cancelled,
    /// It has [failed](crate::current::fail_current).
    Failed,
    Panicked(Box<dyn Any + Send>),
}

impl<O> End<O> {
    pub(crate) fn is_panic(&self) -> bool {
        matches!(self, End::Abandoned(Abandoned::Panicked(_)))
    }
}

impl<O: ExitValue> End<O> {
    /// As its record stores it. `keep` finds a place for the exit value.
    #[inline]
    pub(crate) fn into_raw(self, keep: impl FnOnce(O) -> ErasedExitValue) -> RawExit {
        match self {
            End::Completed(value) if !value.is_nothing() => RawExit::Value(keep(value)),
            End::Completed(_) | End::Abandoned(Abandoned::Over | Abandoned::Failed) => {
                RawExit::Completed
            }
            End::Abandoned(Abandoned::Cancelled) => RawExit::Cancelled,
            End::Abandoned(Abandoned::Panicked(payload)) => RawExit::Panicked(payload),
        }
    }
}

/// A process' body, with all that the framework does around each of its polls. It is always polled
/// with the same record. `B` makes the future where it is to run.
pub(crate) struct Body<F: Future, B>(Room<F, F::Output, B>);

/// The room of a body is that of its builder and of its exit value too: there is memory for any
/// exit value when the body ends.
enum Room<F, O, B> {
    Unbuilt(B),
    Running(F),
    Value(O),
    Empty,
}

impl<F: Future, B: FnOnce() -> F> Body<F, B> {
    pub(crate) fn unbuilt(build: B) -> Self {
        Self(Room::Unbuilt(build))
    }

    /// Makes the future, once, where it stays. If the builder panics, there is nothing any more.
    pub(crate) fn build(self: Pin<&mut Self>) {
        // SAFETY: there is no future yet that would be moved. The builder is moved out, and nothing
        // is in its place before its room is used again. It may be large, so no room is moved.
        unsafe {
            let room = &raw mut self.get_unchecked_mut().0;
            if let Room::Unbuilt(build) = &*room {
                let build = ptr::read(build);
                room.write(Room::Empty);
                room.write(Room::Running(build()));
            }
        }
    }
}

impl<F: Future, B> Body<F, B> {
    /// Drops what is there, whatever it is.
    pub(crate) fn clear(mut self: Pin<&mut Self>) {
        self.set(Self(Room::Empty));
    }

    /// Polls the future and nothing else. If it is ready or panics, [`end`](Self::end) is to be
    /// called.
    ///
    /// # Safety
    ///
    /// It was [built](Self::build), and has not ended.
    #[inline(always)]
    pub(crate) unsafe fn poll_unended(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<F::Output> {
        // SAFETY: the future is never moved: it is polled pinned, and dropped in place. The caller
        // promises that it was built and has not ended, so it is there.
        unsafe {
            match &mut self.get_unchecked_mut().0 {
                Room::Running(future) => Pin::new_unchecked(future).poll(cx),
                _ => unreachable_unchecked(),
            }
        }
    }

    /// Drops the future. One that panicked is never polled again, so its half-done state stays
    /// invisible. Changes `end` if it ends in another way after all. A poll that is under way ends
    /// before: what panics then finds a body that has not ended.
    #[cold]
    pub(crate) fn end(mut self: Pin<&mut Self>, record: &Record, end: &mut End<F::Output>) {
        record.end_poll();
        // Dropping the body ends its channels before the end of the process is published. A body
        // that has not completed was left in the middle, and so is what it held.
        let abandoned = !matches!(end, End::Completed(_) | End::Abandoned(Abandoned::Over));
        let log_installer = record.log_installer();
        if let (End::Completed(_), Some(log_installer)) = (&*end, log_installer) {
            log_installer.completed();
        }
        let poisons = abandoned && record.is_poisoned();
        let dropped = catch_unwind(|| {
            let mut drop_body = || match (abandoned, poisons) {
                (false, _) => self.as_mut().clear(),
                (true, false) => current::with_abandoned(|| self.as_mut().clear()),
                (true, true) => current::poison_dropped_ends(|| {
                    current::with_abandoned(|| self.as_mut().clear());
                }),
            };
            match log_installer {
                None => drop_body(),
                // A completed body is dropped within its last poll. That is no part of its replay
                // log.
                Some(_) => current::without_replay_log(drop_body),
            }
        });
        if let Some(log_installer) = log_installer {
            log_installer.end();
        }
        match dropped {
            Ok(()) => {}
            // The first one counts, and dropping the other could panic in turn.
            Err(second) if end.is_panic() => core::mem::forget(second),
            Err(payload) => *end = End::Abandoned(Abandoned::Panicked(payload)),
        }
    }

    /// Keeps its exit value in the place of the body, which has [ended](Self::end).
    pub(crate) fn keep(mut self: Pin<&mut Self>, value: F::Output) {
        self.set(Self(Room::Value(value)));
    }

    /// Takes what was [kept](Self::keep).
    pub(crate) fn take_exit_value(self: Pin<&mut Self>) -> Option<F::Output> {
        // SAFETY: no future is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.0 {
            Room::Running(_) | Room::Unbuilt(_) => None,
            _ => match core::mem::replace(&mut this.0, Room::Empty) {
                Room::Value(value) => Some(value),
                _ => None,
            },
        }
    }
}

/// Polls a body by `poll` with all optional work around that, and catches its panic. `poll` ends
/// the body if it completes. Returns how the body is to [end](Body::end) otherwise. Not to be
/// called once it has ended.
pub(crate) fn poll_attentively(
    record: &Record,
    cx: &mut Context<'_>,
    mut poll: impl FnMut(&mut Context<'_>) -> Poll<()>,
) -> Option<Abandoned> {
    if record.is_cancelled() {
        return Some(Abandoned::Cancelled);
    }
    record.begin_poll();
    let mut has_completed = false;
    let polled = catch_unwind(|| {
        let mut poll = |cx: &mut Context<'_>| {
            let polled = poll(cx);
            has_completed = polled.is_ready();
            polled
        };
        match record.log_installer() {
            None => poll(cx),
            Some(log_installer) => log_installer.poll(cx, &mut poll),
        }
    });
    if has_completed {
        if let Err(payload) = polled {
            // Its end is published. Dropping the payload could panic in turn.
            core::mem::forget(payload);
        }
        return None;
    }
    record.end_poll();
    match polled {
        Err(payload) => Some(Abandoned::Panicked(payload)),
        Ok(Poll::Ready(())) => Some(Abandoned::Over),
        Ok(Poll::Pending) => record.is_cancelled().then_some(Abandoned::Cancelled),
    }
}

//! The body of a process, and the work around each of its polls.

use super::exit_value::{ErasedExitValue, ExitValue};
use super::record::{RawExit, Record, RecordRef};
use super::registry::ProcessRegistry;
use luna_core::current;
use std::any::Any;
use std::convert::Infallible;
use std::future::Future;
use std::hint::unreachable_unchecked;
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::ptr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

/// How a body ended, with its exit value before that is published.
pub(crate) enum End<O> {
    Completed(O),
    /// Its replay log has no further events: dropped where it waits.
    Over,
    Cancelled,
    Panicked(Box<dyn Any + Send>),
}

impl<O: ExitValue> End<O> {
    /// As its record stores it. `keep` finds a place for the exit value.
    pub(crate) fn into_raw(self, keep: impl FnOnce(O) -> ErasedExitValue) -> RawExit {
        match self {
            End::Completed(value) if !value.is_nothing() => RawExit::Value(keep(value)),
            End::Completed(_) | End::Over => RawExit::Completed,
            End::Cancelled => RawExit::Cancelled,
            End::Panicked(payload) => RawExit::Panicked(payload),
        }
    }
}

/// A process' body, with all that the framework does around each of its polls. It is always polled
/// with the same record. `B` makes the future where it is to run.
pub(crate) struct Body<F: Future, B = Infallible>(Room<F, F::Output, B>);

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

impl<F: Future> Body<F> {
    pub(crate) fn new(future: F) -> Self {
        Self(Room::Running(future))
    }
}

impl<F: Future, B> Body<F, B> {
    /// Drops what is there, whatever it is.
    pub(crate) fn clear(self: Pin<&mut Self>) {
        // SAFETY: a future is dropped in its place.
        unsafe { self.get_unchecked_mut() }.0 = Room::Empty;
    }

    /// Polls the future and nothing else. If it is ready or panics, [`end`](Self::end) is to be
    /// called.
    ///
    /// # Safety
    ///
    /// It has not ended before.
    #[inline(always)]
    pub(crate) unsafe fn poll_unended(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<F::Output> {
        // SAFETY: the future is never moved: it is polled pinned, and dropped in place; by the
        // contract it is there.
        unsafe {
            match &mut self.get_unchecked_mut().0 {
                Room::Running(future) => Pin::new_unchecked(future).poll(cx),
                _ => unreachable_unchecked(),
            }
        }
    }

    /// Polls the future with all optional work around a poll, and catches its panic; returns how it
    /// is to [end](Self::end), if it is. Not to be called once it has ended.
    pub(crate) fn poll_attentively(
        self: Pin<&mut Self>,
        record: &Record,
        cx: &mut Context<'_>,
    ) -> Option<End<F::Output>> {
        if record.cancelled.load(Ordering::Acquire) {
            return Some(End::Cancelled);
        }
        // SAFETY: the future is never moved: it is polled pinned, and dropped in place.
        let future = unsafe {
            match &mut self.get_unchecked_mut().0 {
                Room::Running(future) => Pin::new_unchecked(future),
                _ => return None,
            }
        };
        let began = record.is_timed().then(|| record.begin_poll());
        let mut is_over = false;
        let polled = catch_unwind(AssertUnwindSafe(|| match record.log_installer() {
            None => future.poll(cx),
            Some(log_installer) => {
                let mut future = future;
                let mut polled = Poll::Pending;
                let polls = log_installer.poll(cx, &mut |cx| {
                    polled = future.as_mut().poll(cx);
                    match polled {
                        Poll::Ready(_) => Poll::Ready(()),
                        Poll::Pending => Poll::Pending,
                    }
                });
                is_over = polls.is_ready() && polled.is_pending();
                polled
            }
        }));
        if let Some(began) = began {
            record.end_poll(began);
        }
        match polled {
            Ok(Poll::Pending) if is_over => Some(End::Over),
            Ok(Poll::Pending) if !record.cancelled.load(Ordering::Acquire) => None,
            Ok(Poll::Pending) => Some(End::Cancelled),
            Ok(Poll::Ready(value)) => Some(End::Completed(value)),
            Err(payload) => Some(End::Panicked(payload)),
        }
    }

    /// Drops the future. One that panicked is never polled again, so its half-done state stays
    /// invisible. Returns how it ended after all.
    #[cold]
    pub(crate) fn end(
        self: Pin<&mut Self>,
        record: &Record,
        end: End<F::Output>,
    ) -> End<F::Output> {
        // SAFETY: the future is dropped in its place.
        let this = unsafe { self.get_unchecked_mut() };
        // Dropping the body ends its channels before the end of the process is published. A body
        // that has not completed was left in the middle, and so is what it held.
        let abandoned = !matches!(end, End::Completed(_) | End::Over);
        let poisons = abandoned && record.is_poisoned();
        let dropped = catch_unwind(AssertUnwindSafe(|| {
            let mut drop_body = || match abandoned {
                true => current::with_abandoned(|| this.0 = Room::Empty),
                false => this.0 = Room::Empty,
            };
            if poisons {
                current::poison_dropped_ends(drop_body);
            } else {
                drop_body();
            }
        }));
        if let Some(log_installer) = record.log_installer() {
            log_installer.end();
        }
        match (end, dropped) {
            (End::Panicked(payload), Err(second)) => {
                // The first one counts, and dropping the other could panic in turn.
                std::mem::forget(second);
                End::Panicked(payload)
            }
            (_, Err(payload)) => End::Panicked(payload),
            (end, Ok(())) => end,
        }
    }

    /// Keeps its exit value in the place of the body, which has [ended](Self::end).
    pub(crate) fn keep(self: Pin<&mut Self>, value: F::Output) {
        // SAFETY: there is no future any more.
        unsafe { self.get_unchecked_mut() }.0 = Room::Value(value);
    }

    /// Takes what was [kept](Self::keep).
    pub(crate) fn take_exit_value(self: Pin<&mut Self>) -> Option<F::Output> {
        // SAFETY: no future is moved.
        let this = unsafe { self.get_unchecked_mut() };
        match this.0 {
            Room::Running(_) | Room::Unbuilt(_) => None,
            _ => match std::mem::replace(&mut this.0, Room::Empty) {
                Room::Value(value) => Some(value),
                _ => None,
            },
        }
    }
}

/// A body that is polled by another's loop.
pub(crate) struct Recorded<F: Future> {
    body: Body<F>,
    record: RecordRef,
    registry: Arc<ProcessRegistry>,
    /// For its exit value, which outlives it. `None` once the value is there.
    room: Option<Box<MaybeUninit<F::Output>>>,
}

impl<F: Future<Output: ExitValue>> Recorded<F> {
    /// Allocates, unless there can be no exit value.
    pub(crate) fn new(future: F, record: RecordRef, registry: Arc<ProcessRegistry>) -> Self {
        Self {
            body: Body::new(future),
            record,
            registry,
            room: Some(Box::new_uninit()),
        }
    }
}

impl<F: Future<Output: ExitValue>> Future for Recorded<F> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: the body is pinned with the whole, and what else there is, is not.
        let (mut body, record, registry, room) = unsafe {
            let this = self.get_unchecked_mut();
            let body = Pin::new_unchecked(&mut this.body);
            (body, &this.record, &this.registry, &mut this.room)
        };
        let Some(end) = body.as_mut().poll_attentively(record, cx) else {
            return Poll::Pending;
        };
        let end = body.end(record, end);
        let keep =
            |value| ErasedExitValue::boxed(room.take().unwrap_or_else(Box::new_uninit), value);
        record.end(end.into_raw(keep), registry);
        Poll::Ready(())
    }
}

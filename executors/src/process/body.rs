//! The body of a process, and what is done around each of its polls.

use super::record::{RawExit, Record};
use luna_platform::current;
use std::any::Any;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

/// A process' body, with all that the framework does around each of its polls.
pub(crate) struct Body<F> {
    /// `None` once it has ended.
    future: Option<F>,
    record: Arc<Record>,
}

impl<F: Future<Output = ()>> Body<F> {
    pub(crate) fn new(future: F, record: Arc<Record>) -> Self {
        Self {
            future: Some(future),
            record,
        }
    }

    /// Polls the future and nothing else; `true` if that has ended it. If it panics, [`end_panicked`](Self::end_panicked) is to be called.
    ///
    /// # Safety
    ///
    /// It has not ended before.
    #[inline(always)]
    pub(crate) unsafe fn poll_unended(self: Pin<&mut Self>, cx: &mut Context<'_>) -> bool {
        // SAFETY: `future` is never moved: it is polled pinned, and dropped in place; by the contract it is there.
        unsafe {
            let this = self.get_unchecked_mut();
            let future = this.future.as_mut().unwrap_unchecked();
            let has_ended = Pin::new_unchecked(future).poll(cx).is_ready();
            if has_ended {
                this.end(RawExit::Completed);
            }
            has_ended
        }
    }

    /// Ends it after its poll has panicked. A body that panicked is dropped and never polled again, so nobody sees what it left half done.
    pub(crate) fn end_panicked(self: Pin<&mut Self>, payload: Box<dyn Any + Send>) {
        // SAFETY: as above.
        let this = unsafe { self.get_unchecked_mut() };
        this.end(RawExit::Panicked(payload));
    }
}

/// As a future it looks at all that may be asked for around a poll, and catches its panic.
impl<F: Future<Output = ()>> Future for Body<F> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: `future` is never moved: it is polled pinned, and dropped in place.
        let this = unsafe { self.get_unchecked_mut() };
        let record = &*this.record;
        if !record.cancelled.load(Ordering::Acquire) {
            let Some(future) = this.future.as_mut() else {
                return Poll::Ready(());
            };
            let began = record.timed.then(|| record.begin_poll());
            // SAFETY: see above.
            let future = unsafe { Pin::new_unchecked(future) };
            let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| future.poll(cx)));
            if let Some(began) = began {
                record.end_poll(began);
            }
            let exit = match polled {
                Ok(Poll::Pending) if !record.cancelled.load(Ordering::Acquire) => {
                    return Poll::Pending;
                }
                Ok(Poll::Pending) => RawExit::Cancelled,
                Ok(Poll::Ready(())) => RawExit::Completed,
                Err(payload) => RawExit::Panicked(payload),
            };
            this.end(exit);
        } else {
            this.end(RawExit::Cancelled);
        }
        Poll::Ready(())
    }
}

impl<F> Body<F> {
    fn end(&mut self, exit: RawExit) {
        // Dropping the body ends its channels before anybody learns that the process has ended. One that has not come to its end was left in
        // the middle, and so is what it held.
        let abandoned = !matches!(exit, RawExit::Completed);
        let poisons = abandoned && self.record.is_poisoned();
        let dropped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let mut drop_body = || match abandoned {
                true => current::with_abandoned(|| self.future = None),
                false => self.future = None,
            };
            if poisons {
                current::poison_dropped_ends(drop_body);
            } else {
                drop_body();
            }
        }));
        let exit = match (exit, dropped) {
            (RawExit::Panicked(payload), Err(second)) => {
                // The first one counts, and dropping the other could panic in turn.
                std::mem::forget(second);
                RawExit::Panicked(payload)
            }
            (_, Err(payload)) => RawExit::Panicked(payload),
            (exit, Ok(())) => exit,
        };
        self.record.finish(exit);
    }
}

//! The body of a process, and what is done around each of its polls.

use super::ProcessState;
use super::record::{RawExit, Record};
use crate::interference;
use luna_platform::current;
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
}

impl<F: Future<Output = ()>> Future for Body<F> {
    type Output = ();

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: `future` is never moved: it is polled pinned, and dropped in place.
        let this = unsafe { self.get_unchecked_mut() };
        let record = &*this.record;
        if !record.cancelled.load(Ordering::Acquire) {
            let Some(future) = this.future.as_mut() else {
                return Poll::Ready(());
            };
            record.set_state(ProcessState::Running);
            record
                .polls
                .store(record.polls.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
            let began = record.timed.then(|| record.begin_poll());
            // SAFETY: see above.
            let future = unsafe { Pin::new_unchecked(future) };
            // A body that panicked is dropped and never polled again, so nobody sees what it left half done.
            let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| future.poll(cx)));
            interference::polled(record.id);
            if let Some(began) = began {
                record.end_poll(began);
            }
            match polled {
                // A wake during the poll schedules after this store, so it has the last word.
                Ok(Poll::Pending) if !record.cancelled.load(Ordering::Acquire) => {
                    record.set_state(ProcessState::Waiting);
                    return Poll::Pending;
                }
                Ok(Poll::Pending) => {}
                Ok(Poll::Ready(())) => return this.end(RawExit::Completed),
                Err(payload) => return this.end(RawExit::Panicked(payload)),
            }
        }
        this.end(RawExit::Cancelled)
    }
}

impl<F> Body<F> {
    fn end(&mut self, exit: RawExit) -> Poll<()> {
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
        Poll::Ready(())
    }
}

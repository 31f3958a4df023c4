//! The body of a process, and what is done around each of its polls.

use super::living::Living;
use super::record::{RawExit, Record};
use luna_platform::current;
use std::any::Any;
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

/// Whose body it is, and whom it is counted among.
#[derive(Clone, Copy)]
pub(crate) struct Of<'a> {
    pub(crate) record: &'a Arc<Record>,
    pub(crate) living: &'a Living,
}

/// A process' body, with all that the framework does around each of its polls. It is always polled with the same record.
pub(crate) struct Body<F> {
    /// `None` once it has ended.
    future: Option<F>,
}

impl<F: Future<Output = ()>> Body<F> {
    pub(crate) fn new(future: F) -> Self {
        Self {
            future: Some(future),
        }
    }

    /// Polls the future and nothing else; `true` if that has ended it. If it panics, [`end_panicked`](Self::end_panicked) is to be called. Whose it is, is asked for only when
    /// it has ended: most polls touch nothing of that.
    ///
    /// # Safety
    ///
    /// It has not ended before.
    #[inline(always)]
    pub(crate) unsafe fn poll_unended<'a>(
        self: Pin<&mut Self>,
        of: impl FnOnce() -> Of<'a>,
        cx: &mut Context<'_>,
    ) -> bool {
        // SAFETY: `future` is never moved: it is polled pinned, and dropped in place; by the contract it is there.
        unsafe {
            let this = self.get_unchecked_mut();
            let future = this.future.as_mut().unwrap_unchecked();
            let has_ended = Pin::new_unchecked(future).poll(cx).is_ready();
            if has_ended {
                this.end(of(), RawExit::Completed);
            }
            has_ended
        }
    }

    /// Ends it after its poll has panicked. A body that panicked is dropped and never polled again, so nobody sees what it left half done.
    pub(crate) fn end_panicked(self: Pin<&mut Self>, of: Of<'_>, payload: Box<dyn Any + Send>) {
        // SAFETY: as above.
        let this = unsafe { self.get_unchecked_mut() };
        this.end(of, RawExit::Panicked(payload));
    }

    /// Polls the future with all that may be asked for around a poll, and catches its panic; `true` if it has ended.
    pub(crate) fn poll_attentively(self: Pin<&mut Self>, of: Of<'_>, cx: &mut Context<'_>) -> bool {
        // SAFETY: `future` is never moved: it is polled pinned, and dropped in place.
        let this = unsafe { self.get_unchecked_mut() };
        let record = &**of.record;
        if !record.cancelled.load(Ordering::Acquire) {
            let Some(future) = this.future.as_mut() else {
                return true;
            };
            let began = record.is_timed().then(|| record.begin_poll());
            // SAFETY: see above.
            let future = unsafe { Pin::new_unchecked(future) };
            let polled =
                std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| match record.taper() {
                    None => future.poll(cx),
                    Some(taper) => {
                        let mut future = future;
                        taper.poll(cx, &mut |cx| future.as_mut().poll(cx))
                    }
                }));
            if let Some(began) = began {
                record.end_poll(began);
            }
            let exit = match polled {
                Ok(Poll::Pending) if !record.cancelled.load(Ordering::Acquire) => {
                    return false;
                }
                Ok(Poll::Pending) => RawExit::Cancelled,
                Ok(Poll::Ready(())) => RawExit::Completed,
                Err(payload) => RawExit::Panicked(payload),
            };
            this.end(of, exit);
        } else {
            this.end(of, RawExit::Cancelled);
        }
        true
    }
}

impl<F> Body<F> {
    #[cold]
    fn end(&mut self, of: Of<'_>, exit: RawExit) {
        // Dropping the body ends its channels before anybody learns that the process has ended. One that has not come to its end was left in
        // the middle, and so is what it held.
        let abandoned = !matches!(exit, RawExit::Completed);
        let poisons = abandoned && of.record.is_poisoned();
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
        if let Some(taper) = of.record.taper() {
            taper.end();
        }
        let exit = match (exit, dropped) {
            (RawExit::Panicked(payload), Err(second)) => {
                // The first one counts, and dropping the other could panic in turn.
                std::mem::forget(second);
                RawExit::Panicked(payload)
            }
            (_, Err(payload)) => RawExit::Panicked(payload),
            (exit, Ok(())) => exit,
        };
        of.record.finish(exit, of.living);
    }
}

/// A body that is polled by another's loop.
pub(crate) struct Recorded<F> {
    body: Body<F>,
    record: Arc<Record>,
    living: Arc<Living>,
}

impl<F: Future<Output = ()>> Recorded<F> {
    pub(crate) fn new(future: F, record: Arc<Record>, living: Arc<Living>) -> Self {
        Self {
            body: Body::new(future),
            record,
            living,
        }
    }
}

impl<F: Future<Output = ()>> Future for Recorded<F> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: the body is pinned with the whole.
        let (body, of) = unsafe {
            let this = self.get_unchecked_mut();
            let of = Of {
                record: &this.record,
                living: &this.living,
            };
            (Pin::new_unchecked(&mut this.body), of)
        };
        match body.poll_attentively(of, cx) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        }
    }
}

//! Taking permits of a semaphore, as a future.

use super::error::{AcquireError, AcquireTimeoutError};
use super::permit::SemaphorePermit;
use super::semaphore::Semaphore;
use super::take::{Take, TakeUntil};
use luna_core::timer_queue::Sleep;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// Taking permits of a semaphore: see [`Semaphore::acquire`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct AcquireOp<'a> {
    semaphore: &'a Semaphore,
    take: Take<'a>,
}

impl<'a> AcquireOp<'a> {
    #[inline]
    pub(super) fn new(semaphore: &'a Semaphore, count: u32) -> Self {
        AcquireOp {
            semaphore,
            take: semaphore.take(count, false),
        }
    }
}

impl<'a> Future for AcquireOp<'a> {
    type Output = Result<SemaphorePermit<'a>, AcquireError>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let (semaphore, count) = (self.semaphore, self.take.count);
        // SAFETY: the take is pinned with the whole.
        let take = unsafe { self.map_unchecked_mut(|this| &mut this.take) };
        // SAFETY: a take that succeeds gives the permits to its caller.
        let permit = |()| unsafe { SemaphorePermit::new(semaphore, count) };
        take.poll(cx).map_ok(permit)
    }
}

/// Taking a permit until a deadline: see [`Semaphore::acquire_timeout`].
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct AcquireTimeout<'a> {
    semaphore: &'a Semaphore,
    take: TakeUntil<'a>,
}

impl<'a> AcquireTimeout<'a> {
    pub(super) fn new(semaphore: &'a Semaphore, sleep: Sleep) -> Self {
        let take = semaphore.take(1, false);
        AcquireTimeout {
            semaphore,
            take: TakeUntil { take, sleep },
        }
    }
}

impl<'a> Future for AcquireTimeout<'a> {
    type Output = Result<SemaphorePermit<'a>, AcquireTimeoutError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let semaphore = self.semaphore;
        // SAFETY: the take is pinned with the whole.
        let take = unsafe { self.map_unchecked_mut(|this| &mut this.take) };
        // SAFETY: a take that succeeds gives the permit to its caller.
        let permit = |()| unsafe { SemaphorePermit::new(semaphore, 1) };
        take.poll(cx).map_ok(permit)
    }
}

//! Taking permits of a semaphore, as a future.

use super::error::{AcquireError, AcquireTimeoutError};
use super::permit::SemaphorePermit;
use super::semaphore::Semaphore;
use super::take::Take;
use crate::replay;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use luna_core::timer_queue::Sleep;
use pin_project_lite::pin_project;

pin_project! {
    /// Taking permits of a semaphore: see [`Semaphore::acquire`].
    #[derive(Debug)]
    #[must_use = "an operation does nothing unless awaited"]
    pub struct AcquireOp<'a> {
        semaphore: &'a Semaphore,
        #[pin]
        take: Take<'a>,
    }
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
        let this = self.project();
        let (semaphore, count) = (*this.semaphore, this.take.count);
        let taken = this.take.poll(cx);
        taken.map_ok(|_| SemaphorePermit::taken(semaphore, count))
    }
}

pin_project! {
    /// Taking a permit until a deadline: see [`Semaphore::acquire_timeout`].
    #[derive(Debug)]
    #[must_use = "an operation does nothing unless awaited"]
    pub struct AcquireTimeout<'a> {
        semaphore: &'a Semaphore,
        #[pin]
        take: Take<'a>,
        #[pin]
        sleep: Sleep,
    }
}

impl<'a> AcquireTimeout<'a> {
    pub(super) fn new(semaphore: &'a Semaphore, sleep: Sleep) -> Self {
        AcquireTimeout {
            semaphore,
            take: semaphore.take(1, false),
            sleep,
        }
    }
}

impl<'a> Future for AcquireTimeout<'a> {
    type Output = Result<SemaphorePermit<'a>, AcquireTimeoutError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        let semaphore = *this.semaphore;
        let taken = replay::poll_until(this.take, this.sleep, cx);
        taken.map_ok(|_| SemaphorePermit::taken(semaphore, 1))
    }
}

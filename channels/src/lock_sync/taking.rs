//! Locking a mutex and taking permits of a semaphore, as futures.

use super::core::Hold;
use super::guard::MutexGuard;
use super::guard::{AcquireError, AcquireTimeoutError, LockError, LockTimeoutError};
use super::mutex::Mutex;
use super::semaphore::Semaphore;
use super::semaphore::SemaphorePermit;
use super::take::{InTime, Take};
use crate::replay;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll, ready};
use luna_core::timer_queue::Sleep;
use pin_project_lite::pin_project;

/// What permits are taken of: a [`Mutex`] or a [`Semaphore`]. Sealed: its module is private.
pub trait Permits: Copy {
    /// What has them.
    type Guard;
    /// Why they were not simply taken.
    type Error;
    /// Why they were not simply taken in time.
    type TimeoutError: From<Self::Error>;

    /// The error when the time runs out.
    const TIMEOUT: Self::TimeoutError;

    /// The result for the caller, of a take of so many.
    fn taken(
        self,
        count: u32,
        taken: Result<Hold<'_>, AcquireError>,
    ) -> Result<Self::Guard, Self::Error>;

    /// As [`taken`](Self::taken), of one that gives up.
    fn taken_in_time(
        self,
        count: u32,
        taken: InTime<'_>,
    ) -> Result<Self::Guard, Self::TimeoutError> {
        Ok(self.taken(count, taken.ok_or(Self::TIMEOUT)?)?)
    }
}

impl<'a, T> Permits for &'a Mutex<T> {
    type Guard = MutexGuard<'a, T>;
    type Error = LockError<'a, T>;
    type TimeoutError = LockTimeoutError<'a, T>;

    const TIMEOUT: Self::TimeoutError = LockTimeoutError::Timeout;

    #[inline]
    fn taken(
        self,
        _: u32,
        taken: Result<Hold<'_>, AcquireError>,
    ) -> Result<Self::Guard, Self::Error> {
        let hold = taken.map_err(|AcquireError| LockError::Poisoned)?;
        self.held(hold).map_err(LockError::OwnerDied)
    }
}

impl<'a> Permits for &'a Semaphore {
    type Guard = SemaphorePermit<'a>;
    type Error = AcquireError;
    type TimeoutError = AcquireTimeoutError;

    const TIMEOUT: AcquireTimeoutError = AcquireTimeoutError::Timeout;

    #[inline]
    fn taken(
        self,
        count: u32,
        taken: Result<Hold<'_>, AcquireError>,
    ) -> Result<SemaphorePermit<'a>, AcquireError> {
        taken.map(|_| SemaphorePermit::taken(self, count))
    }
}

/// Locking a mutex: see [`Mutex::lock`].
pub type LockOp<'a, T> = TakeOp<'a, &'a Mutex<T>>;
/// Locking a mutex until a deadline: see [`Mutex::lock_timeout`].
pub type LockTimeout<'a, T> = TakeTimeout<'a, &'a Mutex<T>>;
/// Taking permits of a semaphore: see [`Semaphore::acquire`].
pub type AcquireOp<'a> = TakeOp<'a, &'a Semaphore>;
/// Taking a permit until a deadline: see [`Semaphore::acquire_timeout`].
pub type AcquireTimeout<'a> = TakeTimeout<'a, &'a Semaphore>;

pin_project! {
    /// Locking, or taking permits: a [`LockOp`] or an [`AcquireOp`].
    #[must_use = "an operation does nothing unless awaited"]
    pub struct TakeOp<'a, P> {
        pub(super) of: P,
        #[pin]
        pub(super) take: Take<'a>,
    }
}

impl<'a, P> TakeOp<'a, P> {
    pub(super) fn until(self, sleep: Sleep) -> TakeTimeout<'a, P> {
        TakeTimeout { op: self, sleep }
    }
}

impl<P: Permits> Future for TakeOp<'_, P> {
    type Output = Result<P::Guard, P::Error>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        let count = this.take.count;
        Poll::Ready(this.of.taken(count, ready!(this.take.poll(cx))))
    }
}

luna_platform::debug_fields!(impl[P] TakeOp<'_, P>, |op| phase: op.take);

pin_project! {
    /// As [`TakeOp`], until a deadline: a [`LockTimeout`] or an [`AcquireTimeout`].
    #[must_use = "an operation does nothing unless awaited"]
    pub struct TakeTimeout<'a, P> {
        #[pin]
        op: TakeOp<'a, P>,
        #[pin]
        sleep: Sleep,
    }
}

impl<P: Permits> Future for TakeTimeout<'_, P> {
    type Output = Result<P::Guard, P::TimeoutError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        let op = this.op.project();
        let count = op.take.count;
        let taken = ready!(replay::poll_until(op.take, this.sleep, cx));
        Poll::Ready(op.of.taken_in_time(count, taken))
    }
}

luna_platform::debug_fields!(impl[P] TakeTimeout<'_, P>, |timeout| phase: timeout.op.take);

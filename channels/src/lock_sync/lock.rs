//! Locking a mutex, as a future.

use super::error::{LockError, LockTimeoutError};
use super::guard::MutexGuard;
use super::mutex::Mutex;
use super::take::Take;
use crate::replay;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use luna_core::timer_queue::Sleep;
use pin_project_lite::pin_project;

pin_project! {
    /// Locking a mutex: see [`Mutex::lock`].
    #[must_use = "an operation does nothing unless awaited"]
    pub struct LockOp<'a, T> {
        mutex: &'a Mutex<T>,
        #[pin]
        take: Take<'a>,
    }
}

impl<'a, T> LockOp<'a, T> {
    #[inline]
    pub(super) fn new(mutex: &'a Mutex<T>) -> Self {
        LockOp {
            mutex,
            take: mutex.take(false),
        }
    }
}

impl<'a, T> Future for LockOp<'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockError<'a, T>>;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        let taken = this.take.poll(cx);
        taken.map(|taken| this.mutex.taken(taken))
    }
}

luna_platform::debug_fields!(impl[T] LockOp<'_, T>, |op| phase: op.take);

pin_project! {
    /// Locking a mutex until a deadline: see [`Mutex::lock_timeout`].
    #[derive(Debug)]
    #[must_use = "an operation does nothing unless awaited"]
    pub struct LockTimeout<'a, T> {
        mutex: &'a Mutex<T>,
        #[pin]
        take: Take<'a>,
        #[pin]
        sleep: Sleep,
    }
}

impl<'a, T> LockTimeout<'a, T> {
    pub(super) fn new(mutex: &'a Mutex<T>, sleep: Sleep) -> Self {
        LockTimeout {
            mutex,
            take: mutex.take(false),
            sleep,
        }
    }
}

impl<'a, T> Future for LockTimeout<'a, T> {
    type Output = Result<MutexGuard<'a, T>, LockTimeoutError<'a, T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        let taken = replay::poll_until(this.take, this.sleep, cx);
        taken.map(|taken| this.mutex.taken_in_time(taken))
    }
}

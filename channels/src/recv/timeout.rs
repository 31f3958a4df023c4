//! A receive that gives up: at a deadline, or when something else happens.

use super::operation::RecvOp;
use crate::error::RecvTimeoutError;
use crate::replay;
use luna_core::timer_queue::Sleep;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A receive under way that gives up when `S` has ended, which is a deadline or anything else: see
/// [`Receiver::recv_timeout`](crate::Receiver::recv_timeout) and
/// [`Receiver::recv_unless`](crate::Receiver::recv_unless).
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct RecvTimeout<'a, T, S = Sleep> {
    pub(super) recv: RecvOp<'a, T>,
    pub(super) stop: S,
}

impl<T, S: Future<Output = ()>> Future for RecvTimeout<'_, T, S> {
    type Output = Result<T, RecvTimeoutError>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (recv, stop) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.recv),
                Pin::new_unchecked(&mut this.stop),
            )
        };
        replay::poll_until(recv, stop, cx)
    }
}

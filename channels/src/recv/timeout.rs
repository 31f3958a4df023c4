//! A receive that gives up at a deadline.

use super::operation::{Phase, RecvOp};
use crate::error::RecvTimeoutError;
use luna_platform::timer_queue::Sleep;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A receive under way that gives up at a deadline: see [`Receiver::recv_timeout`](crate::Receiver::recv_timeout).
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct RecvTimeout<'a, T> {
    pub(super) recv: RecvOp<'a, T>,
    pub(super) sleep: Sleep,
}

impl<T> Future for RecvTimeout<'_, T> {
    type Output = Result<T, RecvTimeoutError>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut recv, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.recv),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        if let Poll::Ready(received) = recv.as_mut().poll(cx) {
            return Poll::Ready(received.map_err(RecvTimeoutError::from));
        }
        // One that has communicated lets others run, and is done then, whatever the time is.
        if recv.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        match sleep.poll(cx) {
            Poll::Ready(()) => Poll::Ready(recv.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}

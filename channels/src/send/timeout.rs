//! A send that gives up at a deadline.

use super::operation::{Phase, SendOp};
use crate::error::SendTimeoutError;
use luna_platform::timer_queue::Sleep;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A send under way that gives up at a deadline: see [`Sender::send_timeout`](crate::Sender::send_timeout).
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct SendTimeout<'a, T> {
    pub(super) send: SendOp<'a, T>,
    pub(super) sleep: Sleep,
}

impl<T> Future for SendTimeout<'_, T> {
    type Output = Result<(), SendTimeoutError<T>>;

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut send, sleep) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.send),
                Pin::new_unchecked(&mut this.sleep),
            )
        };
        if let Poll::Ready(sent) = send.as_mut().poll(cx) {
            return Poll::Ready(sent.map_err(SendTimeoutError::from));
        }
        // One that has communicated lets others run, and is done then, whatever the time is.
        if send.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        match sleep.poll(cx) {
            Poll::Ready(()) => Poll::Ready(send.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}

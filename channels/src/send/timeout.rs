//! A send that gives up: at a deadline, or when something else happens.

use super::operation::SendOp;
use crate::error::SendTimeoutError;
use crate::replay;
use luna_core::timer_queue::Sleep;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// A send under way that gives up when `S` has ended, which is a deadline or anything else: see
/// [`Sender::send_timeout`](crate::Sender::send_timeout) and
/// [`Sender::send_unless`](crate::Sender::send_unless).
#[derive(Debug)]
#[must_use = "an operation does nothing unless awaited"]
pub struct SendTimeout<'a, T, S = Sleep> {
    pub(super) send: SendOp<'a, T>,
    pub(super) stop: S,
}

impl<T, S: Future<Output = ()>> Future for SendTimeout<'_, T, S> {
    type Output = Result<(), SendTimeoutError<T>>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (send, stop) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.send),
                Pin::new_unchecked(&mut this.stop),
            )
        };
        replay::poll_until(send, stop, cx)
    }
}

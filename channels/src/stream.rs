//! A receiver as a stream.

use crate::operation::RecvOp;
use crate::receiver::Receiver;
use futures_core::Stream;
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// The values of a channel as a stream: see [`Receiver::stream`].
///
/// Cancel-safe: when it is dropped, a value that it was given and has not handed on goes back to
/// the head of the channel. Real-time path: yes, as [`Receiver::recv`].
#[must_use = "a stream does nothing unless polled"]
pub struct Incoming<'a, T> {
    receiver: &'a Receiver<T>,
    /// Pinned with the whole while it is there.
    recv: Option<RecvOp<'a, T>>,
}

impl<'a, T> Incoming<'a, T> {
    pub(crate) fn new(receiver: &'a Receiver<T>) -> Self {
        Self {
            receiver,
            recv: None,
        }
    }
}

impl<T> Stream for Incoming<'_, T> {
    type Item = T;

    fn poll_next(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<T>> {
        // SAFETY: `recv` is put in place, polled there, and dropped there; it never moves.
        let this = unsafe { self.get_unchecked_mut() };
        let receiver = this.receiver;
        let recv = this.recv.get_or_insert_with(|| receiver.recv());
        // SAFETY: as above.
        let polled = unsafe { Pin::new_unchecked(recv) }.poll(cx);
        if polled.is_ready() {
            this.recv = None;
        }
        polled.map(Result::ok)
    }
}

impl<T> fmt::Debug for Incoming<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Incoming")
            .field("receiver", self.receiver)
            .finish_non_exhaustive()
    }
}

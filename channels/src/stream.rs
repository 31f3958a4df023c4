//! A receiver as a stream.

use crate::operation::RecvOp;
use crate::receiver::Receiver;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use futures_core::Stream;
use pin_project_lite::pin_project;

pin_project! {
    /// The values of a channel as a stream: see [`Receiver::stream`].
    ///
    /// Cancel-safe: when it is dropped, a value that it was given and has not handed on goes back
    /// to the head of the channel. Real-time path: yes, as [`Receiver::recv`].
    #[must_use = "a stream does nothing unless polled"]
    pub struct Incoming<'a, T> {
        receiver: &'a Receiver<T>,
        #[pin]
        recv: Option<RecvOp<'a, T>>,
    }
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
        let mut this = self.project();
        if this.recv.is_none() {
            this.recv.set(Some(this.receiver.recv()));
        }
        let Some(recv) = this.recv.as_mut().as_pin_mut() else {
            unreachable!("it was just put there")
        };
        let polled = recv.poll(cx);
        if polled.is_ready() {
            this.recv.set(None);
        }
        polled.map(Result::ok)
    }
}

luna_platform::debug_fields!(impl[T] Incoming<'_, T>, |incoming| receiver: incoming.receiver);

//! A sender as a sink.

use crate::error::SendError;
use crate::sender::Sender;
use alloc::boxed::Box;
use core::pin::Pin;
use core::task::{Context, Poll, ready};
use futures_util::sink::{Sink, unfold};

/// A sink that drops what it sends by when it is closed.
struct Closing<S>(Option<Pin<Box<S>>>);

impl<S> Closing<S> {
    fn open(self: Pin<&mut Self>) -> Pin<&mut S> {
        let sink = self.get_mut().0.as_mut();
        sink.expect("a sink was used after it was closed").as_mut()
    }
}

impl<T, S: Sink<T>> Sink<T> for Closing<S> {
    type Error = S::Error;

    fn poll_ready(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.open().poll_ready(cx)
    }

    fn start_send(self: Pin<&mut Self>, value: T) -> Result<(), S::Error> {
        self.open().start_send(value)
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.open().poll_flush(cx)
    }

    fn poll_close(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        if let Some(sink) = &mut self.0 {
            ready!(sink.as_mut().poll_close(cx))?;
            self.0 = None;
        }
        Poll::Ready(Ok(()))
    }
}

impl<T> Sender<T> {
    /// The sender as a sink: each value is sent as by [`send`](Self::send), and the next one is
    /// taken when it was. Closing the sink drops the sender. Allocates once, here. A sink that has
    /// returned an error has ended, and is not to be used again.
    ///
    /// # Panics
    ///
    /// The sink does when it is used after it was closed.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// use futures_util::SinkExt;
    ///
    /// let (sender, receiver) = luna_channels::channel();
    /// let mut sink = sender.into_sink();
    /// assert_eq!(block_on(zip(sink.send(4), receiver.recv())), (Ok(()), Ok(4)));
    /// assert_eq!(block_on(sink.close()), Ok(()));
    /// assert_eq!(block_on(receiver.recv()), Err(luna_channels::RecvError::Closed));
    /// ```
    pub fn into_sink(self) -> impl Sink<T, Error = SendError<T>> + Unpin + use<T> {
        let send = |sender: Sender<T>, value| async move {
            sender.send(value).await?;
            Ok(sender)
        };
        Closing(Some(Box::pin(unfold(self, send))))
    }
}

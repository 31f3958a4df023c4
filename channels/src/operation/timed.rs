//! An operation that gives up: at a deadline, or when something else happens.

use super::{GivesUp, Operation, Receiving, Sending};
use crate::extended::Releasing;
use crate::replay;
use crate::source::InNode;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};
use luna_core::timer_queue::Sleep;
use pin_project_lite::pin_project;

/// A send under way that gives up when `S` has ended, which is a deadline or anything else: see
/// [`Sender::send_timeout`](crate::Sender::send_timeout) and
/// [`Sender::send_unless`](crate::Sender::send_unless).
pub type SendTimeout<'a, T, S = Sleep> = Timed<'a, T, Sending<InNode>, S>;

/// A receive under way that gives up when `S` has ended, which is a deadline or anything else: see
/// [`Receiver::recv_timeout`](crate::Receiver::recv_timeout) and
/// [`Receiver::recv_unless`](crate::Receiver::recv_unless).
pub type RecvTimeout<'a, T, S = Sleep> = Timed<'a, T, Receiving<Releasing>, S>;

pin_project! {
    /// An operation until `S` has ended: a [`SendTimeout`] or a [`RecvTimeout`].
    #[derive(Debug)]
    #[must_use = "an operation does nothing unless awaited"]
    pub struct Timed<'a, T, D: GivesUp<T>, S> {
        #[pin]
        pub(crate) operation: Operation<'a, T, D>,
        #[pin]
        pub(crate) stop: S,
    }
}

impl<'a, T, D: GivesUp<T>, S: Future<Output = ()>> Future for Timed<'a, T, D, S> {
    type Output = Result<D::Success<'a>, D::TimeoutFailure>;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        let this = self.project();
        replay::poll_until(this.operation, this.stop, cx)
    }
}

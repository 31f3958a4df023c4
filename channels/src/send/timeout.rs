//! A send that gives up: at a deadline, or when something else happens.

use super::operation::SendOp;
use crate::error::SendTimeoutError;
use crate::taped;
use luna_core::current;
use luna_core::events;
use luna_core::replay_log::Event;
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

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut send, stop) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.send),
                Pin::new_unchecked(&mut this.stop),
            )
        };
        if current::is_taped() {
            return poll_taped(send, stop, cx);
        }
        if let Poll::Ready(sent) = send.as_mut().poll(cx) {
            return Poll::Ready(sent.map_err(SendTimeoutError::from));
        }
        // One that has communicated, or failed, lets others run, and is over then, whatever the
        // time is.
        if send.lets_others_run() {
            return Poll::Pending;
        }
        match events::beside(|| stop.poll(cx)) {
            Poll::Ready(()) => Poll::Ready(send.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}

/// As the process' replay log says: see the receive's.
#[cold]
fn poll_taped<T, S: Future<Output = ()>>(
    mut send: Pin<&mut SendOp<'_, T>>,
    stop: Pin<&mut S>,
    cx: &mut Context<'_>,
) -> Poll<Result<(), SendTimeoutError<T>>> {
    if send.is_new() && std::task::ready!(taped::enter_timed(cx)).is_err() {
        return Poll::Ready(send.give_up());
    }
    let polled = send.as_mut().poll(cx);
    if polled.is_ready() {
        return polled.map_err(SendTimeoutError::from);
    }
    if !send.is_listed()
        || taped::is_replayed()
        || current::without_tape(|| events::beside(|| stop.poll(cx))).is_pending()
    {
        return Poll::Pending;
    }
    let outcome = send.as_mut().give_up();
    match &outcome {
        Err(SendTimeoutError::Timeout(_)) => taped::has_timed_out(),
        Err(SendTimeoutError::Poisoned(_)) => {
            taped::leave(Event::failed(taped::failure::POISONED));
        }
        Err(_) => taped::leave(Event::failed(taped::failure::CLOSED)),
        // SAFETY: it was listed on the slow path, and only a partner can have completed it.
        Ok(_) => taped::has_waited(unsafe { send.order() }),
    }
    Poll::Ready(outcome)
}

//! A receive that gives up: at a deadline, or when something else happens.

use super::operation::RecvOp;
use crate::error::RecvTimeoutError;
use crate::taped;
use luna_core::current;
use luna_core::events;
use luna_core::replay_log::Event;
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

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Self::Output> {
        // SAFETY: both fields are pinned with the whole, and never moved.
        let (mut recv, stop) = unsafe {
            let this = self.get_unchecked_mut();
            (
                Pin::new_unchecked(&mut this.recv),
                Pin::new_unchecked(&mut this.stop),
            )
        };
        if current::is_taped() {
            return poll_taped(recv, stop, cx);
        }
        if let Poll::Ready(received) = recv.as_mut().poll(cx) {
            return Poll::Ready(received.map_err(RecvTimeoutError::from));
        }
        // One that has communicated, or failed, lets others run, and is over then, whatever the
        // time is.
        if recv.lets_others_run() {
            return Poll::Pending;
        }
        match events::beside(|| stop.poll(cx)) {
            Poll::Ready(()) => Poll::Ready(recv.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}

/// As the process' replay log says: a replayed receive gives up when the recorded one did, whatever
/// the time is or has happened, and is admitted here, and not by a partner.
#[cold]
fn poll_taped<T, S: Future<Output = ()>>(
    mut recv: Pin<&mut RecvOp<'_, T>>,
    stop: Pin<&mut S>,
    cx: &mut Context<'_>,
) -> Poll<Result<T, RecvTimeoutError>> {
    if recv.is_new() && std::task::ready!(taped::enter_timed(cx)).is_err() {
        return Poll::Ready(recv.give_up());
    }
    let polled = recv.as_mut().poll(cx);
    if polled.is_ready() {
        return polled.map_err(RecvTimeoutError::from);
    }
    // One that is let in later, or has communicated and lets others run, is not late.
    if !recv.is_listed()
        || taped::is_replayed()
        || events::beside(|| current::without_tape(|| stop.poll(cx))).is_pending()
    {
        return Poll::Pending;
    }
    let outcome = recv.as_mut().give_up();
    match &outcome {
        Err(RecvTimeoutError::Timeout) => taped::has_timed_out(),
        Err(RecvTimeoutError::Poisoned) => {
            taped::leave(Event::failed(taped::failure::POISONED));
        }
        Err(_) => taped::leave(Event::failed(taped::failure::CLOSED)),
        // SAFETY: it was listed on the slow path, and only a partner can have completed it.
        Ok(_) => taped::has_waited(unsafe { recv.order() }),
    }
    Poll::Ready(outcome)
}

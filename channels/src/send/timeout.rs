//! A send that gives up at a deadline.

use super::operation::{Phase, SendOp};
use crate::error::SendTimeoutError;
use crate::taped;
use luna_platform::current;
use luna_platform::events;
use luna_platform::tape::Event;
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
        if current::is_taped() {
            return poll_taped(send, sleep, cx);
        }
        if let Poll::Ready(sent) = send.as_mut().poll(cx) {
            return Poll::Ready(sent.map_err(SendTimeoutError::from));
        }
        // One that has communicated lets others run, and is done then, whatever the time is.
        if send.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        match events::beside(|| sleep.poll(cx)) {
            Poll::Ready(()) => Poll::Ready(send.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}

/// As a process' tape says: see the receive's.
#[cold]
fn poll_taped<T>(
    mut send: Pin<&mut SendOp<'_, T>>,
    sleep: Pin<&mut Sleep>,
    cx: &mut Context<'_>,
) -> Poll<Result<(), SendTimeoutError<T>>> {
    if send.is_new() && std::task::ready!(taped::enter_timed(cx)).is_err() {
        return Poll::Ready(send.give_up());
    }
    let polled = send.as_mut().poll(cx);
    if polled.is_ready() {
        return polled.map_err(SendTimeoutError::from);
    }
    if !send.is_listed() || taped::is_replayed() || events::beside(|| sleep.poll(cx)).is_pending() {
        return Poll::Pending;
    }
    let outcome = send.as_mut().give_up();
    match &outcome {
        Err(SendTimeoutError::Timeout(_)) => taped::has_timed_out(),
        Err(SendTimeoutError::Poisoned(_)) => {
            taped::leave(Event::failed(taped::failure::POISONED));
        }
        Err(_) => taped::leave(Event::failed(taped::failure::CLOSED)),
        // SAFETY: it was listed in the general way, and nobody but a partner can have completed it.
        Ok(_) => taped::has_waited(unsafe { send.order() }),
    }
    Poll::Ready(outcome)
}

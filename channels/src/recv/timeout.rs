//! A receive that gives up at a deadline.

use super::operation::{Phase, RecvOp};
use crate::error::RecvTimeoutError;
use crate::taped;
use luna_platform::current;
use luna_platform::tape::{Event, Turn, What};
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
        // A replayed one gives up when the recorded one did, whatever the time is: it is let in here, and not by what it waits for.
        if recv.phase == Phase::New
            && let Some(entered) = current::tape(|tape| tape.enter(cx))
        {
            match entered {
                Poll::Pending => return Poll::Pending,
                Poll::Ready(Turn::Given(Event {
                    what: What::TimedOut,
                    ..
                })) => {
                    current::tape(|tape| tape.leave(Event::new(What::TimedOut, 0, 0)));
                    return Poll::Ready(recv.give_up());
                }
                Poll::Ready(_) => {}
            }
        }
        if let Poll::Ready(received) = recv.as_mut().poll(cx) {
            return Poll::Ready(received.map_err(RecvTimeoutError::from));
        }
        // One that has communicated lets others run, and is done then, whatever the time is.
        if recv.phase == Phase::GaveWay {
            return Poll::Pending;
        }
        if taped::is_replayed() {
            return Poll::Pending;
        }
        match sleep.poll(cx) {
            Poll::Ready(()) if current::is_taped() => {
                let outcome = recv.as_mut().give_up();
                let event = match &outcome {
                    Err(RecvTimeoutError::Timeout) => Event::new(What::TimedOut, 0, 0),
                    Err(RecvTimeoutError::Poisoned) => Event::failed(taped::failure::POISONED),
                    Err(_) => Event::failed(taped::failure::CLOSED),
                    // SAFETY: nobody but a partner of a listed one can have completed it.
                    Ok(_) => Event::done(unsafe { recv.order() }),
                };
                current::tape(|tape| tape.leave(event));
                Poll::Ready(outcome)
            }
            Poll::Ready(()) => Poll::Ready(recv.give_up()),
            Poll::Pending => Poll::Pending,
        }
    }
}

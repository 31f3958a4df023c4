//! Blocks as processes, between channels.

mod agreement;
mod alarms;
mod chain;
mod dead_man;
mod front;

pub use agreement::AgreementProcess;
pub use chain::{ChainProcess, Signal};
pub use dead_man::DeadManProcess;

use alarms::Alarms;
use luna::safety::SafeStateEntered;
use luna::{Instant, SendError, SendTimeoutError, Sender};
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::task::Poll;
use std::time::Duration;

/// The time between steps.
#[derive(Debug, Default)]
struct Steps {
    last: Option<Instant>,
}

impl Steps {
    /// From the step before to the one at `now`; zero for the first.
    fn elapsed(&mut self, now: Instant) -> Duration {
        self.last
            .replace(now)
            .map_or(Duration::ZERO, |last| now - last)
    }
}

/// Awaits what ends when the safe state is entered, or never.
type Entered<'a> = Option<Pin<&'a mut SafeStateEntered>>;

/// Awaits `event`, which must be cancel-safe. Returns none if the safe state is entered before. It
/// polls `entered` once each time it waits.
async fn unless<F: Future>(event: F, mut entered: Entered<'_>) -> Option<F::Output> {
    let mut event = pin!(event);
    poll_fn(|cx| {
        if let Poll::Ready(output) = event.as_mut().poll(cx) {
            return Poll::Ready(Some(output));
        }
        match &mut entered {
            // A replay log can order alternatives and single operations only.
            Some(entered) if !luna::replay::is_recorded() => {
                entered.as_mut().poll(cx).map(|()| None)
            }
            _ => Poll::Pending,
        }
    })
    .await
}

/// Puts `value` out, and returns whether a reader took it; a reader that is gone needs no
/// protection. If the safe state is entered before that, `value` is withdrawn and replaced by the
/// result of `neutral`: still one value. If `value` is taken at once it costs a send, and one poll
/// of `entered` each time it waits.
async fn put_out<T: Send>(
    output: &Sender<T>,
    value: T,
    entered: Entered<'_>,
    alarms: &mut Alarms,
    neutral: impl FnOnce() -> T,
) -> luna::Result<bool> {
    let Some(entered) = entered else {
        return taken(output.send(value).await);
    };
    match output.send_unless(value, entered).await {
        Ok(()) => Ok(true),
        Err(SendTimeoutError::Timeout(_)) => {
            alarms.note_safe_state();
            taken(output.send(neutral()).await)
        }
        Err(error) if error.is_closed() => Ok(false),
        Err(error) => Err(error.into()),
    }
}

fn taken<T>(sent: Result<(), SendError<T>>) -> luna::Result<bool> {
    match sent {
        Ok(()) => Ok(true),
        Err(error) if error.is_closed() => Ok(false),
        Err(error) => Err(error.into()),
    }
}

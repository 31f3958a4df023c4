//! Blocks as processes, between channels.

mod agreement;
mod alarms;
mod chain;
mod dead_man;

pub use agreement::AgreementProcess;
pub use chain::{ChainProcess, Signal};
pub use dead_man::DeadManProcess;

use luna::{Instant, Sender};
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

/// Puts `value` out; whether somebody took it: who is gone needs no protection.
async fn put_out<T: Send>(output: &Sender<T>, value: T) -> luna::Result<bool> {
    match output.send(value).await {
        Ok(()) => Ok(true),
        Err(error) if error.is_closed() => Ok(false),
        Err(error) => Err(error.into()),
    }
}

//! Blocks as processes, between channels.

mod agreement;
mod alarms;
mod chain;
mod dead_man;

pub use agreement::AgreementProcess;
pub use chain::{ChainProcess, Signal};
pub use dead_man::DeadManProcess;

use luna::Instant;
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

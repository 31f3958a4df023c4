//! Files that the start opens: one that does not answer, such as a FIFO without a partner or a file
//! of a dead network file system, must not keep a signal from ending the start.

use crate::error::{Error, Result, SetupError};
use crate::safety::Emergency;
use luna_machine::signals;
use luna_platform::clock::Instant;
use luna_platform::thread::{self, Attributes, Policy, SpawnError};
use std::convert::Infallible;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::time::Duration;

/// How long a file has to answer once there is an emergency: one that is there answers by then, and
/// the start goes on as it would without it.
const PATIENCE: Duration = Duration::from_millis(50);

/// The pauses of the thread that waits: at first, and at most.
const SHORTEST_PAUSE: Duration = Duration::from_micros(20);
const LONGEST_PAUSE: Duration = Duration::from_millis(5);

/// Opens files on threads of their own, and waits for them until there is an emergency.
pub(crate) struct Opening(Arc<Emergency>);

impl Opening {
    pub(super) fn new(emergency: &Arc<Emergency>) -> Self {
        Self(emergency.clone())
    }

    /// Waits for `open`, which does `what`: "read the parameters `p.toml`". In an emergency that it
    /// does not answer, its thread is detached. What it gives later is dropped there.
    ///
    /// # Errors
    ///
    /// [`SetupError::StartInterrupted`], or no thread can be made.
    ///
    /// # Panics
    ///
    /// If `open` does.
    pub(crate) fn wait_for<T: Send + 'static>(
        &self,
        what: String,
        open: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T> {
        // It has no real-time policy and no core of its own, nor do threads that `open` makes.
        let thread = thread::spawn(
            Attributes::framework("luna-opening", Policy::Other),
            |_| {
                signals::refuse_write_signals_here();
                Ok(())
            },
            |()| open(),
        )
        .map_err(|error: SpawnError<Infallible>| SetupError::Thread {
            message: error.to_string(),
        })?;
        let mut pause = SHORTEST_PAUSE;
        let mut patient_until = None;
        // There is no event for both, so it polls.
        while !thread.is_finished() {
            if self.0.has_begun() {
                let until = *patient_until.get_or_insert_with(|| Instant::now_real() + PATIENCE);
                if Instant::now_real() >= until {
                    return Err(self.interrupted(what));
                }
            }
            std::thread::sleep(pause);
            pause = (pause * 2).min(LONGEST_PAUSE);
        }
        Ok(thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
    }

    fn interrupted(&self, what: String) -> Error {
        let cause = self
            .0
            .cause()
            .map_or_else(String::new, |(_, cause)| cause.to_string());
        SetupError::StartInterrupted { what, cause }.into()
    }
}

//! How long a thread ran processes, as the kernel counts it.

use luna_platform::usage;
use std::sync::OnceLock;
use std::time::Duration;

/// The processor time of one thread, known once it is over.
#[derive(Debug, Default)]
pub(crate) struct Counted(OnceLock<Duration>);

impl Counted {
    /// Runs `run` on this thread and counts that alone. Two readings, before and after it: off the
    /// real-time path.
    pub(crate) fn count(&self, run: impl FnOnce()) {
        let before = usage::processor_time();
        run();
        if let Some((before, after)) = before.zip(usage::processor_time()) {
            let _ = self.0.set(after.saturating_sub(before));
        }
    }

    /// What was counted, when that is over.
    pub(crate) fn get(&self) -> Option<Duration> {
        self.0.get().copied()
    }
}

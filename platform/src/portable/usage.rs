//! The standard library does not report resource usage.

use crate::usage::ThreadUsage;
use std::time::Duration;

pub(crate) fn prepare_thread() {}

pub(crate) fn of_current_thread() -> Option<ThreadUsage> {
    None
}

/// The time that this thread has run.
pub fn processor_time() -> Option<Duration> {
    None
}

//! The standard library does not report resource usage.

use crate::usage::ThreadUsage;
use std::time::Duration;

pub(crate) fn prepare_thread() {}

pub(crate) fn of_current_thread() -> Option<ThreadUsage> {
    None
}

pub(crate) fn processor_time() -> Option<Duration> {
    None
}

//! The standard library does not report resource usage.

use crate::usage::ThreadUsage;

pub(crate) fn prepare_thread() {}

pub(crate) fn of_current_thread() -> Option<ThreadUsage> {
    None
}

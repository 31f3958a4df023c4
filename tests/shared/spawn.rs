//! Shared by the test programs of the crates above `luna-rt`: processes that are not refused.

use luna::process::{IntoProcess, ProcessId};
use luna::system::ProcessBuilder;

/// For tests in which no process is refused.
pub(crate) trait SpawnOk {
    /// As [`ProcessBuilder::spawn`]; panics if that fails.
    fn spawn_ok<M>(self, process: impl IntoProcess<M>) -> ProcessId;
}

impl SpawnOk for ProcessBuilder {
    #[track_caller]
    fn spawn_ok<M>(self, process: impl IntoProcess<M>) -> ProcessId {
        self.spawn(process).unwrap()
    }
}

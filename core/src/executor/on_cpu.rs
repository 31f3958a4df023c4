//! The executor without an operating system: on the CPU, in the context of the program.

use super::{ExecutorHandle, Serves, Shared, turns};
use crate::deferred_free;
use crate::process::{Enrolled, ProcessRegistry};
use crate::quiescence::Quiescence;
use alloc::sync::Arc;
use luna_platform::bare;

/// Runs prioritized processes on the CPU: higher levels first, first come first served within a
/// level. With nothing to do it idles in the [port](bare::Port), until an interrupt wakes a process
/// or the earliest deadline comes.
///
/// Processes are spawned before [`run`](Self::run), or by others while it runs. A process that
/// never awaits keeps the CPU; interrupts are served all the same. A panic in a process ends the
/// program.
///
/// ```ignore
/// let executor = Executor::new();
/// executor.spawn(ProcessSpec::new("loop").level(30), || control());
/// executor.spawn(ProcessSpec::new("log"), || log());
/// executor.run();
/// ```
pub struct Executor {
    pub(super) handle: ExecutorHandle,
    enrolled: Option<Enrolled>,
}

impl Executor {
    /// An executor without processes. Allocates.
    ///
    /// # Panics
    ///
    /// In an interrupt.
    pub fn new() -> Executor {
        assert!(
            !bare::is_interrupt(),
            "an executor runs in the context of the program"
        );
        let registry = Arc::new(ProcessRegistry::new());
        let quiescence = Arc::new(Quiescence::new());
        let shared = Shared::new(0, registry, quiescence, Serves::Cpu, None);
        let enrolled = shared.registry.enroll(shared.executor_id, shared.clone());
        Executor {
            handle: ExecutorHandle { shared },
            enrolled: Some(enrolled),
        }
    }

    /// Runs the processes until all have ended, or until [a stop was
    /// requested](ExecutorHandle::request_stop): those that are left are then cancelled. A program
    /// whose processes never end stays here. What an interrupt spawns after the last process has
    /// ended runs too, or is refused: it ends as cancelled.
    ///
    /// # Panics
    ///
    /// Within a process, and in an interrupt.
    pub fn run(mut self) {
        assert!(
            !bare::is_interrupt(),
            "an executor runs in the context of the program"
        );
        let shared = self.handle.shared.clone();
        self.handle.release();
        if let Some(enrolled) = self.enrolled.take() {
            turns::run(shared, enrolled);
        }
        deferred_free::collect();
    }
}

impl Drop for Executor {
    fn drop(&mut self) {
        // One that never ran: its processes end unstarted.
        if self.enrolled.take().is_some() {
            self.handle.shared.refuse_all();
        }
    }
}

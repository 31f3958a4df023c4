//! The priority executor: one OS thread that runs many processes.
//!
//! Before each turn it reads one word ([`inbound`](crate::inbound)). If a bit is set there, it
//! looks, in this order, at its files (if any was ever waited for, once in 64 rounds), at processes
//! to start and the request to stop, at the processes that other threads have woken, and at its
//! deadlines ([`deadlines`](crate::deadlines)). Then it polls the first process of the highest
//! level of its run queue. A process that yields is exchanged with the next one: a round is a chain
//! of such turns. With nothing to do it sleeps until the next deadline.

mod announced;
#[cfg(not(feature = "std"))]
mod on_cpu;
#[cfg(feature = "std")]
mod on_thread;
mod shared;
mod turns;

pub use announced::Announced;
#[cfg(not(feature = "std"))]
pub use on_cpu::Executor;
#[cfg(feature = "std")]
pub use on_thread::Executor;
pub(crate) use shared::{Phase, Serves, Shared};

use crate::process::{ExitValue, ProcessHandle, ProcessSpec, Unbuilt};
use crate::{current, deferred_free};
use alloc::sync::Arc;
use core::future::Future;
use core::sync::atomic::Ordering;

/// Spawns processes on an executor, from anywhere. Cloning it is cheap; it does not keep the
/// executor running.
#[derive(Clone)]
pub struct ExecutorHandle {
    shared: Arc<Shared>,
}

impl ExecutorHandle {
    /// Whether the caller runs on this executor. O(1).
    #[inline]
    pub fn is_here(&self) -> bool {
        current::executor_id() == Some(self.shared.executor_id)
    }

    /// Lets the processes run.
    pub(super) fn release(&self) {
        self.shared.advance(Phase::RELEASED);
    }

    /// Asks the executor to cancel all its processes and end, without waiting for it. From any
    /// thread or interrupt.
    pub fn request_stop(&self) {
        self.shared.advance(Phase::STOPPING);
    }

    /// From now on the thread sleeps as soon as it has nothing to do, regardless of
    /// [`spin_before_sleep`](luna_platform::thread::Attributes::spin_before_sleep): for when
    /// another thread comes to its core. Returns whether that changes anything. Real-time path:
    /// yes; one atomic operation.
    pub fn end_spin(&self) -> bool {
        self.shared.spin.swap(0, Ordering::Relaxed) > 0
    }

    /// Makes a process of the future that `build` returns. `build` runs on the executor's thread,
    /// so the future need not be `Send`: right here, if this is that thread and its processes have
    /// been released.
    ///
    /// On a stopped executor the process ends at once as cancelled. Not for the real-time path: it
    /// allocates, here and on the executor's thread. O(1) apart from `build`, however many
    /// processes there are or have been.
    pub fn spawn<B, F>(&self, spec: ProcessSpec, build: B) -> ProcessHandle
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output = ()> + 'static,
    {
        make_room();
        let (announced, handle) = self.announce(spec, build);
        drop(announced.start());
        handle
    }

    /// A process that counts as living and is not built yet, and its handle. Allocates; runs no
    /// user code. What spawns processes without end calls [`make_room`] before.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use luna_core::{Executor, Exit, ProcessSpec, ProcessState};
    /// use luna_platform::thread::Attributes;
    ///
    /// let executor = Executor::start(Attributes::new("main"))?;
    /// executor.release();
    /// let spec = ProcessSpec::new("late");
    /// let (announced, process) = executor.handle().announce(spec, || async {});
    /// assert_eq!(process.state(), ProcessState::Created);
    /// assert!(announced.start().is_none(), "it was taken");
    /// assert_eq!(process.wait(), Exit::Completed);
    /// # Ok(()) }
    /// ```
    #[inline]
    pub fn announce<B, F>(&self, spec: ProcessSpec, build: B) -> (Announced, ProcessHandle)
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output: ExitValue> + 'static,
    {
        let (process, handle) = Unbuilt::new(self.shared.clone(), spec, build);
        (Announced { process }, ProcessHandle(handle))
    }
}

/// Frees what processes have left, before another one is made, so that those which come and go
/// without end do not fill the memory. It drops values of users, so under no lock that they might
/// take. It does nothing while a body is dropped that has not come to its end: what is dropped then
/// counts as left by that process. Not for the real-time path: O(what was left).
pub fn make_room() {
    if !current::is_abandoned() && !current::dropped_ends_poison() {
        deferred_free::collect();
    }
}

impl Executor {
    /// Spawns processes here, also when this `Executor` is elsewhere, or runs.
    pub fn handle(&self) -> &ExecutorHandle {
        &self.handle
    }

    /// As [`ExecutorHandle::spawn`].
    pub fn spawn<B, F>(&self, spec: ProcessSpec, build: B) -> ProcessHandle
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output = ()> + 'static,
    {
        self.handle.spawn(spec, build)
    }
}

luna_platform::debug_fields!(Executor, |executor| executor_id: executor.handle.shared.executor_id);
luna_platform::debug_fields!(ExecutorHandle, |handle| executor_id: handle.shared.executor_id);

//! The priority executor: one OS thread that runs many processes.
//!
//! Each round it reads one word ([`inbound`](crate::inbound)). If a bit is set there, it looks, in
//! this order, at its files (if any was ever waited for, once in 64 rounds), at processes to start
//! and the request to stop, at the processes that other threads have woken, and at its deadlines
//! ([`deadlines`](crate::deadlines)). Then it polls the first process of the highest level of its
//! run queue. With nothing to do it sleeps until the next deadline.

mod announced;
mod shared;
mod turns;

pub use announced::Announced;
pub(crate) use shared::{Phase, Serves, Shared, give_back};
pub(crate) use turns::turns;

use shared::another;
use turns::run;

use crate::process::{ExitValue, ProcessHandle, ProcessRegistry, ProcessSpec};
use crate::quiescence::Quiescence;
use crate::simulation::{SimulationHandle, is_stage};
use crate::task::Unbuilt;
use alloc::sync::Arc;
use core::cell::Cell;
use core::convert::Infallible;
use core::fmt;
use core::future::Future;
use core::sync::atomic::Ordering;
use core::time::Duration;
use luna_core::{current, deferred_free};
use luna_platform::clock::Instant;
use luna_platform::thread::{self, Attributes, Obtained, SpawnError, Thread};

luna_platform::local! {
    /// See [`has_given_up`].
    static GIVES_UP: Cell<bool> = const { Cell::new(false) };
}

/// Whether the bodies that are dropped on this thread now are dropped because their executor's
/// thread panicked outside of any process: in a waker that is not LUNA's, for example.
#[inline]
pub fn has_given_up() -> bool {
    // Bodies are dropped by a thread that lives, but what they hold may be dropped later.
    GIVES_UP.try_with(Cell::get).unwrap_or(false)
}

/// One OS thread that runs prioritized processes: higher levels first, first come first served
/// within a level.
///
/// It starts held: processes can be spawned and are built on its thread, and run only after
/// [`release`](Self::release). Dropping it stops it. Example: [`ProcessHandle`].
pub struct Executor {
    handle: ExecutorHandle,
    runs: Runs,
}

/// Where an executor runs, as its owner sees it.
enum Runs {
    OnThread(Thread<()>),
    OnStage,
    /// It was stopped, or is left to itself.
    Nowhere,
}

/// Spawns processes on an executor, from anywhere. Cloning it is cheap; it does not keep the
/// executor running.
#[derive(Clone)]
pub struct ExecutorHandle {
    shared: Arc<Shared>,
}

impl Executor {
    /// Starts the thread with its attributes, and returns when it has them.
    ///
    /// # Errors
    ///
    /// What the system refused, if the attributes are strict or cannot be had in any way:
    /// [`SpawnError`] says why and what to do. A deadline policy, which would stop all processes at
    /// once when its budget is used up, is refused here.
    pub fn start(attributes: Attributes) -> Result<Executor, SpawnError<Infallible>> {
        Self::start_counted(attributes, Arc::new(ProcessRegistry::new()))
    }

    /// Like [`start`](Self::start), with its processes counted in `registry`.
    ///
    /// # Errors
    ///
    /// As for `start`.
    pub fn start_counted(
        attributes: Attributes,
        registry: Arc<ProcessRegistry>,
    ) -> Result<Executor, SpawnError<Infallible>> {
        attributes
            .validate_shared()
            .map_err(SpawnError::Attributes)?;
        Self::start_thread(attributes, registry, Serves::Many)
    }

    /// Starts the thread. One that serves one process may have any policy and ends with the
    /// process, which may make blocking calls.
    pub(crate) fn start_thread(
        attributes: Attributes,
        registry: Arc<ProcessRegistry>,
        serves: Serves,
    ) -> Result<Executor, SpawnError<Infallible>> {
        let shared = Shared::new(0, registry, Arc::new(Quiescence::new()), serves, None);
        let own = shared.clone();
        let thread = thread::spawn(
            attributes,
            move |obtained: &Obtained| {
                own.thread_priority
                    .store(obtained.policy.rank(), Ordering::Relaxed);
                own.spin.store(
                    obtained.spin_before_sleep.as_nanos() as u64,
                    Ordering::Relaxed,
                );
                let enrolled = own.registry.enroll(own.executor_id, own.clone());
                Ok((own, enrolled))
            },
            |(shared, enrolled)| run(shared, enrolled),
        )?;
        Ok(Executor {
            handle: ExecutorHandle { shared },
            runs: Runs::OnThread(thread),
        })
    }

    /// Starts one on the thread of a simulation, at once. Of its attributes only the policy counts:
    /// by its priority the simulation's executors come in their order. Nothing is asked of the
    /// operating system.
    pub fn start_simulated(simulation: &SimulationHandle, attributes: &Attributes) -> Executor {
        let stage = &simulation.0;
        let shared = Shared::new(
            attributes.asked_policy().rank(),
            stage.registry.clone(),
            stage.quiescence.clone(),
            Serves::Many,
            Some((stage.clone(), attributes.name())),
        );
        if !stage.admit(shared.clone()) {
            shared.refuse_all();
        }
        Executor {
            handle: ExecutorHandle { shared },
            runs: Runs::OnStage,
        }
    }

    /// Spawns processes here, also when this `Executor` is elsewhere.
    pub fn handle(&self) -> &ExecutorHandle {
        &self.handle
    }

    /// What the thread got of the requested attributes; `None` on a simulation's thread.
    pub fn obtained(&self) -> Option<&Obtained> {
        match &self.runs {
            Runs::OnThread(thread) => Some(thread.obtained()),
            Runs::OnStage | Runs::Nowhere => None,
        }
    }

    /// How long the thread has run from the release of its processes until it was asked to stop,
    /// once it has stopped; `None` where the system does not report it, and on a simulation's
    /// thread.
    pub fn processor_time(&self) -> Option<Duration> {
        self.handle.shared.processor_time.get().copied()
    }

    /// As [`ExecutorHandle::spawn`].
    pub fn spawn<B, F>(&self, spec: ProcessSpec, build: B) -> ProcessHandle
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output = ()> + 'static,
    {
        self.handle.spawn(spec, build)
    }

    /// Waits until all processes spawned so far are built. Not on the executor's own thread.
    pub fn settle(&self) {
        let shared = &self.handle.shared;
        let announced = shared.arrivals.lock().announced;
        // Of a held one no attention was asked until now.
        shared.inbound.ask_attention();
        loop {
            let settled = shared.settled.word().load(Ordering::Acquire);
            // Both count up and wrap, so compare their distance.
            if (announced.wrapping_sub(settled) as i32) <= 0 {
                return;
            }
            shared.settled.wait(settled, Instant::NEVER);
        }
    }

    /// Lets the processes run.
    pub fn release(&self) {
        self.handle.shared.advance(Phase::RELEASED);
    }

    /// Asks the thread to cancel all its processes and end, without waiting for it.
    pub fn request_stop(&self) {
        self.handle.shared.advance(Phase::STOPPING);
    }

    /// Whether the thread has ended.
    pub fn has_stopped(&self) -> bool {
        match &self.runs {
            Runs::OnThread(thread) => thread.is_finished(),
            Runs::OnStage => self.handle.shared.is_stopped(),
            Runs::Nowhere => true,
        }
    }

    /// Cancels all processes, waits until they have ended, and ends the thread. A process that
    /// never awaits keeps it waiting.
    pub fn stop(mut self) {
        self.join();
    }

    /// Detaches the thread: for one with a process that hangs.
    pub fn abandon(mut self) {
        self.runs = Runs::Nowhere;
    }

    fn join(&mut self) {
        match core::mem::replace(&mut self.runs, Runs::Nowhere) {
            Runs::OnThread(thread) => {
                self.request_stop();
                // The run loop catches panics of processes; one of its own was reported by the
                // panic hook.
                let _ = thread.join();
            }
            Runs::OnStage => {
                self.request_stop();
                let shared = &self.handle.shared;
                // A process of the simulation that waited here would wait for itself.
                if shared.stage.as_ref().is_some_and(|stage| is_stage(stage)) {
                    return;
                }
                while !shared.is_stopped() {
                    shared.stopped.wait(0, Instant::NEVER);
                }
            }
            Runs::Nowhere => return,
        }
        deferred_free::collect();
    }
}

impl Drop for Executor {
    fn drop(&mut self) {
        self.join();
    }
}

impl ExecutorHandle {
    /// Whether the caller runs on this executor. O(1).
    #[inline]
    pub fn is_here(&self) -> bool {
        current::executor_id() == Some(self.shared.executor_id)
    }

    /// From now on the thread sleeps as soon as it has nothing to do, regardless of
    /// [`Attributes::spin_before_sleep`]: for when another thread comes to its core. Returns
    /// whether that changes anything. Real-time path: yes; one atomic operation.
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
        let (announced, handle) = self.announce(spec, build);
        drop(announced.start());
        handle
    }

    /// A process that counts as living and is not built yet, and its handle. Allocates; runs no
    /// user code.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use luna_executors::{Executor, Exit, ProcessSpec, ProcessState};
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
    pub fn announce<B, F>(&self, spec: ProcessSpec, build: B) -> (Announced, ProcessHandle)
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output: ExitValue> + 'static,
    {
        // Processes that come and go without end do not fill the memory.
        deferred_free::collect();
        let (process, record) = Unbuilt::new(another(&self.shared), spec, build);
        let announced = Announced {
            process,
            decided: None,
        };
        (announced, ProcessHandle(record))
    }
}

impl fmt::Debug for Executor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Executor")
            .field(
                "thread",
                &match &self.runs {
                    Runs::OnThread(thread) => Some(thread.name()),
                    Runs::OnStage | Runs::Nowhere => None,
                },
            )
            .finish_non_exhaustive()
    }
}

impl fmt::Debug for ExecutorHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ExecutorHandle")
            .field("executor_id", &self.shared.executor_id)
            .finish_non_exhaustive()
    }
}

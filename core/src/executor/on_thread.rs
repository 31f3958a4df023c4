//! The executor on a thread of its own, or on that of a simulation.

use super::{ExecutorHandle, Serves, Shared, turns};
use crate::deferred_free;
use crate::process::ProcessRegistry;
use crate::quiescence::Quiescence;
use crate::simulation::{SimulationHandle, is_stage};
use alloc::sync::Arc;
use core::convert::Infallible;
use core::sync::atomic::Ordering;
use core::time::Duration;
use luna_platform::clock::Instant;
use luna_platform::thread::{self, Attributes, Obtained, SpawnError, Thread};

/// One OS thread that runs prioritized processes: higher levels first, first come first served
/// within a level.
///
/// It starts held: processes can be spawned and are built on its thread, and run only after
/// [`release`](Self::release). Dropping it stops it. Example:
/// [`ProcessHandle`](crate::ProcessHandle).
pub struct Executor {
    pub(super) handle: ExecutorHandle,
    runs: Runs,
}

/// Where an executor runs, as its owner sees it.
enum Runs {
    OnThread(Thread<()>),
    OnStage,
    /// It was stopped, or is left to itself.
    Nowhere,
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
            |(shared, enrolled)| turns::run(shared, enrolled),
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
        self.handle.release();
    }

    /// Asks the thread to cancel all its processes and end, without waiting for it.
    pub fn request_stop(&self) {
        self.handle.request_stop();
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

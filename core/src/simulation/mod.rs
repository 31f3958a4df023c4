//! Executors on a clock of their own: one thread runs all their processes in a fixed order, and
//! time moves only when none can run.
//!
//! ```text
//!   take in new executors and processes
//!     |
//!     v
//!   an executor with turns left? ---yes--> serve the first: expire its deadlines, poll its
//!     | no                                 processes until it rests, its turns are up, or a
//!     |                                    more urgent executor is woken
//!     v
//!   at rest: the first of these that applies
//!     a request to stop, the release, the reaper    wait for it
//!     blocking calls under way                      wait for the oldest
//!     an emergency                                  time stands for good
//!     a deadline (driven: the driver permits it)    time jumps there, all get their turns again
//!     nothing                                       sleep until a wake from outside
//! ```
//!
//! **Why every run is the same.** One thread decides all, and nothing it decides by depends on how
//! long anything took: not the machine's clock, not addresses, not the order in which threads
//! happen to run. Other threads come in at rest alone: results of blocking calls in the order of
//! their beginnings, the handling of ends before any other process runs, requests to stop when no
//! process can run. What is left are threads and files outside of the system, which wake processes
//! at any time.
//!
//! `Play::rest` in `stage` is the one place where the thread waits for a deadline, real or virtual:
//! a recorder that replays, or a thread that times others, begins there.

mod calls;
mod drive;
mod member;
mod stage;

pub use drive::{ClockDriver, DriveError, DrivenClock};
pub(crate) use stage::{Stage, is_stage};

use crate::current::ProcessId;
use crate::process::ProcessRegistry;
use luna_platform::thread::{Attributes, SpawnError, Thread};
use std::convert::Infallible;
use std::sync::Arc;

/// How the time of a [`Simulation`] moves.
#[derive(Debug)]
#[non_exhaustive]
pub enum Pace {
    /// It jumps to the next deadline when no process can run.
    Jumping,
    /// As its driver commands.
    Driven(DrivenClock),
}

/// Why a simulation does not go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Standstill {
    /// Its driver is gone.
    Undriven,
    /// The limit of turns without any time passing was reached, the last one by this process.
    Livelock {
        /// The process that had the last turn.
        process: ProcessId,
        /// How many there were.
        turns: u64,
    },
}

/// One thread that runs all executors which are [started](crate::Executor::start_simulated) on it,
/// on a virtual clock, in a fixed order: the same in each run.
///
/// The executor with the thread that would have the highest priority comes first, of equals the one
/// that was started first; each has a bounded number of turns at a time, so one with processes that
/// never wait does not starve the others. Dropping it cancels all processes, and waits for their
/// end.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_core::{Executor, ProcessRegistry, Pace, ProcessSpec, Simulation};
/// use luna_core::timer_queue::Sleep;
/// use luna_platform::{clock::Instant, thread::Attributes};
/// use std::{sync::Arc, time::Duration};
///
/// let simulation = Simulation::start(Pace::Jumping, Arc::new(ProcessRegistry::new()), u64::MAX)?;
/// let executor = Executor::start_simulated(&simulation.handle(), &Attributes::new("main"));
/// let process = executor.spawn(ProcessSpec::new("patient"), || async {
///     Sleep::until(Instant::now() + Duration::from_secs(3600)).await;
/// });
/// executor.release();
/// let began = simulation.handle().clock().now();
/// simulation.release();
/// process.wait(); // takes a moment
/// assert_eq!(simulation.handle().clock().now() - began, Duration::from_secs(3600));
/// # Ok(()) }
/// ```
pub struct Simulation {
    stage: Arc<Stage>,
    thread: Option<Thread<()>>,
}

/// A handle that starts executors on a simulation. Cloning it is cheap; it does not keep the
/// simulation running.
#[derive(Clone)]
pub struct SimulationHandle(pub(crate) Arc<Stage>);

impl Simulation {
    /// Starts the thread. No process runs before [`release`](Self::release). After `most_turns`
    /// polls at one instant it comes to a [`Standstill`].
    ///
    /// # Errors
    ///
    /// The system has no thread to give.
    pub fn start(
        pace: Pace,
        registry: Arc<ProcessRegistry>,
        most_turns: u64,
    ) -> Result<Simulation, SpawnError<Infallible>> {
        let stage = Stage::new(pace, registry, most_turns);
        let own = stage.clone();
        let thread = luna_platform::thread::spawn(
            Attributes::new("luna-virtual"),
            |_| Ok::<(), Infallible>(()),
            move |()| stage::run(&own),
        )?;
        Ok(Simulation {
            stage,
            thread: Some(thread),
        })
    }

    /// A handle that starts executors on it.
    pub fn handle(&self) -> SimulationHandle {
        SimulationHandle(self.stage.clone())
    }

    /// Lets the processes of those executors run that have been released.
    pub fn release(&self) {
        self.stage.release();
    }

    /// Asks the thread to cancel all processes and end, without waiting for it: as soon as no
    /// process can run.
    pub fn request_stop(&self) {
        self.stage.request_stop();
    }

    /// Detaches the thread: for one with a process that hangs.
    pub fn abandon(mut self) {
        self.thread = None;
    }
}

impl Drop for Simulation {
    fn drop(&mut self) {
        self.stage.request_stop();
        if let Some(thread) = self.thread.take() {
            // It catches the panics of processes; one of its own was reported by the panic hook.
            let _ = thread.join();
        }
    }
}

luna_platform::debug_fields!(Simulation, |simulation| clock: simulation.stage.clock());

luna_platform::debug_fields!(SimulationHandle, |handle| clock: handle.clock());

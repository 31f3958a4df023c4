//! The emergency manager: threads above all others that wait for an emergency and then bring the
//! machine to safety.

mod functions;
mod panics;
mod workers;

pub(crate) use functions::LIMIT;
pub use functions::{FunctionOutcome, FunctionReport};
pub(crate) use workers::EmergencyThread;

use super::entered::Waiting;
use super::report::SafetyReport;
use super::state::{Cause, Degree, Journal};
use crate::error::{Error, Result};
use crate::system::Plan;
use functions::{Functions, Run};
use luna_core::SimulationHandle;
use luna_core::current::ProcessId;
use luna_core::path;
use luna_machine::{forked, signals};
use luna_platform::clock::{Clock, Instant};
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock, Weak};
use std::time::Duration;
use workers::EmergencyWorkers;

/// How long, at most, a triggering process waits until the functions begin, so that no other
/// process of its core runs before.
const LOOKS_ON: Duration = Duration::from_millis(1);

/// The exit status of a program that panics.
const PANICKED: i32 = 101;

/// What the triggers share with the workers. It lives from when the system is made.
#[derive(Debug)]
pub(crate) struct Emergency {
    pub(crate) at_emergency: Functions,
    pub(crate) at_safe_state: Functions,
    pub(crate) journal: Journal,
    /// The tasks that wait for the safe state.
    pub(super) waiting: Waiting,
    workers: EmergencyWorkers,
    /// The system has ended: the workers end, after the functions have run if there is an
    /// emergency.
    is_to_end: AtomicBool,
    /// The simulation that the processes run on, if time is virtual.
    simulation: OnceLock<SimulationHandle>,
    pub(crate) plan: Weak<Plan>,
}

thread_local! {
    /// The emergency of the system that runs processes on this thread.
    pub(super) static OF_THREAD: RefCell<Option<Arc<Emergency>>> = const { RefCell::new(None) };
}

/// Raises an emergency with `cause`, and returns it for the process to end with:
/// `return Err(luna::emergency(cause))`.
///
/// For a failure that must end the run but is no bug to panic over: a sensor that is dead, a
/// simulated plant that cannot be stepped. The functions of
/// [`on_emergency`](crate::System::on_emergency) run at once, on the thread of the highest
/// priority. Then all processes are cancelled, and [`System::run`](crate::System::run) returns the
/// cause with this process' name, whatever errors the others end with. The report has
/// [`End::Emergency`](crate::End::Emergency). If there was an emergency before, its cause stays. It
/// also stays for errors of a process that is dropped while it is cancelled, after a livelock or
/// because the driver of its clock is gone.
///
/// Outside of a system (in [`luna::run`](crate::run), on a plain thread, in a blocking call) there
/// is no emergency to raise, and this only returns the cause: a driver's thread calls
/// `raise` of [`System::safety`](crate::System::safety). Real-time path: yes; O(1), at most four
/// system calls, and a clone of the cause. On a real-time thread with a core of its own the
/// functions preempt that core. On the machine's clock this call waits until the first function
/// begins, at most for a millisecond, so that no other process of its thread, and none of lower
/// priority on its core, runs before.
///
/// ```
/// use luna::prelude::*;
/// use luna::End;
///
/// let mut system = System::new("arm");
/// system.on_emergency("brakes", || { /* engage them */ });
/// let main = system.executor("main").build()?;
/// main.process("encoder").spawn(async { Err(luna::emergency(luna::Error::other("no index pulse"))) })?;
/// main.process("servo").spawn(std::future::pending::<luna::Result<()>>())?;
/// assert_eq!(system.run().unwrap_err().to_string(), "process `encoder`: no index pulse");
/// assert_eq!(system.report().unwrap().end, End::Emergency);
/// # Ok::<(), luna::Error>(())
/// ```
#[must_use = "the process is to end with it: return it as its error"]
pub fn emergency(cause: Error) -> Error {
    if luna_core::current::process(|process| process.is_some())
        && let Some(emergency) = OF_THREAD.with_borrow(Clone::clone)
    {
        emergency.trigger(Cause::Raised(cause.clone()));
    }
    cause
}

impl Emergency {
    pub(crate) fn new(plan: Weak<Plan>) -> Arc<Self> {
        Arc::new(Self {
            at_emergency: Functions::new(),
            at_safe_state: Functions::new(),
            journal: Journal::new(),
            waiting: Waiting::new(),
            workers: EmergencyWorkers::default(),
            is_to_end: AtomicBool::new(false),
            simulation: OnceLock::new(),
            plan,
        })
    }

    /// Registers a function behind the others. Returns its id.
    pub(crate) fn add_function(&self, name: &str, limit: Duration, run: Run) -> Result<u64> {
        let id = self.at_emergency.add(name, limit, run)?;
        self.bound_crashes();
        Ok(id)
    }

    /// Withdraws a function that has not begun. Returns whether it did.
    pub(crate) fn withdraw_function(&self, id: u64) -> bool {
        let is_withdrawn = self.at_emergency.withdraw(id);
        self.bound_crashes();
        is_withdrawn
    }

    fn bound_crashes(&self) {
        self.at_emergency
            .report_limits(|limits| self.workers.bound_crashes(limits));
    }
    /// Sets the simulation that the processes run on, before they run.
    pub(crate) fn simulate(&self, simulation: SimulationHandle) {
        // A system is started once.
        let _ = self.simulation.set(simulation);
        if self.has_begun() {
            self.stop_time();
        }
    }

    /// Makes this the emergency that processes of the calling thread raise.
    pub(crate) fn enter_thread(self: &Arc<Self>) {
        OF_THREAD.set(Some(self.clone()));
    }

    /// Wakes the workers; the first trigger counts. From any thread, on the real-time path too:
    /// O(1), at most four system calls, and the wait until the functions begin that [`emergency`]
    /// describes.
    pub(crate) fn trigger(&self, cause: Cause) {
        self.begin(cause);
        let is_called = self.workers.call_here();
        if !is_called {
            signals::announce_event();
        }
        self.look_on();
        if is_called && self.at_emergency.wait_for_the_first() {
            // It does not get its core: this thread has been moved to another, or the kernel holds
            // back the core's real-time threads.
            signals::announce_event();
        }
    }

    /// As [`trigger`](Self::trigger), for a panic that leaves a process' body or a callback;
    /// nothing if the panic hook has done so before. In the child of a bare `fork` it ends that
    /// child: the thread would go on with the parent's processes.
    pub(crate) fn trigger_by_panic(&self) {
        if forked::is_child() {
            forked::end_child(PANICKED);
        }
        if !panics::take_raised() {
            self.trigger(Cause::Panic);
        }
    }

    /// Waits until the functions have run, but no longer than `at_most`.
    fn wait_for_functions(&self, at_most: Duration) {
        let until = Instant::now_real() + at_most;
        let is_over = || !self.has_begun() || self.is_safe() || !self.workers.serves();
        path::off_path(|| {
            while !is_over() && Instant::now_real() < until {
                std::thread::sleep(workers::LOOKS_EVERY);
            }
        });
    }

    fn begin(&self, cause: Cause) {
        self.stop_time();
        // A trigger after the end has no effect.
        let begins = || self.at_emergency.begin(Instant::now_real()) || self.has_begun();
        self.journal.note(Degree::Emergency, cause, begins);
    }

    /// Begins for a crash. Without any lock, since the thread that has crashed may hold it; what
    /// there is to note is [noted later](Self::note_crash).
    pub(super) fn begin_for_crash(&self) {
        self.stop_time();
        if self.at_emergency.begin(Instant::now_real()) || self.has_begun() {
            self.journal.worsen(Degree::Emergency);
        }
    }

    /// To be called when a crash waits for nothing any more.
    fn note_crash(&self, signal: i32) {
        self.journal
            .note(Degree::Emergency, Cause::Signal(signal), || true);
    }

    fn stop_time(&self) {
        if let Some(simulation) = self.simulation.get() {
            // How far it would go until the functions have run is another in each run.
            simulation.stop_time();
        }
    }

    /// Keeps this thread's core until the first function begins, which another core's wake-up may
    /// delay.
    fn look_on(&self) {
        if self.simulation.get().is_some() || !self.workers.serves() {
            return;
        }
        // On a core that runs a thread of lower priority, the workers have preempted it before this
        // is reached; there is a time limit all the same.
        let until = Instant::now_real() + LOOKS_ON;
        while self.at_emergency.wait_for_the_first() && Instant::now_real() < until {
            std::hint::spin_loop();
        }
    }

    /// See [`Safety::enter_safe_state`](crate::safety::Safety::enter_safe_state).
    pub(crate) fn enter_safe_state(&self, cause: Cause) {
        let (mut is_entered, mut has_functions) = (false, false);
        self.journal.note(Degree::SafeState, cause, || {
            is_entered = true;
            has_functions = self.at_safe_state.begin(Instant::now_real())
                && !self.at_safe_state.failover.is_done();
            true
        });
        if has_functions {
            signals::announce_event();
        }
        if is_entered {
            self.waiting.wake_all();
        }
    }

    /// What it was raised with, and by which process if one did.
    pub(crate) fn cause(&self) -> Option<(Option<ProcessId>, Cause)> {
        let event = self.journal.emergency()?;
        Some((event.process, event.cause))
    }

    pub(crate) fn name_of(&self, process: ProcessId) -> Option<String> {
        let plan = self.plan.upgrade()?;
        plan.members().started.name(process).map(str::to_owned)
    }

    /// The system's clock.
    fn clock(&self) -> Clock {
        self.simulation
            .get()
            .map_or(Clock::REAL, SimulationHandle::clock)
    }

    /// Whether there is an emergency: the functions have run, or will.
    pub(crate) fn has_begun(&self) -> bool {
        self.at_emergency.failover.has_begun()
    }

    /// Whether the functions have run.
    pub(crate) fn is_safe(&self) -> bool {
        self.at_emergency.failover.is_done()
    }

    /// Makes the report at the end. Drops the functions.
    pub(crate) fn conclude(self: &Arc<Self>) -> SafetyReport {
        let (functions, at_emergency) = self.at_emergency.conclude();
        let (safe_state_functions, at_safe_state) = self.at_safe_state.conclude();
        for function in at_emergency.into_iter().chain(at_safe_state) {
            // What it holds is the user's: a panic in its drop, which the panic hook reports, must
            // not end the run half-way.
            if let Err(payload) = catch_unwind(AssertUnwindSafe(|| drop(function))) {
                std::mem::forget(payload);
            }
        }
        SafetyReport {
            state: super::Safety::new(self.clone()).state(),
            functions,
            safe_state_functions,
        }
    }

    fn end(&self) {
        self.is_to_end.store(true, Ordering::Release);
        signals::announce_event();
    }

    /// Whether the workers may end: there is no emergency and none will begin, or its functions
    /// have run; and no others do.
    fn may_end(&self) -> bool {
        let failover = &self.at_emergency.failover;
        self.is_to_end.load(Ordering::Acquire)
            && !self.at_safe_state.failover.is_under_way()
            && (failover.is_done() || failover.close())
            // No worker would run what begins from now on.
            && self.at_safe_state.failover.retire()
    }
}

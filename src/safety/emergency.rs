//! The emergency manager: a thread above all others that waits for an emergency and then brings the machine to safety.

use crate::error::{Error, Result};
use luna_executors::{Living, SimulationHandle};
use luna_platform::clock::{Clock, Instant};
use luna_platform::current::{self, ProcessId};
use luna_platform::lock::PiLock;
use luna_platform::shortfall::Shortfall;
use luna_platform::signals::{self, Signal, SignalError, SignalWatch};
use luna_platform::thread::{self, Attributes, EMERGENCY_PRIORITY, Policy, Thread};
use std::cell::RefCell;
use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

const NORMAL: u8 = 0;
/// Triggered by a process, or a signal was seen: the functions run.
const TRIGGERED: u8 = 1;
/// The functions have run.
const SAFE: u8 = 2;
/// The system has ended without an emergency: none can begin any more.
const ENDED: u8 = 3;

/// What the triggers share with the thread.
#[derive(Debug)]
pub(crate) struct Emergency {
    /// Only rises.
    phase: AtomicU8,
    /// The system has ended: the thread is to end, once the functions have run if there is an emergency.
    is_to_end: AtomicBool,
    /// Who raised it by [`emergency`], and with what, if that was the first trigger.
    cause: PiLock<Option<(ProcessId, Error)>>,
    /// Where the processes run, if time is virtual there.
    simulation: Option<SimulationHandle>,
}

thread_local! {
    /// Of the system whose processes run on this thread.
    static OF_THREAD: RefCell<Option<Arc<Emergency>>> = const { RefCell::new(None) };
}

/// Raises an emergency with `cause`, and gives it back for the process to end with: `return Err(luna::emergency(cause))`.
///
/// For what must not go on, but is no bug to panic over: a sensor that is dead, a simulated plant that cannot be stepped. The functions of
/// [`on_emergency`](crate::System::on_emergency) run at once, on the thread of the highest priority; then all processes are cancelled, and
/// [`System::run`](crate::System::run) returns the cause with this process' name, whatever the others return on their way out. The report says
/// [`End::Emergency`](crate::End::Emergency). If there was an emergency before, its own cause stays. So it is too for what a process drops while it is cancelled, after
/// a livelock or because the driver of its clock is gone.
///
/// Outside of a system (in [`luna::run`](crate::run), on a plain thread, in a blocking call) there is nobody to raise it to, and this only gives the cause back.
/// Real-time path: yes; O(1), one system call, and a clone of the cause.
///
/// ```
/// use luna::{End, prelude::*};
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
    if let Some(process) = current::process(|process| process.map(|process| process.id()))
        && let Some(emergency) = OF_THREAD.with(|of_thread| of_thread.borrow().clone())
    {
        emergency.raise(process, cause.clone());
    }
    cause
}

impl Emergency {
    pub(crate) fn new(simulation: Option<SimulationHandle>) -> Arc<Self> {
        Arc::new(Self {
            phase: AtomicU8::new(NORMAL),
            is_to_end: AtomicBool::new(false),
            cause: PiLock::new(None),
            simulation,
        })
    }

    /// Makes this the emergency that processes of the calling thread raise.
    pub(crate) fn enter_thread(self: &Arc<Self>) {
        OF_THREAD.with(|of_thread| {
            let mut of_thread = of_thread.borrow_mut();
            if !of_thread
                .as_ref()
                .is_some_and(|there| Arc::ptr_eq(there, self))
            {
                *of_thread = Some(self.clone());
            }
        });
    }

    fn raise(&self, process: ProcessId, error: Error) {
        {
            let mut cause = self.cause.lock();
            // Whoever triggered it before is why the system ends.
            if cause.is_none() && self.phase.load(Ordering::Acquire) == NORMAL {
                *cause = Some((process, error));
            }
        }
        self.trigger();
    }

    /// What a process raised it with.
    pub(crate) fn cause(&self) -> Option<(ProcessId, Error)> {
        self.cause.lock().clone()
    }

    /// Wakes the thread; the first trigger counts. From any thread, on the real-time path too: O(1), one system call.
    pub(crate) fn trigger(&self) {
        self.begin();
        signals::announce_event();
    }

    fn begin(&self) {
        if let Some(simulation) = &self.simulation {
            // How far it would go until the functions have run is another in each run.
            simulation.stop_time();
        }
        self.phase.fetch_max(TRIGGERED, Ordering::AcqRel);
    }

    /// The system's clock.
    fn clock(&self) -> Clock {
        self.simulation
            .as_ref()
            .map_or(Clock::REAL, SimulationHandle::clock)
    }

    /// Whether there is an emergency: the functions have run, or will.
    pub(crate) fn has_begun(&self) -> bool {
        matches!(self.phase.load(Ordering::Acquire), TRIGGERED | SAFE)
    }

    /// Whether the functions have run.
    pub(crate) fn is_safe(&self) -> bool {
        self.phase.load(Ordering::Acquire) == SAFE
    }

    fn end(&self) {
        self.is_to_end.store(true, Ordering::Release);
        signals::announce_event();
    }

    /// Whether the thread may end without an emergency: there is none, and none will begin.
    fn may_end(&self) -> bool {
        self.is_to_end.load(Ordering::Acquire)
            && self
                .phase
                .compare_exchange(NORMAL, ENDED, Ordering::AcqRel, Ordering::Relaxed)
                .is_ok()
    }
}

/// A function that brings something to safety, with its name.
pub(crate) struct Function {
    pub(crate) name: String,
    pub(crate) run: Box<dyn FnMut() + Send>,
}

/// The thread, as the system sees it. Dropping it ends it.
pub(crate) struct EmergencyThread {
    emergency: Arc<Emergency>,
    thread: Option<Thread<Option<i32>>>,
}

impl EmergencyThread {
    /// Starts the thread, at the highest priority if the system is a `real_time` one. It watches for SIGINT and SIGTERM.
    pub(crate) fn start(
        emergency: Arc<Emergency>,
        functions: Vec<Function>,
        living: Arc<Living>,
        real_time: bool,
    ) -> Result<Self> {
        let watch = match SignalWatch::install(&[Signal::Interrupt, Signal::Terminate]) {
            Ok(watch) => Some(watch),
            // A platform without signals has the functions all the same, for panics.
            Err(SignalError::Unsupported) => None,
            Err(error) => return Err(error.into()),
        };
        let policy = if real_time {
            Policy::fifo(EMERGENCY_PRIORITY)
        } else {
            Policy::Other
        };
        let own = emergency.clone();
        let thread = thread::spawn(
            Attributes::framework("luna-emergency", policy),
            |_| Ok::<_, Infallible>(()),
            move |()| watch_over(&own, functions, watch, &living),
        )
        .map_err(|error| Error::not_started("the emergency manager", error))?;
        Ok(Self {
            emergency,
            thread: Some(thread),
        })
    }

    /// What the thread was refused.
    pub(crate) fn shortfalls(&self) -> &[Shortfall] {
        self.thread
            .as_ref()
            .map_or(&[], |thread| &thread.obtained().shortfalls)
    }

    /// Ends the thread, which runs the functions before that if there is an emergency; gives the signal that made it, if one did. From then on
    /// [`Emergency::is_safe`] says for good whether there was one.
    pub(crate) fn stop(mut self) -> Option<i32> {
        self.join()
    }

    fn join(&mut self) -> Option<i32> {
        self.emergency.end();
        // A panic in an emergency function is caught; the thread's own would have been reported by the panic hook.
        self.thread
            .take()
            .and_then(|thread| thread.join().ok())
            .flatten()
    }
}

impl Drop for EmergencyThread {
    fn drop(&mut self) {
        self.join();
    }
}

/// The life of the thread. Returns the signal that was received.
fn watch_over(
    emergency: &Emergency,
    mut functions: Vec<Function>,
    watch: Option<SignalWatch>,
    living: &Living,
) -> Option<i32> {
    let received = || watch.as_ref().and_then(SignalWatch::received);
    let mut seen = signals::event_count();
    // A signal that comes as the system ends is seen all the same.
    while received().is_none() && emergency.phase.load(Ordering::Acquire) != TRIGGERED {
        if emergency.may_end() {
            return received();
        }
        seen = signals::wait_for_event(seen, Instant::NEVER);
    }
    emergency.begin();
    let clock = emergency.clock().enter();
    let mut panicked = Vec::new();
    for Function { name, run } in &mut functions {
        // The others must run whatever this one does.
        if let Err(payload) = catch_unwind(AssertUnwindSafe(run)) {
            // Its drop is the user's code too.
            std::mem::forget(payload);
            panicked.push(name.as_str());
        }
    }
    drop(clock);
    emergency.phase.fetch_max(SAFE, Ordering::AcqRel);
    living.announce();
    // Only now: standard error may be a pipe that nobody reads.
    for name in panicked {
        eprintln!("luna: emergency function `{name}` panicked; the others ran");
    }
    while !emergency.is_to_end.load(Ordering::Acquire) {
        seen = signals::wait_for_event(seen, Instant::NEVER);
    }
    received()
}

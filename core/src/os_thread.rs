//! OS-thread processes: one process blocked on its own thread.

use crate::call_count;
use crate::current::{self, ExecutorId, ProcessId};
use crate::deferred_free::Shared;
use crate::events;
use crate::executor::{Announced, Executor, ExecutorHandle, Serves};
use crate::file_watch;
use crate::park::{self, Parker};
use crate::process::{ProcessHandle, ProcessRegistry, ProcessSpec, prepare_thread};
use crate::quiescence::Quiescence;
use crate::simulation::{SimulationHandle, is_stage};
use crate::timer_queue::TimerQueue;
use luna_platform::clock::{Clock, Instant};
use luna_platform::thread::{self, Attributes, Obtained, SpawnError};
use std::convert::Infallible;
use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

/// [`block_on`] was called inside a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "this thread runs a process already, which running another to its end would stop: await it instead"
)]
pub struct Nested;

/// Runs `future` as a process on this thread, until it is done. It may borrow and need not be
/// `Send`; it may make blocking calls.
///
/// Its deadlines and wakes are those of any process: one futex wait until the next deadline when
/// nothing is to be done.
///
/// # Errors
///
/// [`Nested`] inside a process.
///
/// ```
/// assert_eq!(luna_core::block_on(async { 1 + 1 }), Ok(2));
/// let nested = luna_core::block_on(async { luna_core::block_on(async {}) });
/// assert!(nested.unwrap().is_err());
/// ```
pub fn block_on<F: Future>(future: F) -> Result<F::Output, Nested> {
    run_here(future, |_, _, parker, deadline| parker.park(deadline))
}

/// As [`block_on`], and calls `stuck` when the process has waited for `patience`, and neither a
/// deadline, nor a file, nor a call on the pool is there to wake it: then only another thread can.
/// `stuck` gets the process' number, and returns whether it needs no more calls; if not, it is
/// called again after the next such wait. It runs between two polls, so it may take its time.
///
/// # Errors
///
/// As for `block_on`.
///
/// ```
/// use std::sync::{Arc, Mutex};
/// use std::task::Poll;
/// use std::time::Duration;
///
/// let waiting = Arc::new(Mutex::new(None));
/// let seen = waiting.clone();
/// let mut polls = 0;
/// let process = std::future::poll_fn(move |cx| {
///     polls += 1;
///     *waiting.lock().unwrap() = Some(cx.waker().clone());
///     if polls == 1 { Poll::Pending } else { Poll::Ready(polls) }
/// });
/// // No thread would ever wake it, so the closure does.
/// let outcome = luna_core::block_on_patiently(process, Duration::from_millis(1), |_| {
///     seen.lock().unwrap().take().map(std::task::Waker::wake);
///     true
/// });
/// assert_eq!(outcome, Ok(2));
/// ```
pub fn block_on_patiently<F: Future>(
    future: F,
    patience: Duration,
    mut stuck: impl FnMut(ProcessId) -> bool,
) -> Result<F::Output, Nested> {
    let mut has_heard = false;
    run_here(future, |id, quiescence, parker, deadline| {
        // Nothing that the thread has of its own can wake it.
        let only_others_can = deadline == Instant::NEVER
            && !file_watch::is_waiting(parker.bell())
            && !quiescence.has_calls();
        if !has_heard && only_others_can {
            if parker.park(Instant::now() + patience) {
                return true;
            }
            has_heard = stuck(id);
        }
        parker.park(deadline)
    })
}

/// Runs `future` on this thread, if it runs no processes yet. Polls until done, in between in
/// `sleep`: until a wake or a deadline, saying whether it was a wake.
fn run_here<F: Future>(
    future: F,
    mut sleep: impl FnMut(ProcessId, &Quiescence, &Parker, Instant) -> bool,
) -> Result<F::Output, Nested> {
    if current::executor_id().is_some() {
        return Err(Nested);
    }
    // Where a blocking call of a process on a virtual clock runs this, time stands until it is
    // over.
    let _clock = Clock::REAL.enter();
    let parker = Shared::new(Parker::new());
    let _files = file_watch::enter(parker.bell(), None);
    let quiescence = Arc::new(Quiescence::new());
    let _calls = call_count::enter(quiescence.clone(), None, None);
    let id = ProcessId::new();
    let mut future = pin!(future);
    let timers = Arc::new(TimerQueue::new());
    let executor_id = ExecutorId::new();
    let _entered = current::enter_executor(executor_id, timers.clone(), true);
    // Alone on its thread it needs no way around its waker.
    let waker = park::waker(&parker);
    let priority = thread::current_policy().rank();
    let level = ProcessSpec::DEFAULT_LEVEL;
    let process = current::Alone::new(id, priority, level, waker.clone());
    let mut cx = Context::from_waker(&waker);
    // It may block, and a first blocking call must not allocate.
    park::prepare();
    prepare_thread();
    loop {
        events::begin_turn(id.get());
        // SAFETY: this thread is the process' executor, and the process ends with this function.
        let polled = unsafe { current::with_process(&process, || future.as_mut().poll(&mut cx)) };
        if let Poll::Ready(output) = polled {
            return Ok(output);
        }
        events::end_turn(id.get(), false);
        loop {
            // Before each park, also one that returns at once: a process that always readies itself
            // again has deadlines and files too.
            if timers.next_deadline() != Instant::NEVER {
                timers.expire(Instant::now());
            }
            file_watch::glance(parker.bell());
            events::report_executor(events::code::ASLEEP);
            let is_woken = sleep(id, &quiescence, &parker, timers.next_deadline());
            events::report_executor(events::code::AWAKE);
            if is_woken {
                events::ready(|| id.get());
                break;
            }
        }
    }
}

/// An OS thread of its own for one process: an executor that serves it alone, so the process may
/// make blocking calls. It starts held, as an executor does; dropping it stops it. The thread ends
/// with the process.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_core::{Exit, OsThread, ProcessSpec};
/// use luna_platform::thread::Attributes;
///
/// let thread = OsThread::start(Attributes::new("console"), ProcessSpec::new("reader"), || async {
///     std::thread::yield_now(); // may block: nobody else runs here
/// })?;
/// thread.release();
/// assert_eq!(thread.process().wait(), Exit::Completed);
/// # Ok(()) }
/// ```
pub struct OsThread {
    process: ProcessHandle,
    executor: Executor,
}

impl OsThread {
    /// Starts the thread with its attributes and builds the process on it; returns when both are
    /// done.
    ///
    /// # Errors
    ///
    /// What the system refused, if the attributes are strict or cannot be had in any way.
    pub fn start<B, F>(
        attributes: Attributes,
        spec: ProcessSpec,
        build: B,
    ) -> Result<OsThread, SpawnError<Infallible>>
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output = ()> + 'static,
    {
        let registry = Arc::new(ProcessRegistry::new());
        Self::start_counted(attributes, registry, |executor| {
            executor.announce(spec, build)
        })
    }

    /// Like [`start`](Self::start), with the process counted in `registry`. `announce` announces
    /// the process, and no other, on the thread that has started.
    ///
    /// # Errors
    ///
    /// As for `start`. Then `announce` was not called.
    pub fn start_counted(
        attributes: Attributes,
        registry: Arc<ProcessRegistry>,
        announce: impl FnOnce(&ExecutorHandle) -> (Announced, ProcessHandle),
    ) -> Result<OsThread, SpawnError<Infallible>> {
        let executor = Executor::start_thread(attributes, registry, Serves::One)?;
        let (announced, process) = announce(executor.handle());
        drop(announced.start());
        executor.settle();
        Ok(OsThread { process, executor })
    }

    /// Starts the process on the thread of a simulation, as the only one of an
    /// [executor](Executor::start_simulated) of its own: it must not make blocking calls there but
    /// through [`blocking`](crate::blocking). Returns when it is built; on the simulation's thread,
    /// where that cannot be waited for, before that.
    pub fn start_simulated(
        simulation: &SimulationHandle,
        attributes: &Attributes,
        announce: impl FnOnce(&ExecutorHandle) -> (Announced, ProcessHandle),
    ) -> OsThread {
        let executor = Executor::start_simulated(simulation, attributes);
        let (announced, process) = announce(executor.handle());
        drop(announced.start());
        if !is_stage(&simulation.0) {
            executor.settle();
        }
        OsThread { process, executor }
    }

    /// The process.
    pub fn process(&self) -> &ProcessHandle {
        &self.process
    }

    /// What the thread got of the requested attributes; `None` on a simulation's thread.
    pub fn obtained(&self) -> Option<&Obtained> {
        self.executor.obtained()
    }

    /// How long the thread has run from the release of its process to its end, once it has ended;
    /// `None` where the system does not report it, and on a simulation's thread.
    pub fn processor_time(&self) -> Option<Duration> {
        self.executor.processor_time()
    }

    /// As [`ExecutorHandle::end_spin`].
    pub fn end_spin(&self) -> bool {
        self.executor.handle().end_spin()
    }

    /// Lets the process run.
    pub fn release(&self) {
        self.executor.release();
    }

    /// Requests the end of the process, without waiting for it. A blocking call in it ends by
    /// itself or not at all.
    pub fn request_stop(&self) {
        self.executor.request_stop();
    }

    /// Whether the thread has ended.
    pub fn has_stopped(&self) -> bool {
        self.executor.has_stopped()
    }

    /// Detaches the thread: for one with a process that hangs in a blocking call.
    pub fn abandon(self) {
        self.executor.abandon();
    }
}

luna_platform::debug_fields!(OsThread, |thread| process: thread.process);

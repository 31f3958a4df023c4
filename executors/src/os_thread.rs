//! OS-thread processes: one process blocked on its own thread.

use crate::calls;
use crate::counted::Counted;
use crate::executor::{Executor, Phase};
use crate::process::{
    Enrolled, ExitValue, ProcessHandle, ProcessRegistry, ProcessSpec, RawExit, Record, RecordRef,
    Recorded, prepare_thread,
};
use crate::quiescence::{Quiescence, Sleeper};
use crate::simulation::{SimulationHandle, is_stage};
use crate::watch;
use luna_core::current::{self, ExecutorId, ProcessId};
use luna_core::deferred_free::{self, Shared};
use luna_core::events;
use luna_core::park::{self, Parker};
use luna_core::spin::{self, Outside};
use luna_core::timer_queue::TimerQueue;
use luna_platform::clock::{Clock, Instant};
use luna_platform::thread::{self, Attributes, Obtained, SpawnError, Thread};
use std::convert::Infallible;
use std::fmt;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::{Pin, pin};
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;

/// [`block_on`] was called inside a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Nested;

impl fmt::Display for Nested {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("this thread runs a process already, which running another to its end would stop: await it instead")
    }
}

impl std::error::Error for Nested {}

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
/// assert_eq!(luna_executors::block_on(async { 1 + 1 }), Ok(2));
/// let nested = luna_executors::block_on(async { luna_executors::block_on(async {}) });
/// assert!(nested.unwrap().is_err());
/// ```
pub fn block_on<F: Future>(future: F) -> Result<F::Output, Nested> {
    if current::executor_id().is_some() {
        return Err(Nested);
    }
    Ok(run_here(future, |_, _, parker, deadline| {
        parker.park(deadline)
    }))
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
/// let outcome = luna_executors::block_on_patiently(process, Duration::from_millis(1), |_| {
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
    if current::executor_id().is_some() {
        return Err(Nested);
    }
    let mut has_heard = false;
    Ok(run_here(future, |id, quiescence, parker, deadline| {
        if !has_heard && only_others_can_wake(parker, deadline) && !quiescence.has_calls() {
            if parker.park(Instant::now() + patience) {
                return true;
            }
            has_heard = stuck(id);
        }
        parker.park(deadline)
    }))
}

/// Whether nothing that the thread has of its own can wake it.
fn only_others_can_wake(parker: &Parker, deadline: Instant) -> bool {
    deadline == Instant::NEVER && !watch::is_waiting(parker.bell())
}

/// Runs `future` on this thread, which runs no processes yet.
fn run_here<F: Future>(
    future: F,
    mut sleep: impl FnMut(ProcessId, &Quiescence, &Parker, Instant) -> bool,
) -> F::Output {
    // Where a blocking call of a process on a virtual clock runs this, time stands until it is
    // over.
    let _clock = Clock::REAL.enter();
    let parker = Shared::new(Parker::new());
    let _files = watch::enter(parker.bell());
    let quiescence = Arc::new(Quiescence::new());
    let _calls = calls::enter(quiescence.clone(), None);
    let id = ProcessId::new();
    let priority = thread::current_policy().rank();
    let spec = (id, priority, ProcessSpec::DEFAULT_LEVEL);
    run(
        pin!(future),
        &parker,
        ExecutorId::new(),
        spec,
        None,
        |parker, deadline| sleep(id, &quiescence, parker, deadline),
    )
}

/// Clears the record's pointer to its process.
struct Forget<'a>(&'a Record);

impl Drop for Forget<'_> {
    fn drop(&mut self) {
        self.0.forget_process();
    }
}

/// Polls until done, in between in `sleep`: until a wake or a deadline, saying whether it was a
/// wake. The process of a `record` is on the real-time path once all that it needs for this is
/// there. The caller lets the thread wait for files.
fn run<F: Future>(
    mut future: Pin<&mut F>,
    parker: &Shared<Parker>,
    executor_id: ExecutorId,
    (id, thread_priority, level): (ProcessId, u8, u8),
    record: Option<&Record>,
    mut sleep: impl FnMut(&Parker, Instant) -> bool,
) -> F::Output {
    let timers = Arc::new(TimerQueue::new());
    let _entered = current::enter_executor(executor_id, timers.clone(), true);
    // Alone on its thread it needs no way around its waker.
    let waker = park::waker(parker);
    let body = ptr::from_ref(&*future).addr();
    let body = body..body + size_of::<F>();
    let process = current::Lone::new(id, executor_id, thread_priority, level, waker.clone(), body);
    // SAFETY: it is forgotten before the process goes.
    let _seen = record.map(|record| unsafe {
        record.set_process(NonNull::from(&*process));
        Forget(record)
    });
    if let Some(record) = record {
        events::name_process(id.get(), level, || record.name().to_owned());
    }
    let mut cx = Context::from_waker(&waker);
    // It may block, and a first blocking call must not allocate.
    park::prepare();
    prepare_thread();
    current::set_on_path(record.is_some());
    loop {
        if record.is_some_and(|record| !record.is_cancelled()) {
            process.count_poll();
        }
        events::begin_turn(id.get());
        // SAFETY: this thread is the process' executor, and the process ends with this function.
        let polled = unsafe { current::with_process(&process, || future.as_mut().poll(&mut cx)) };
        if let Poll::Ready(output) = polled {
            current::set_on_path(false);
            return output;
        }
        events::end_turn(id.get(), false);
        loop {
            // Before each park, also one that returns at once: a process that always readies itself
            // again has deadlines and files too.
            if timers.next_deadline() != Instant::NEVER {
                timers.expire(Instant::now());
            }
            watch::glance(parker.bell());
            events::report_executor(events::code::ASLEEP);
            let is_woken = sleep(parker, timers.next_deadline());
            events::report_executor(events::code::AWAKE);
            if is_woken {
                events::ready(|| id.get());
                break;
            }
        }
    }
}

/// An OS thread of its own for one process. It starts held, as an executor does; dropping it stops
/// it.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_executors::{Exit, OsThread, ProcessSpec};
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
    runs: Runs,
}

/// Where its process runs.
enum Runs {
    OnThread(Arc<Held>, Thread<()>),
    /// On an executor of its own, which a simulation's thread runs.
    OnStage(Executor),
    /// It is left to itself.
    Nowhere,
}

/// What the thread shares with its owner.
struct Held {
    phase: AtomicU8,
    parker: Shared<Parker>,
    thread_priority: AtomicU8,
    executor_id: ExecutorId,
    quiescence: Arc<Quiescence>,
    registry: Arc<ProcessRegistry>,
    /// How long the thread looks for a wake before it sleeps, in nanoseconds.
    spin: AtomicU64,
    counted: Counted,
}

impl Sleeper for Held {
    fn quiescence(&self) -> &Quiescence {
        &self.quiescence
    }

    fn is_woken(&self) -> bool {
        self.parker.is_woken()
    }
}

impl Outside for Held {
    fn is_called(&self) -> bool {
        self.parker.is_woken() || self.time().is_zero()
    }

    fn time(&self) -> Duration {
        Duration::from_nanos(self.spin.load(Ordering::Relaxed))
    }
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
        Self::start_counted(attributes, spec, build, Arc::new(ProcessRegistry::new()))
    }

    /// Like [`start`](Self::start), with the process counted in `registry`.
    ///
    /// # Errors
    ///
    /// As for `start`.
    pub fn start_counted<B, F>(
        attributes: Attributes,
        spec: ProcessSpec,
        build: B,
        registry: Arc<ProcessRegistry>,
    ) -> Result<OsThread, SpawnError<Infallible>>
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output: ExitValue> + 'static,
    {
        let shared = Arc::new(Held {
            phase: AtomicU8::new(Phase::HELD),
            parker: Shared::new(Parker::new()),
            thread_priority: AtomicU8::new(0),
            executor_id: ExecutorId::new(),
            quiescence: Arc::new(Quiescence::new()),
            registry,
            spin: AtomicU64::new(0),
            counted: Counted::default(),
        });
        let record = RecordRef::boxed(Record::new(spec, &shared.registry));
        record.set_waker(park::waker(&shared.parker));
        let process = ProcessHandle(record.clone());
        let (own, of_body, of_thread) = (shared.clone(), record.clone(), record.clone());
        let started = thread::spawn(
            attributes,
            move |obtained: &Obtained| {
                own.thread_priority
                    .store(obtained.policy.rank(), Ordering::Relaxed);
                own.spin.store(
                    obtained.spin_before_sleep.as_nanos() as u64,
                    Ordering::Relaxed,
                );
                // Before the body is built, which may prepare to wait for files.
                let files = watch::enter(own.parker.bell());
                let enrolled = own.registry.enroll(own.executor_id, own.clone());
                // Boxed, so that it does not move from here on; once for the process' life, and
                // freed off the real-time path.
                let body = catch_unwind(AssertUnwindSafe(build))
                    .map(|future| Box::pin(Recorded::new(future, of_body, own.registry.clone())));
                Ok((own, files, enrolled, body))
            },
            move |(shared, _files, enrolled, body)| match body {
                Ok(body) => shared.run(of_thread, body, enrolled),
                Err(payload) => of_thread.end(RawExit::Panicked(payload), &shared.registry),
            },
        );
        match started {
            Ok(thread) => Ok(OsThread {
                process,
                runs: Runs::OnThread(shared, thread),
            }),
            Err(error) => {
                record.end(RawExit::Cancelled, &shared.registry);
                Err(error)
            }
        }
    }

    /// Starts the process on the thread of a simulation, as the only one of an
    /// [executor](Executor::start_simulated) of its own: it must not make blocking calls there but
    /// through [`blocking`](crate::blocking). Returns when it is built; on the simulation's thread,
    /// where that cannot be waited for, before that.
    pub fn start_simulated<B, F>(
        simulation: &SimulationHandle,
        attributes: &Attributes,
        spec: ProcessSpec,
        build: B,
    ) -> OsThread
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output: ExitValue> + 'static,
    {
        let executor = Executor::start_simulated(simulation, attributes);
        let (announced, process) = executor.handle().announce(spec, build);
        drop(announced.start());
        if !is_stage(&simulation.0) {
            executor.settle();
        }
        OsThread {
            process,
            runs: Runs::OnStage(executor),
        }
    }

    /// The process.
    pub fn process(&self) -> &ProcessHandle {
        &self.process
    }

    /// What the thread got of the requested attributes; `None` on a simulation's thread.
    pub fn obtained(&self) -> Option<&Obtained> {
        match &self.runs {
            Runs::OnThread(_, thread) => Some(thread.obtained()),
            Runs::OnStage(_) | Runs::Nowhere => None,
        }
    }

    /// How long the thread has run from the release of its process to its end, once it has ended;
    /// `None` where the system does not report it, and on a simulation's thread.
    pub fn processor_time(&self) -> Option<Duration> {
        match &self.runs {
            Runs::OnThread(shared, _) => shared.counted.get(),
            Runs::OnStage(_) | Runs::Nowhere => None,
        }
    }

    /// As [`ExecutorHandle::end_spin`](crate::ExecutorHandle::end_spin).
    pub fn end_spin(&self) -> bool {
        match &self.runs {
            Runs::OnThread(shared, _) => shared.spin.swap(0, Ordering::Relaxed) > 0,
            Runs::OnStage(_) | Runs::Nowhere => false,
        }
    }

    /// Lets the process run.
    pub fn release(&self) {
        match &self.runs {
            Runs::OnThread(shared, _) => shared.advance(Phase::RELEASED),
            Runs::OnStage(executor) => executor.release(),
            Runs::Nowhere => {}
        }
    }

    /// Requests the end of the process, without waiting for it. A blocking call in it ends by
    /// itself or not at all.
    pub fn request_stop(&self) {
        match &self.runs {
            Runs::OnThread(shared, _) => {
                self.process.cancel();
                shared.advance(Phase::STOPPING);
            }
            // When no process can run: so it is the same in each run.
            Runs::OnStage(executor) => executor.request_stop(),
            Runs::Nowhere => {}
        }
    }

    /// Whether the thread has ended.
    pub fn has_stopped(&self) -> bool {
        match &self.runs {
            Runs::OnThread(_, thread) => thread.is_finished(),
            Runs::OnStage(executor) => executor.has_stopped(),
            Runs::Nowhere => true,
        }
    }

    /// Detaches the thread: for one with a process that hangs in a blocking call.
    pub fn abandon(mut self) {
        if let Runs::OnStage(executor) = std::mem::replace(&mut self.runs, Runs::Nowhere) {
            executor.abandon();
        }
    }
}

impl Held {
    fn advance(&self, phase: u8) {
        self.phase.fetch_max(phase, Ordering::AcqRel);
        self.parker.unpark();
    }

    fn run<F: Future<Output: ExitValue>>(
        self: &Arc<Self>,
        record: RecordRef,
        mut body: Pin<Box<Recorded<F>>>,
        _enrolled: Enrolled,
    ) {
        let _looking = (self.spin.load(Ordering::Relaxed) > 0).then(|| spin::enter(self.clone()));
        let _calls = calls::enter(self.quiescence.clone(), Some(self.registry.clone()));
        // Parks first, so that the wake which comes with the release is taken here and is no poll
        // too many.
        loop {
            self.parker.park(Instant::NEVER);
            if self.phase.load(Ordering::Acquire) != Phase::HELD {
                break;
            }
        }
        let (id, level) = (record.id(), record.level());
        let priority = self.thread_priority.load(Ordering::Relaxed);
        let ran = catch_unwind(AssertUnwindSafe(|| {
            let spec = (id, priority, level);
            self.counted.count(|| {
                run(
                    body.as_mut(),
                    &self.parker,
                    self.executor_id,
                    spec,
                    Some(&record),
                    |_, deadline| self.sleep(deadline),
                );
            });
        }));
        if let Err(payload) = ran {
            // Not the body's panic, which is caught where it is polled: a foreign waker's, say.
            let abandoned = AssertUnwindSafe(|| current::with_abandoned(|| drop(body)));
            if let Err(second) = catch_unwind(abandoned) {
                // The first one counts, and dropping the other could panic in turn.
                std::mem::forget(second);
            }
            record.end(RawExit::Panicked(payload), &self.registry);
        }
        record.forget_process();
        deferred_free::collect();
    }
}

impl Held {
    /// Sleeps until a wake or `deadline`; returns whether it was a wake. Where only other threads
    /// can end the sleep, the observer of quiescence is notified of that.
    fn sleep(&self, deadline: Instant) -> bool {
        let spin = self.spin.load(Ordering::Relaxed);
        if spin > 0 {
            let glance = || watch::glance(self.parker.bell());
            let time = Duration::from_nanos(spin);
            if let Some(woken) = self.parker.spin(time, deadline, glance) {
                return woken;
            }
        }
        if !only_others_can_wake(&self.parker, deadline) {
            return self.parker.park(deadline);
        }
        let become_quiescent = || {
            if self.quiescence.become_quiescent() {
                self.registry.announce();
            }
        };
        self.parker
            .park_between(deadline, become_quiescent, || self.quiescence.wake())
    }
}

impl Drop for OsThread {
    fn drop(&mut self) {
        self.request_stop();
        // An executor is stopped by its own drop.
        if let Runs::OnThread(_, thread) = std::mem::replace(&mut self.runs, Runs::Nowhere) {
            // The body catches its process' panic; one of the thread's own was reported by the
            // panic hook.
            let _ = thread.join();
        }
    }
}

impl fmt::Debug for OsThread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OsThread")
            .field("process", &self.process)
            .finish_non_exhaustive()
    }
}

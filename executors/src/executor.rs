//! The priority executor: one OS thread that runs many processes.
//!
//! Each round it looks, in this order, at one word that holds the requests of other threads and
//! whether a deadline may be due ([`deadlines`](crate::deadlines)), at its files (if any was ever
//! waited for, every so many rounds), and at the highest level of its run queue, the first process
//! of which it polls. With nothing to do it sleeps until the next deadline.

use crate::calls;
use crate::counted::Counted;
use crate::deadlines::Deadlines;
use crate::inbound::{Inbound, Signals};
use crate::interference;
use crate::process::{
    Enrolled, ExitValue, ProcessHandle, ProcessRegistry, ProcessSpec, panic_message, poll_monitor,
    prepare_thread,
};
use crate::quiescence::{Quiescence, Sleeper};
use crate::simulation::{SimulationHandle, Stage, is_stage};
use crate::task::{self, Unbuilt};
use crate::watch;
use luna_core::arc_cache::ArcCache;
use luna_core::current::{self, ExecutorId};
use luna_core::deferred_free;
use luna_core::events;
use luna_core::spin::{self, Outside};
use luna_core::timer_queue::{Attention, TimerQueue};
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::thread::{self, Attributes, Obtained, SpawnError, Thread};
use std::any::Any;
use std::cell::Cell;
use std::convert::Infallible;
use std::fmt;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::time::Duration;

/// How far a thread has come: numbers, since they only rise.
pub(crate) struct Phase;

impl Phase {
    /// Processes are taken in, none runs.
    pub(crate) const HELD: u8 = 0;
    /// Processes run.
    pub(crate) const RELEASED: u8 = 1;
    /// All are cancelled, then the thread ends.
    pub(crate) const STOPPING: u8 = 2;
}

thread_local! {
    /// What the tasks of this thread that have ended had of the executor that it is.
    static SPARE_SHARED: ArcCache<Shared> = const { ArcCache::new() };
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

/// Another reference for a task of an executor.
fn another(shared: &Arc<Shared>) -> Arc<Shared> {
    SPARE_SHARED.with(|spare| spare.another(shared))
}

/// Takes a task's reference back.
pub(crate) fn give_back(shared: Arc<Shared>) {
    // A thread that is ending keeps none any more.
    let _ = SPARE_SHARED.try_with(move |spare| spare.give_back(shared));
}

/// What an executor's thread shares with the others.
pub(crate) struct Shared {
    executor_id: ExecutorId,
    thread_priority: AtomicU8,
    inbound: Inbound,
    phase: AtomicU8,
    arrivals: PiLock<Arrivals>,
    /// How many arrivals were taken in: what `settle` waits for.
    settled: Futex,
    registry: Arc<ProcessRegistry>,
    quiescence: Arc<Quiescence>,
    /// How long the thread looks for work before it sleeps, in nanoseconds.
    spin: AtomicU64,
    counted: Counted,
    /// The stage that runs it, if it has no thread of its own.
    stage: Option<Arc<Stage>>,
    /// Its name, if it is on a stage: its thread has another.
    name: Option<Box<str>>,
    /// Set when one on a stage has stopped.
    stopped: Futex,
}

#[derive(Default)]
struct Arrivals {
    /// To be built on the executor's thread.
    waiting: task::Arrivals,
    announced: u32,
    closed: bool,
}

impl Shared {
    pub(crate) fn executor_id(&self) -> ExecutorId {
        self.executor_id
    }

    pub(crate) fn thread_priority(&self) -> u8 {
        self.thread_priority.load(Ordering::Relaxed)
    }

    pub(crate) fn inbound(&self) -> &Inbound {
        &self.inbound
    }

    pub(crate) fn registry(&self) -> &Arc<ProcessRegistry> {
        &self.registry
    }

    pub(crate) fn phase(&self) -> u8 {
        self.phase.load(Ordering::Acquire)
    }

    /// Goes on to `phase` unless a later one is reached already.
    pub(crate) fn advance(&self, phase: u8) {
        self.phase.fetch_max(phase, Ordering::AcqRel);
        self.inbound.ask_attention();
    }

    /// Builds what has arrived. Allocates: off the real-time path.
    pub(crate) fn take_in(self: &Arc<Self>) {
        let mut arrived = std::mem::take(&mut self.arrivals.lock().waiting);
        if arrived.is_empty() {
            return;
        }
        while let Some(process) = arrived.pop() {
            process.build();
            self.settled.word().fetch_add(1, Ordering::AcqRel);
        }
        self.settled.wake_all();
    }

    /// One that is held, on a thread of its own or on a stage's.
    fn new(
        thread_priority: u8,
        registry: Arc<ProcessRegistry>,
        quiescence: Arc<Quiescence>,
        stage: Option<(Arc<Stage>, &str)>,
    ) -> Arc<Self> {
        let name = stage.as_ref().map(|(_, name)| Box::from(*name));
        Arc::new(Shared {
            executor_id: ExecutorId::new(),
            thread_priority: AtomicU8::new(thread_priority),
            inbound: Inbound::new(),
            phase: AtomicU8::new(Phase::HELD),
            arrivals: PiLock::new(Arrivals::default()),
            settled: Futex::new(0),
            registry,
            quiescence,
            spin: AtomicU64::new(0),
            counted: Counted::default(),
            stage: stage.map(|(stage, _)| stage),
            name,
            stopped: Futex::new(0),
        })
    }

    /// Its name, on a stage.
    pub(crate) fn name(&self) -> &str {
        self.name.as_deref().unwrap_or_default()
    }

    /// It has stopped, on a stage.
    pub(crate) fn set_stopped(&self) {
        self.stopped.word().store(1, Ordering::Release);
        self.stopped.wake_all();
    }

    fn is_stopped(&self) -> bool {
        self.stopped.word().load(Ordering::Acquire) != 0
    }

    /// Its stage had ended before it came.
    pub(crate) fn refuse_all(&self) {
        self.advance(Phase::STOPPING);
        self.close();
        self.set_stopped();
    }

    /// Ends the executor after a panic outside of any process, on its thread. A process may rely on
    /// what was to be done there, so none is polled any more: all have panicked with it. Their
    /// bodies are dropped, and the channel ends in them poison their channels, so that partners
    /// elsewhere do not wait for them. O(processes), and what their drops take.
    pub(crate) fn give_up(&self, payload: Box<dyn Any + Send>) {
        let why = format!(
            "its executor's thread panicked outside of any process, as a waker does that is not LUNA's: {}",
            panic_message(&*payload)
        );
        // Dropping it could panic in turn.
        std::mem::forget(payload);
        // Nothing is built here from now on.
        self.advance(Phase::STOPPING);
        GIVES_UP.set(true);
        task::end_all(&why);
        GIVES_UP.set(false);
        self.close();
    }

    /// Takes in no more; those that wait end unstarted.
    pub(crate) fn close(&self) {
        let mut refused = {
            let mut arrivals = self.arrivals.lock();
            arrivals.closed = true;
            std::mem::take(&mut arrivals.waiting)
        };
        while let Some(process) = refused.pop() {
            drop(process);
            self.settled.word().fetch_add(1, Ordering::AcqRel);
        }
        self.settled.wake_all();
    }
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
        let shared = Shared::new(0, registry, Arc::new(Quiescence::new()), None);
        let own = shared.clone();
        let thread = thread::spawn(
            attributes,
            move |obtained: &Obtained| {
                own.thread_priority
                    .store(obtained.policy.priority(), Ordering::Relaxed);
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
            stage.registry().clone(),
            stage.quiescence().clone(),
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
        self.handle.shared.counted.get()
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
        match std::mem::replace(&mut self.runs, Runs::Nowhere) {
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

/// A process to be, on its executor: see [`ExecutorHandle::announce`]. If it is dropped, the
/// process ends as cancelled, and its builder is dropped.
#[must_use = "a process that is announced and not started ends as cancelled"]
pub struct Announced {
    process: Unbuilt,
    /// The result of [`is_built_here`](Self::is_built_here).
    decided: Option<bool>,
}

impl Announced {
    /// Whether [`start`](Self::start) builds the process before it returns: then it calls what is
    /// the user's. If not, it only hands it over.
    pub fn is_built_here(&mut self) -> bool {
        let here = self.can_be_built_here();
        self.decided = Some(here);
        here
    }

    /// In a turn that is looked at, or that drops what was left, a builder would count as a part of
    /// it: then it has a turn of its own.
    fn can_be_built_here(&self) -> bool {
        let shared = self.process.shared();
        current::executor_id() == Some(shared.executor_id)
            && shared.phase() == Phase::RELEASED
            && poll_monitor().is_none()
            && !current::is_abandoned()
            && !current::dropped_ends_poison()
    }

    /// Starts the process: as [`ExecutorHandle::spawn`]. On an executor that has stopped, gives it
    /// back: its builder is the user's, and is dropped with what is given.
    #[must_use = "dropping it drops what is the user's, which is nothing to be done under a lock"]
    pub fn start(self) -> Option<Announced> {
        // A caller that saw that nothing is built here relies on it, also if the executor has been
        // released meanwhile.
        if self.decided.unwrap_or(true) && self.can_be_built_here() {
            // Off the path, and no part of the turn in the middle of which it is done.
            let on_path = current::set_on_path(false);
            current::outside(|| self.process.build());
            current::set_on_path(on_path);
            return None;
        }
        let shared = self.process.shared().clone();
        {
            let mut arrivals = shared.arrivals.lock();
            if arrivals.closed {
                return Some(self);
            }
            arrivals.announced = arrivals.announced.wrapping_add(1);
            arrivals.waiting.push(self.process);
        }
        // A held executor looks when it is released, or waited for: waking it for each process
        // would cost a switch between threads. If it is released meanwhile it has either found the
        // process, or its phase was set before the lock was taken here.
        if shared.phase() != Phase::HELD {
            shared.inbound.ask_attention();
        }
        None
    }
}

impl fmt::Debug for Announced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Announced")
            .field(self.process.record())
            .finish()
    }
}

impl Sleeper for Shared {
    fn quiescence(&self) -> &Quiescence {
        &self.quiescence
    }

    fn is_woken(&self) -> bool {
        self.inbound.is_signalled()
    }
}

impl Outside for Shared {
    fn is_called(&self) -> bool {
        self.inbound.is_signalled() || self.time().is_zero()
    }

    fn time(&self) -> Duration {
        Duration::from_nanos(self.spin.load(Ordering::Relaxed))
    }
}

impl Attention for Shared {
    fn ask_look(&self) {
        self.inbound.ask_look();
    }
}

/// The thread of an executor.
fn run(shared: Arc<Shared>, _enrolled: Enrolled) {
    let timers = Arc::new(TimerQueue::attended(shared.clone()));
    let deadlines = Deadlines::new(shared.clone(), timers.clone());
    let _entered = current::enter_executor(shared.executor_id, timers, false);
    let _files = watch::enter(shared.inbound.bell());
    let _calls = calls::enter(shared.quiescence.clone(), Some(shared.registry.clone()));
    prepare_thread();
    let _looking = (shared.spin.load(Ordering::Relaxed) > 0).then(|| spin::enter(shared.clone()));
    let lived = catch_unwind(AssertUnwindSafe(|| live(&shared, &deadlines)));
    // Panics of bodies are caught where they are polled. This one comes from elsewhere: a foreign
    // waker, say.
    if let Err(payload) = lived {
        current::set_on_path(false);
        shared.give_up(payload);
    }
}

/// From the set-up to the end of all processes.
fn live(shared: &Arc<Shared>, deadlines: &Deadlines) {
    loop {
        shared.inbound.take_attention();
        shared.take_in();
        if shared.phase() != Phase::HELD {
            break;
        }
        // A process that is woken before the start is queued; a signal that is left would keep the
        // thread from its sleep.
        while let Some(level) = shared.inbound.signals().highest_level() {
            task::take_in(shared, level);
        }
        shared.inbound.sleep(Instant::NEVER);
    }
    shared.counted.count(|| {
        let keeps = (shared.registry.keep_ends(), deferred_free::keep_own());
        SPARE_SHARED.with(|spare| spare.keep(shared));
        current::set_on_path(true);
        while let Phase::RELEASED = shared.phase() {
            turns(|| {
                let mut next = None;
                while round(shared, deadlines, true, &mut next) {}
            });
        }
        current::set_on_path(false);
        drop(keeps);
    });
    shared.close();
    for record in task::records() {
        record.cancel();
    }
    while task::count() > 0 {
        turns(|| {
            let mut next = None;
            while round(shared, deadlines, false, &mut next) && task::count() > 0 {}
            if let Some(next) = next {
                // SAFETY: it was taken for the turn that is not given.
                unsafe { current::put_back(next) };
            }
        });
    }
}

/// Runs rounds; ends the process that panics in one. Catching it here and not around each poll
/// saves that.
pub(crate) fn turns(rounds: impl FnOnce()) {
    if let Err(payload) = catch_unwind(AssertUnwindSafe(rounds))
        && let Err(own) = task::interrupted(payload)
    {
        resume_unwind(own);
    }
}

/// Polls `next`, or else the first process of the run queue, or sleeps if none is ready. `false` if
/// the phase may be another; there is no next one then.
#[inline(always)]
fn round(
    shared: &Arc<Shared>,
    deadlines: &Deadlines,
    take_in: bool,
    next: &mut Option<NonNull<()>>,
) -> bool {
    let signals = shared.inbound.signals();
    if !signals.is_empty() || watch::has_files() {
        if let Some(next) = next.take() {
            // SAFETY: it was taken for this turn, and nothing was done with it.
            unsafe { current::put_back(next) };
        }
        if !look_outside(shared, deadlines, take_in, signals) {
            return false;
        }
    }
    // SAFETY: each dequeued process is given a turn at once, or retired.
    match next.take().or_else(|| unsafe { current::next_ready() }) {
        // SAFETY: it was just taken from this thread's queue, where only live tasks are.
        Some(owner) => *next = unsafe { task::run(owner) },
        None => rest(shared, deadlines),
    }
    true
}

/// Takes in the requests of other threads, and looks at the deadlines and the files. `false` if
/// that has changed the phase.
#[cold]
fn look_outside(
    shared: &Arc<Shared>,
    deadlines: &Deadlines,
    take_in: bool,
    signals: Signals,
) -> bool {
    task::end_turns();
    watch::glance(shared.inbound.bell());
    if signals.attention() {
        shared.inbound.take_attention();
        if take_in {
            current::set_on_path(false);
            shared.take_in();
            current::set_on_path(true);
            interference::rest();
            if shared.phase() != Phase::RELEASED {
                return false;
            }
        }
    }
    // Only what is at least as urgent as what is ready here: the rest can wait outside.
    if let Some(level) = signals.highest_level()
        && current::ready_levels() >> level <= 1
    {
        task::take_in(shared, level);
    }
    if signals.deadline() {
        deadlines.look();
    }
    true
}

#[cold]
#[inline(never)]
fn rest(shared: &Shared, deadlines: &Deadlines) {
    task::end_turns();
    // Others may wait for what this thread has kept to itself while there was something to do.
    shared.registry.report_kept();
    deferred_free::hand_over();
    sleep(shared, deadlines.rest());
    interference::rest();
}

/// Sleeps until a wake or `deadline`, after having looked for one if that was asked for. Without a
/// deadline or files only other threads can end the sleep; the observer of quiescence is notified
/// of that.
fn sleep(shared: &Shared, deadline: Instant) {
    let spin = shared.spin.load(Ordering::Relaxed);
    if spin > 0 {
        let found = || {
            watch::glance(shared.inbound.bell());
            current::ready_levels() != 0
        };
        let time = Duration::from_nanos(spin);
        if shared.inbound.spin(time, deadline, found) {
            return;
        }
    }
    events::report_executor(events::code::ASLEEP);
    if deadline != Instant::NEVER || watch::is_waiting(shared.inbound.bell()) {
        shared.inbound.sleep(deadline);
    } else {
        shared
            .inbound
            .sleep_quiescent(&shared.quiescence, || shared.registry.announce());
    }
    events::report_executor(events::code::AWAKE);
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

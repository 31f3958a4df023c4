//! What can be a process, and how the framework starts and ends it.

use crate::csp::alone;
use crate::csp::tree::Tree;
use crate::error::{Error, Result};
use crate::log::Log;
use crate::replay::ReplayLogs;
use crate::safety::Emergency;
use crate::time::{LoopName, Scope};
use luna_core::arc_cache::ArcCache;
use luna_core::events;
use luna_executors::{
    Announced, ExecutorHandle, ExitValue, OsThread, ProcessHandle, ProcessRegistry, ProcessSpec,
    SimulationHandle,
};
use luna_platform::clock::Clock;
use luna_platform::memory::copy_words;
use luna_platform::panics;
use luna_platform::thread::{Attributes, SpawnError};
use luna_platform::usage::ThreadUsage;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::fmt;
use std::future::Future;
use std::hint::cold_path;
use std::marker::PhantomData;
use std::mem::ManuallyDrop;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

/// A process with three phases.
///
/// A plain async block is a process too; implement this when there is something to set up or to
/// clean up.
///
/// ```
/// use luna::prelude::*;
///
/// struct Summer { input: Receiver<u32>, sum: u32 }
///
/// impl Process for Summer {
///     async fn run(&mut self) -> luna::Result<()> {
///         while let Ok(n) = self.input.recv().await {
///             self.sum += n;
///         }
///         assert_eq!(self.sum, 3);
///         Ok(())
///     }
/// }
///
/// let (output, input) = luna::channel();
/// let mut system = System::new("sum");
/// let executor = system.executor("main").build()?;
/// executor.process("summer").spawn(Summer { input, sum: 0 })?;
/// executor.process("source").spawn(async move {
///     output.send(1).await?;
///     output.send(2).await?;
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub trait Process {
    /// Prepares the process: it may allocate and block.
    ///
    /// The `pre_run` of all processes of a system, one after the other in the order of their
    /// spawning, ends before any body runs. Runs on the thread that starts the system, or that
    /// spawns the process while the system runs.
    ///
    /// # Errors
    ///
    /// An error stops the start, which returns it with the process' name; what was prepared until
    /// then gets its `post_run`.
    fn pre_run(&mut self) -> Result<()> {
        Ok(())
    }

    /// The body: the real-time part. Made and run on the executor's thread, so its future need not
    /// be `Send`.
    fn run(&mut self) -> impl Future<Output = Result<()>>;

    /// Cleans up: runs when the body has ended in any way (returned, failed, panicked, cancelled),
    /// off the real-time path, on the thread that runs the system. Then the process is dropped.
    ///
    /// A panic in here, or in the drop, ends no other process; the other processes go on and are
    /// cleaned up, and it is no emergency, since the body is gone. When all have ended it is the
    /// [`run`](crate::System::run)'s error, with the process' name, unless there is a graver one.
    fn post_run(&mut self) {}
}

/// The kind of argument that `spawn` was given. Inferred, never written.
#[doc(hidden)]
#[derive(Debug)]
pub struct ViaFuture;
#[doc(hidden)]
#[derive(Debug)]
pub struct ViaProcess;
#[doc(hidden)]
#[derive(Debug)]
pub struct ViaClosure;

/// What can be spawned as a process; `M` is inferred and separates the three kinds.
///
/// - a future with output `luna::Result<()>` that is `Send`;
/// - a closure that makes one: it runs on the executor's thread, so the future need not be `Send`;
/// - a type that implements [`Process`].
///
/// ```compile_fail,E0277
/// use luna::prelude::*;
///
/// let mut system = System::new("returns nothing");
/// let main = system.executor("main").build()?;
/// main.process("greeter").spawn(async { println!("hello") })?; // without an Ok(())
/// # Ok::<(), luna::Error>(())
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` cannot be spawned as a process",
    label = "not a process",
    note = "a process is a future or a closure that makes one, with output `luna::Result<()>`, or a type that implements `luna::Process`",
    note = "an async block ends in `Ok(())`; other errors become `luna::Error` by `?`, or by `.map_err(luna::Error::other)`",
    note = "it must be `Send + 'static`, with all that it holds across an await, so no `Rc`; a future that is not `Send` is made by a closure, \
            `spawn(|| body())`, which runs where the process does"
)]
pub trait IntoProcess<M> {
    #[doc(hidden)]
    fn prepare(self) -> Prepared<impl Build>;
}

impl<F: Future<Output = Result<()>> + Send + 'static> IntoProcess<ViaFuture> for F {
    fn prepare(self) -> Prepared<impl Build> {
        Prepared {
            resident: None,
            build: move || self,
        }
    }
}

impl<C, F> IntoProcess<ViaClosure> for C
where
    C: FnOnce() -> F + Send + 'static,
    F: Future<Output = Result<()>> + 'static,
{
    fn prepare(self) -> Prepared<impl Build> {
        Prepared {
            resident: None,
            build: self,
        }
    }
}

impl<P: Process + Send + 'static> IntoProcess<ViaProcess> for P {
    fn prepare(self) -> Prepared<impl Build> {
        let resident = Resident::new(self);
        let at = BodyPointer(resident.place);
        Prepared {
            resident: Some(Box::new(resident)),
            build: move || {
                let at = at;
                // SAFETY: the resident outlives the body. The body is dropped before the record
                // shows that the process has ended; or the record shows that it was left, and the
                // resident stays for ever. The resident does not touch the process in between. So
                // this is the only access while the body lives.
                let process: &'static mut P = unsafe { &mut *at.0 };
                process.run()
            },
        }
    }
}

/// A process that is ready to be started.
#[doc(hidden)]
pub struct Prepared<B> {
    pub(crate) resident: Option<Box<dyn Phases>>,
    pub(crate) build: B,
}

/// Makes a body on the thread that it is to run on.
#[doc(hidden)]
pub trait Build: Send + 'static {
    /// The body.
    type Body: Future<Output = Result<()>> + 'static;

    /// Makes it.
    fn build(self) -> Self::Body;
}

impl<B, F> Build for B
where
    B: FnOnce() -> F + Send + 'static,
    F: Future<Output = Result<()>> + 'static,
{
    type Body = F;

    fn build(self) -> F {
        self()
    }
}

impl<B: Build> Prepared<B> {
    /// Behind a box, for where its type is not known.
    pub(crate) fn boxed(self) -> Prepared<Box<dyn Start>> {
        Prepared {
            resident: self.resident,
            build: Box::new(self.build),
        }
    }
}

impl<B> fmt::Debug for Prepared<B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Prepared").finish_non_exhaustive()
    }
}

/// The phases around the body.
pub(crate) trait Phases: Send {
    fn pre_run(&mut self) -> Result<()>;
    fn post_run(&mut self);
    /// As [`words_of_body`](luna_executors::ProcessHandle::words_of_body), of what the body
    /// borrows.
    fn words(&self) -> Vec<usize>;
}

/// Runs `pre_run`. Its panic is an error as any other.
pub(crate) fn prepare(resident: &mut dyn Phases) -> Result<()> {
    panics::catch(|| resident.pre_run())
        .unwrap_or_else(|payload| Err(Error::Panicked(luna_executors::panic_message(&*payload))))
}

/// Runs `post_run`, then drops the process. It is the user's code: a panic in it, which the panic
/// hook reports, must not keep the other processes from being cleaned up. Returns the panic.
pub(crate) fn clean_up(resident: Option<Box<dyn Phases>>) -> Option<Error> {
    let mut resident = resident?;
    let cleaned_up = panics::catch(move || {
        resident.post_run();
        drop(resident);
    });
    let payload = cleaned_up.err()?;
    let message = luna_executors::panic_message(&*payload);
    // It is the user's too.
    std::mem::forget(payload);
    Some(Error::Panicked(message))
}

/// A process at a fixed place, which its body borrows.
///
/// # Invariants
///
/// `place` came from a box and is freed by this value's drop alone. While a body lives, the body
/// alone accesses it.
struct Resident<P> {
    place: *mut P,
    _owned: PhantomData<P>,
}

// SAFETY: it owns its process as a box would.
unsafe impl<P: Send> Send for Resident<P> {}

impl<P> Resident<P> {
    fn new(process: P) -> Self {
        Self {
            place: Box::into_raw(Box::new(process)),
            _owned: PhantomData,
        }
    }
}

impl<P: Process + Send> Phases for Resident<P> {
    fn pre_run(&mut self) -> Result<()> {
        // SAFETY: called before there is a body.
        unsafe { &mut *self.place }.pre_run()
    }

    fn post_run(&mut self) {
        // SAFETY: called after the body has ended, or when there was none.
        unsafe { &mut *self.place }.post_run();
    }

    fn words(&self) -> Vec<usize> {
        // The body may be accessing it: only the address is used, and the kernel copies.
        let start = self.place.addr();
        copy_words(start..start + size_of::<P>())
    }
}

impl<P> Drop for Resident<P> {
    fn drop(&mut self) {
        // SAFETY: the framework drops a resident only when its body has ended or was never made.
        drop(unsafe { Box::from_raw(self.place) });
    }
}

/// A pointer that goes to the executor's thread.
struct BodyPointer<P>(*mut P);
// SAFETY: it leads to a `P: Send` that one thread at a time accesses.
unsafe impl<P: Send> Send for BodyPointer<P> {}

/// Starts a body of any type where it is to run, so that polling it goes through no virtual call.
pub(crate) trait Start: Send {
    fn on_executor(
        self: Box<Self>,
        executor: &ExecutorHandle,
        spec: ProcessSpec,
        frame: Frame,
    ) -> (Announced, ProcessHandle);

    fn on_thread(
        self: Box<Self>,
        attributes: Attributes,
        spec: ProcessSpec,
        simulation: Option<&SimulationHandle>,
        frame: Frame,
    ) -> Result<OsThread, SpawnError<Infallible>>;
}

/// Announces a body on an executor.
pub(crate) fn announce<B: Build>(
    build: B,
    executor: &ExecutorHandle,
    spec: ProcessSpec,
    frame: Frame,
) -> (Announced, ProcessHandle) {
    executor.announce(spec, move || Supervised::make(|| build.build(), frame))
}

impl<B: Build> Start for B {
    fn on_executor(
        self: Box<Self>,
        executor: &ExecutorHandle,
        spec: ProcessSpec,
        frame: Frame,
    ) -> (Announced, ProcessHandle) {
        // Stays in its box until then, so that it is moved no more often than one of known type.
        executor.announce(spec, move || Supervised::make(|| (*self).build(), frame))
    }

    fn on_thread(
        self: Box<Self>,
        attributes: Attributes,
        spec: ProcessSpec,
        simulation: Option<&SimulationHandle>,
        frame: Frame,
    ) -> Result<OsThread, SpawnError<Infallible>> {
        let registry = frame.common.registry.clone();
        let build = move || Supervised::make(|| (*self).build(), frame);
        match simulation {
            None => OsThread::start_counted(attributes, spec, build, registry),
            Some(simulation) => Ok(OsThread::start_simulated(
                simulation,
                &attributes,
                spec,
                build,
            )),
        }
    }
}

/// What the bodies of one system have in common.
pub(crate) struct Common {
    pub(crate) scope: Arc<Scope>,
    pub(crate) emergency: Arc<Emergency>,
    pub(crate) tree: Arc<Tree>,
    pub(crate) registry: Arc<ProcessRegistry>,
    pub(crate) clock: Clock,
    pub(crate) log: Log,
    pub(crate) replay_logs: ReplayLogs,
}

thread_local! {
    /// What the bodies of this thread have in common, once there is one.
    static ENTERED: RefCell<Option<Arc<Common>>> = const { RefCell::new(None) };
    /// What those that have begun were brought of it.
    static SPARE_COMMON: ArcCache<Common> = const { ArcCache::new() };
}

impl Common {
    /// Makes this what the calling thread's bodies have in common.
    fn enter_thread(self: &Arc<Self>) {
        let is_entered = |entered: &Option<Arc<Self>>| {
            let entered = entered.as_ref();
            entered.is_some_and(|there| Arc::ptr_eq(there, self))
        };
        if ENTERED.with_borrow(is_entered) {
            return;
        }
        self.scope.enter_thread();
        self.tree.enter_thread();
        self.emergency.enter_thread();
        self.log.enter_thread();
        ThreadUsage::prepare_thread();
        SPARE_COMMON.with(|spare| spare.keep(self));
        ENTERED.set(Some(self.clone()));
    }

    /// What the bodies of this thread have in common, of which the caller is one.
    fn with(f: impl FnOnce(&Self)) {
        // The reference is one more, since what is done with it is done without the borrow.
        let entered = ENTERED.try_with(|entered| entered.borrow().clone());
        if let Ok(Some(common)) = entered {
            f(&common);
        }
    }
}

/// What the framework gives a body on its way: on its thread it finds the same by itself.
pub(crate) struct Frame {
    /// Given back with the frame.
    common: ManuallyDrop<Arc<Common>>,
}

impl Frame {
    pub(crate) fn new(common: &Arc<Common>) -> Self {
        Self {
            common: ManuallyDrop::new(SPARE_COMMON.with(|spare| spare.another(common))),
        }
    }
}

/// A frame may go to any thread because of this.
const _: () = {
    const fn shared<T: Send + Sync>() {}
    shared::<Arc<Common>>();
};

impl Drop for Frame {
    fn drop(&mut self) {
        // SAFETY: it is not used any more.
        let common = unsafe { ManuallyDrop::take(&mut self.common) };
        // A thread that is ending keeps none any more.
        let _ = SPARE_COMMON.try_with(move |spare| spare.give_back(common));
    }
}

/// How a body ended, if it was not cancelled and did not panic; nothing if it returned without an
/// error.
pub(crate) struct Verdict(pub(crate) Option<Ended>);

impl Verdict {
    /// On the current process. Apart, so that a turn which ends nothing has no room for what ends
    /// do.
    #[cold]
    #[inline(never)]
    fn of(ended: Result<Result<()>, Failure>) -> Self {
        let ended = match ended {
            Ok(Ok(())) => return Self(None),
            Ok(Err(error)) => Ended::Returned(error),
            Err(failure) => Ended::Failed(failure),
        };
        events::note_failure();
        // The failure is to be reported soon; the process' own end notifies only threads that wait
        // for any end.
        Common::with(|common| common.registry.announce_next());
        Self(Some(ended))
    }
}

impl ExitValue for Verdict {
    fn is_nothing(&self) -> bool {
        self.0.is_none()
    }
}

pub(crate) enum Ended {
    Returned(Error),
    Failed(Failure),
}

/// Why the framework ends a process: without allocation, since others go on.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Failure {
    Overrun { name: LoopName, consecutive: u32 },
}

impl From<Failure> for Error {
    fn from(failure: Failure) -> Error {
        match failure {
            Failure::Overrun { name, consecutive } => Error::overrun(name, consecutive),
        }
    }
}

thread_local! {
    /// That of the process which is being polled: taken after the poll, or by the [`Alarm`] if that
    /// panics.
    static FAILURE: Cell<Option<Failure>> = const { Cell::new(None) };
    /// Whether there is one: what each poll asks.
    static HAS_FAILED: Cell<bool> = const { Cell::new(false) };
}

/// Ends the current process with `failure` at its next await, which does not return.
pub(crate) async fn fail_current(failure: Failure) -> ! {
    FAILURE.set(Some(failure));
    HAS_FAILED.set(true);
    std::future::pending().await
}

/// A body with the failures that the framework finds in it. On a thread that has
/// [entered](Common::enter_thread).
pub(crate) struct Supervised<F> {
    body: ManuallyDrop<F>,
}

impl<F> Supervised<F> {
    /// Makes the body, on the thread that it is to run on.
    fn make(make: impl FnOnce() -> F, frame: Frame) -> Self {
        frame.common.enter_thread();
        frame.common.log.enter_executor();
        let alarm = Alarm;
        let body = make();
        std::mem::forget(alarm);
        Self {
            body: ManuallyDrop::new(body),
        }
    }
}

impl<F: Future<Output = Result<()>>> Future for Supervised<F> {
    type Output = Verdict;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Verdict> {
        // SAFETY: the body is pinned with the whole, and never moved.
        let body = unsafe { Pin::new_unchecked(&mut *self.get_unchecked_mut().body) };
        let alarm = Alarm;
        let polled = poll_until_failure(body, cx);
        std::mem::forget(alarm);
        match polled {
            Poll::Pending => Poll::Pending,
            Poll::Ready(ended) => {
                cold_path();
                Poll::Ready(Verdict::of(ended))
            }
        }
    }
}

impl<F> Drop for Supervised<F> {
    fn drop(&mut self) {
        if luna_executors::has_given_up() {
            // The thread panicked around the body: an emergency too, and before anything of the
            // body's has its turn.
            drop(Alarm);
        }
        // Also a panic of what a cancelled body leaves.
        let alarm = Alarm;
        // SAFETY: dropped here, in its place, and nowhere else.
        unsafe { ManuallyDrop::drop(&mut self.body) };
        std::mem::forget(alarm);
    }
}

/// A panic in a process is an emergency. The panic hook has triggered it, unless the program has
/// set another hook since, or the panic went on from another thread: then it is triggered here, as
/// the panic leaves the body.
struct Alarm;

impl Drop for Alarm {
    #[cold]
    #[inline(never)]
    fn drop(&mut self) {
        // What the panic leaves behind is no later process'.
        FAILURE.set(None);
        Common::with(|common| common.emergency.trigger_by_panic());
    }
}

#[inline(always)]
fn poll_until_failure<F: Future>(
    body: Pin<&mut F>,
    cx: &mut Context<'_>,
) -> Poll<Result<F::Output, Failure>> {
    let polled = body.poll(cx);
    // Also of a body that has ended and had the branch: the next process' poll must not find it.
    if HAS_FAILED.get() {
        cold_path();
        if let Some(failure) = take_failure() {
            return Poll::Ready(Err(failure));
        }
    }
    polled.map(Ok)
}

/// The failure of the current process, which has none from then on.
#[inline(never)]
fn take_failure() -> Option<Failure> {
    HAS_FAILED.set(false);
    FAILURE.take()
}

/// Runs `body` as a process on the calling thread, without a system around it: neither `Send` nor
/// `'static` is required.
///
/// The smallest way to run a network: a program's `main`, a test. The body may make blocking calls.
/// A panic passes through.
///
/// If it has waited for a second and nothing can wake it (no deadline, file, blocking call, channel
/// that is marked external or was used at its other end by another thread), it prints once on
/// standard error what it waits for, and waits on.
///
/// # Errors
///
/// The body's own, or [`SetupError::Nested`](crate::error::SetupError::Nested) inside a process.
///
/// ```
/// let greeting = String::from("hello");
/// let length = luna::run(async { Ok(greeting.len()) })?;
/// assert_eq!(length, 5);
/// # Ok::<(), luna::Error>(())
/// ```
pub fn run<T>(body: impl Future<Output = Result<T>>) -> Result<T> {
    let _scope = Scope::free_standing().enter_until_dropped();
    // A panic of another run may have left one behind.
    FAILURE.set(None);
    let mut body = std::pin::pin!(body);
    let body = std::future::poll_fn(|cx| poll_until_failure(body.as_mut(), cx));
    luna_executors::block_on_patiently(body, alone::PATIENCE, alone::report_if_stuck)?
        .map_err(Error::from)?
}

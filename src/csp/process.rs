//! What can be a process, and how the framework starts and ends it.

use super::failed_at::EndedAtChannels;
use super::supervised::Supervised;
use crate::csp::tree::Tree;
use crate::error::{Error, Result};
use crate::log::Log;
use crate::safety::Emergency;
use crate::time::Scope;
use luna_core::{Announced, ExecutorHandle, ProcessHandle, ProcessRegistry, ProcessSpec};
use luna_machine::memory::copy_words;
use luna_machine::usage::ThreadUsage;
use luna_platform::clock::Clock;
use luna_platform::panics;
use luna_replay::session::ReplayLogs;
use std::cell::RefCell;
use std::future::Future;
use std::marker::PhantomData;
use std::sync::Arc;

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
    fn prepare(self) -> Prepared;
}

impl<F: Future<Output = Result<()>> + Send + 'static> IntoProcess<ViaFuture> for F {
    fn prepare(self) -> Prepared {
        Prepared::of(None, move || self)
    }
}

impl<C, F> IntoProcess<ViaClosure> for C
where
    C: FnOnce() -> F + Send + 'static,
    F: Future<Output = Result<()>> + 'static,
{
    fn prepare(self) -> Prepared {
        Prepared::of(None, self)
    }
}

impl<P: Process + Send + 'static> IntoProcess<ViaProcess> for P {
    fn prepare(self) -> Prepared {
        let resident = Resident::new(self);
        let at = BodyPointer(resident.place);
        Prepared::of(Some(Box::new(resident)), move || {
            let at = at;
            // The body is dropped before the record shows that the process has ended; or the
            // record shows that it was left, and the resident stays for ever.
            // SAFETY: so the resident outlives the body, and does not touch the process
            // meanwhile: this is the only access while the body lives.
            let process: &'static mut P = unsafe { &mut *at.0 };
            process.run()
        })
    }
}

/// A process that is ready to be started.
#[doc(hidden)]
pub struct Prepared {
    pub(crate) resident: Option<Box<dyn Phases>>,
    pub(crate) start: Box<dyn Start>,
}

impl Prepared {
    /// `build` makes the body on the thread that it is to run on.
    fn of<B, F>(resident: Option<Box<dyn Phases>>, build: B) -> Self
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output = Result<()>> + 'static,
    {
        let start = Box::new(build);
        Self { resident, start }
    }

    /// One that is to be replaced by another before it starts.
    pub(crate) fn nothing() -> Self {
        Self::of(None, async || Ok(()))
    }
}

luna_platform::debug_fields!(Prepared);

/// The phases around the body.
pub(crate) trait Phases: Send {
    fn pre_run(&mut self) -> Result<()>;
    fn post_run(&mut self);
    /// The machine words of what the body
    /// borrows, some of which are addresses.
    fn words(&self) -> Vec<usize>;
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
    let message = luna_core::panic_message(&*payload);
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

/// Announces a body of any type on an executor, so that polling it goes through no virtual call.
pub(crate) trait Start: Send {
    fn announce(
        self: Box<Self>,
        executor: &ExecutorHandle,
        spec: ProcessSpec,
        common: &Arc<Common>,
    ) -> (Announced, ProcessHandle);
}

impl<B, F> Start for B
where
    B: FnOnce() -> F + Send + 'static,
    F: Future<Output = Result<()>> + 'static,
{
    fn announce(
        self: Box<Self>,
        executor: &ExecutorHandle,
        spec: ProcessSpec,
        common: &Arc<Common>,
    ) -> (Announced, ProcessHandle) {
        // A thread that has entered it needs no reference to make the bodies of its own executor.
        let is_entered = executor.is_here() && common.is_entered();
        let common = (!is_entered).then(|| common.clone());
        executor.announce(spec, move || Supervised::make(*self, common.as_ref()))
    }
}

/// What the bodies of one system have in common.
pub(crate) struct Common {
    pub(crate) scope: Arc<Scope>,
    pub(crate) emergency: Arc<Emergency>,
    pub(crate) tree: Arc<Tree>,
    pub(crate) registry: Arc<ProcessRegistry>,
    pub(crate) clock: Clock,
    pub(crate) ended_at: EndedAtChannels,
    pub(crate) log: Log,
    pub(crate) replay_logs: ReplayLogs,
}

thread_local! {
    /// What the bodies of this thread have in common, once there is one.
    static ENTERED: RefCell<Option<Arc<Common>>> = const { RefCell::new(None) };
}

impl Common {
    /// Runs `pre_run` where loops and signals that are made are the system's. Its panic is an error
    /// as any other.
    pub(crate) fn prepare(&self, resident: &mut dyn Phases) -> Result<()> {
        let _scope = self.scope.clone().enter_until_dropped(true);
        let _log = self.log.enter();
        panics::catch(|| resident.pre_run())
            .unwrap_or_else(|payload| Err(Error::Panicked(luna_core::panic_message(&*payload))))
    }

    /// Whether this is what the calling thread's bodies have in common.
    fn is_entered(&self) -> bool {
        ENTERED.with_borrow(|entered| {
            let entered = entered.as_deref();
            entered.is_some_and(|there| std::ptr::eq(there, self))
        })
    }

    /// Makes this what the calling thread's bodies have in common.
    pub(super) fn enter_thread(self: &Arc<Self>) {
        if self.is_entered() {
            return;
        }
        self.scope.enter_thread();
        self.tree.enter_thread();
        self.emergency.enter_thread();
        self.log.enter_thread();
        ThreadUsage::prepare_thread();
        ENTERED.set(Some(self.clone()));
    }

    /// What the bodies of this thread have in common, of which the caller is one.
    pub(super) fn with(f: impl FnOnce(&Self)) {
        // The reference is one more, since what is done with it is done without the borrow.
        let entered = ENTERED.try_with(|entered| entered.borrow().clone());
        if let Ok(Some(common)) = entered {
            f(&common);
        }
    }
}

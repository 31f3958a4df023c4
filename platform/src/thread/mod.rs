//! Threads that have their attributes before user code runs on them.
//!
//! [`spawn`] makes a thread with a name, a core, a policy and a stack that is in memory already,
//! runs its set-up on it, and returns only then. What was set is read back: a thread that reports
//! `fifo:80` runs at it. What the system refuses is an error under [`Mode::Strict`] and a
//! [`Refusal`] in [`Obtained`] under [`Mode::BestEffort`].
//!
//! Nothing is inherited by accident:
//!
//! - A real-time thread made here has `SCHED_RESET_ON_FORK`, so that a helper thread which a
//!   library starts on it is an ordinary one.
//! - A thread made here sets its policy and its core mask itself, independent of the thread that
//!   made it: unpinned threads get the mask that the process had before the first thread was made
//!   here. (A helper thread that a *library* starts on a pinned thread is pinned too: the kernel
//!   offers no reset for that.)
//! - A thread made here blocks SIGINT, SIGTERM, SIGHUP and SIGQUIT, so that no handler of those
//!   interrupts a real-time thread.
//! - A thread made here has a stack of its own for signal handlers, so that a thread that has used
//!   up its stack still runs the emergency functions.
//! - Every thread made here sleeps with a slack of 1 ns: without a real-time policy Linux else adds
//!   50 µs to each sleep.
//!
//! None of this is for the real-time path: it allocates, and takes as long as the system takes to
//! make a thread.

mod attributes;
mod policy;
mod refusal;

pub use attributes::{
    AttributeError, Attributes, DEFAULT_STACK_SIZE, MAXIMUM_STACK_SIZE, MINIMUM_STACK_SIZE, Mode,
    Obtained,
};
pub use policy::{EMERGENCY_PRIORITY, HIGHEST_USER_PRIORITY, Policy, PolicyError, TIMER_PRIORITY};

pub use refusal::{Refusal, SpinRefusal, Why};

pub use crate::backend::thread::HandlerStack;

use crate::backend::thread as backend;
use crate::panics;
use std::convert::Infallible;
use std::io;
use std::sync::mpsc;
use std::thread::{Builder, JoinHandle};

/// Makes a thread, gives it `attributes`, runs `setup` on it, then `body` with what the set-up
/// made.
///
/// Returns when the set-up has ended; the body runs from then on. What the set-up makes stays on
/// the thread, so it need not be `Send`. Not for the real-time path: makes a thread and waits for
/// it.
///
/// # Errors
///
/// [`SpawnError`] reports which step failed: the attributes are bad, the system made no thread, it
/// refused an attribute under [`Mode::Strict`], or the set-up failed or panicked. The thread has
/// then ended, and `body` was dropped without having run.
///
/// ```
/// use luna_platform::thread::{Attributes, spawn};
/// use std::rc::Rc;
///
/// let thread = spawn(
///     Attributes::new("adder"),
///     |obtained| {
///         assert_eq!(obtained.core, None);
///         Ok::<_, std::io::Error>(Rc::new(40)) // not `Send`: it stays there
///     },
///     |number| *number + 2,
/// )?;
/// assert_eq!(thread.name(), "adder");
/// assert_eq!(thread.join().expect("the body does not panic"), 42);
/// # Ok::<(), luna_platform::thread::SpawnError<std::io::Error>>(())
/// ```
pub fn spawn<S, E, T>(
    attributes: Attributes,
    setup: impl FnOnce(&Obtained) -> Result<S, E> + Send + 'static,
    body: impl FnOnce(S) -> T + Send + 'static,
) -> Result<Thread<T>, SpawnError<E>>
where
    E: Send + 'static,
    T: Send + 'static,
{
    attributes.validate().map_err(SpawnError::Attributes)?;
    backend::remember_process();
    let name = attributes.name.clone();
    let (report, reported) = mpsc::sync_channel(1);
    let handle = Builder::new()
        .name(name.clone())
        .stack_size(attributes.stack_size)
        .spawn(move || {
            backend::begin();
            let _signals = HandlerStack::here();
            let started = backend::apply(&attributes)
                .map_err(SpawnError::Refused)
                .and_then(|obtained| {
                    setup(&obtained)
                        .map(|made| (obtained, made))
                        .map_err(SpawnError::SetUp)
                });
            // The maker waits for the report; if it has ended, no thread needs the report.
            let (outcome, made) = match started {
                Ok((obtained, made)) => (Ok(obtained), Some(made)),
                Err(error) => (Err(error), None),
            };
            let _ = report.send(outcome);
            drop(report);
            made.map(body)
        })
        .map_err(|error| SpawnError::NoThread {
            name: name.clone(),
            error,
        })?;
    match reported.recv() {
        Ok(Ok(obtained)) => Ok(Thread {
            name,
            obtained,
            handle,
        }),
        Ok(Err(error)) => {
            // It is about to end. Waiting for it frees its stack before the caller tries again.
            let _ = handle.join();
            Err(error)
        }
        // Only a panic ends the thread without a report.
        Err(mpsc::RecvError) => {
            let message = handle.join().map_or_else(
                |panic| {
                    panics::text(&*panic)
                        .unwrap_or("a panic without a message")
                        .to_owned()
                },
                |_| String::new(),
            );
            Err(SpawnError::SetUpPanicked { name, message })
        }
    }
}

/// Gives the calling thread `attributes`, except that its stack stays as large as it is:
/// `stack_size` bytes of it are touched, as far as it has them.
///
/// For a thread that was made elsewhere: the main thread of a measuring tool, for instance. Its
/// signal mask is not changed, and the main thread keeps its name, since that is the whole
/// program's. There is no way back but to ask for [`Policy::Other`] and no core. Not for the
/// real-time path: O(stack) page faults and some ten system calls.
///
/// # Errors
///
/// The attributes are bad, or, under [`Mode::Strict`], refused. The thread may then have some of
/// them: the name and the core are set before the policy.
///
/// ```
/// use luna_platform::thread::{Attributes, Policy, apply_to_current, current_policy};
///
/// let obtained = apply_to_current(&Attributes::new("me").policy(Policy::fifo(10)))?;
/// assert_eq!(obtained.policy, current_policy());
/// for refusal in &obtained.refusals {
///     eprintln!("{refusal}");
/// }
/// # apply_to_current(&Attributes::new("me"))?;
/// # Ok::<(), luna_platform::thread::SpawnError>(())
/// ```
pub fn apply_to_current(attributes: &Attributes) -> Result<Obtained, SpawnError> {
    attributes.validate().map_err(SpawnError::Attributes)?;
    backend::remember_process();
    backend::apply(attributes).map_err(SpawnError::Refused)
}

/// The policy that the calling thread runs under, as the system says. Policies without a variant of
/// their own (batch, idle) are reported as [`Policy::Other`]. Two system calls, and a third for a
/// deadline policy.
pub use backend::current_policy;

/// The highest real-time priority that the process may have, 0 for none. The system may refuse it
/// all the same, in a container for instance. Not for the real-time path: two system calls.
///
/// ```
/// assert!(luna_platform::thread::highest_priority() <= 99);
/// ```
pub use backend::highest_priority;

/// Whether the calling thread has the capability of this bit in effect; `None` if the system does
/// not tell. One system call, which needs no file.
///
/// ```
/// use luna_platform::thread::{has_capability, highest_priority};
///
/// const CAP_SYS_NICE: u32 = 23;
/// if has_capability(CAP_SYS_NICE) == Some(true) {
///     assert_eq!(highest_priority(), 99);
/// }
/// ```
pub use backend::has_capability;

/// The core that the calling thread runs on at this moment, if the system reports it. No system
/// call with a vDSO.
pub use backend::current_core;

/// The cores that threads of this process may run on, ascending: the mask that unpinned threads
/// made here get.
///
/// That is the mask of the main thread when this crate was first asked for one or made a thread. A
/// core kept free of ordinary work (`isolcpus=`) is not among them, and can be asked for
/// nevertheless. If the system does not report it, the cores are counted from 0. Allocates; not for
/// the real-time path.
///
/// ```
/// assert!(!luna_platform::thread::available_cores().is_empty());
/// ```
pub use backend::available_cores;

/// Lets the calling thread run on all cores of the process again. One system call. Does nothing
/// where threads cannot be pinned.
///
/// ```
/// luna_platform::thread::unpin_current();
/// ```
pub use backend::unpin as unpin_current;

/// A running thread made by [`spawn`]. Dropped without [`join`](Self::join), the thread goes on by
/// itself.
#[derive(Debug)]
pub struct Thread<T> {
    name: String,
    obtained: Obtained,
    // `None` is returned only by a thread that failed to start, and that one has no handle.
    handle: JoinHandle<Option<T>>,
}

impl<T> Thread<T> {
    /// The whole name, also where the system keeps a part of it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What the thread got.
    pub fn obtained(&self) -> &Obtained {
        &self.obtained
    }

    /// Whether the body has returned or panicked. Does not wait.
    pub fn is_finished(&self) -> bool {
        self.handle.is_finished()
    }

    /// Waits until the body has ended, and gives what it returned.
    ///
    /// # Errors
    ///
    /// The panic's payload, if the body panicked.
    pub fn join(self) -> std::thread::Result<T> {
        self.handle
            .join()
            .map(|returned| returned.expect("a thread whose start succeeded ran its body"))
    }
}

/// Why a thread was not made, or did not get its attributes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpawnError<E = Infallible> {
    /// The attributes are bad on any machine.
    #[error(transparent)]
    Attributes(AttributeError),
    /// The operating system made no thread.
    #[error(
        "the system made no thread `{name}`: {error}; see the limits on threads (ulimit -u, the \
         cgroup's pids.max), on memory (ulimit -v) and on locked memory (ulimit -l)"
    )]
    NoThread {
        /// The thread's name.
        name: String,
        /// What the system said.
        #[source]
        error: io::Error,
    },
    /// The system refused an attribute under [`Mode::Strict`].
    #[error(transparent)]
    Refused(Refusal),
    /// The thread's set-up failed.
    #[error(transparent)]
    SetUp(E),
    /// The thread's set-up panicked.
    #[error("the set-up of thread `{name}` panicked: {message}")]
    SetUpPanicked {
        /// The thread's name.
        name: String,
        /// The panic's words.
        message: String,
    },
}

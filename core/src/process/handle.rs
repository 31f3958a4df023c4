//! What a process is to be, and its handle: its name, state and end, as others see them.

use super::end::ExitValue;
use super::join::{self, Join};
use super::monitor::{PollMonitor, Timing};
use super::{LEVELS, Name, ProcessId, ProcessRef, ProcessState};
use crate::replay_log::LogInstaller;
use alloc::borrow::ToOwned;
use alloc::boxed::Box;
use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::any::Any;
use core::fmt;
#[cfg(feature = "std")]
use core::ops::Range;
use core::time::Duration;

/// What a process is to be: its name, its level, and its poll monitor.
#[derive(Debug)]
pub struct ProcessSpec {
    pub(super) id: ProcessId,
    pub(super) name: Name,
    pub(super) level: u8,
    pub(super) is_listed: bool,
    pub(super) is_unhurried: bool,
    pub(super) timing: Option<Box<Timing>>,
}

impl ProcessSpec {
    /// The level of a process for which none was stated: the middle.
    pub const DEFAULT_LEVEL: u8 = 16;

    /// A process called `name`, at [`DEFAULT_LEVEL`](Self::DEFAULT_LEVEL).
    #[inline]
    pub fn new(name: impl Into<Name>) -> Self {
        Self {
            id: ProcessId::new(),
            name: name.into(),
            level: Self::DEFAULT_LEVEL,
            is_listed: false,
            is_unhurried: false,
            timing: None,
        }
    }

    /// The name that the process will have.
    #[inline]
    pub fn name(&self) -> &Name {
        &self.name
    }

    /// The number that the process will have.
    #[inline]
    pub fn id(&self) -> ProcessId {
        self.id
    }

    /// The level that the process will have.
    pub fn priority(&self) -> u8 {
        self.level
    }

    /// At `level`, 0 (lowest) to 31; a greater one counts as 31.
    #[must_use]
    #[inline]
    pub fn level(mut self, level: u8) -> Self {
        self.level = level.min(LEVELS - 1);
        self
    }

    /// Measures how long each poll takes, at two clock reads a poll (about 50 ns).
    #[must_use]
    pub fn timed(mut self, timed: bool) -> Self {
        if timed || self.timing.is_some() {
            self.timing().asked = timed;
        }
        self
    }

    /// Lists the process when it has ended, for
    /// [`ProcessRegistry::take_ended`](super::ProcessRegistry::take_ended).
    #[must_use]
    #[inline]
    pub fn listed(mut self) -> Self {
        self.is_listed = true;
        self
    }

    /// Makes its end unhurried, if it completes without an exit value: see
    /// [`ProcessRegistry::rest`](super::ProcessRegistry::rest).
    #[must_use]
    #[inline]
    pub fn unhurried(mut self) -> Self {
        self.is_unhurried = true;
        self
    }

    /// Lets `poll_monitor` look at each poll, which costs two clock reads and what it does itself.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use luna_core::{Executor, Exit, PollMonitor, ProcessSpec, Verdict, yield_now};
    /// use luna_platform::{clock::Instant, thread::Attributes};
    /// use std::sync::Arc;
    /// use std::time::Duration;
    ///
    /// struct AtMost(Duration);
    /// impl PollMonitor for AtMost {
    ///     fn poll_begins(&self, _: Instant) {}
    ///     fn poll_ends(&self, began: Instant, now: Instant) -> Verdict {
    ///         if now - began > self.0 { Verdict::Poison } else { Verdict::GoOn }
    ///     }
    /// }
    ///
    /// let executor = Executor::start(Attributes::new("main"))?;
    /// let hog = ProcessSpec::new("hog").monitored(Arc::new(AtMost(Duration::from_millis(5))));
    /// let hog = executor.spawn(hog, || async {
    ///     std::thread::sleep(Duration::from_millis(6));
    ///     yield_now().await;
    ///     unreachable!("it has been ended");
    /// });
    /// executor.release();
    /// assert_eq!(hog.wait(), Exit::Cancelled);
    /// # Ok(()) }
    /// ```
    #[must_use]
    pub fn monitored(mut self, poll_monitor: Arc<dyn PollMonitor>) -> Self {
        self.timing().poll_monitor = Some(poll_monitor);
        self
    }

    /// Lets `log_installer` install the process' [replay log](crate::replay_log) around each of
    /// its polls. Processes without one pay nothing.
    #[doc(hidden)]
    #[must_use]
    pub fn with_replay_log(mut self, log_installer: Arc<dyn LogInstaller>) -> Self {
        self.timing().log_installer = Some(log_installer);
        self
    }

    fn timing(&mut self) -> &mut Timing {
        self.timing.get_or_insert_default()
    }
}

/// How a process ended.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Exit {
    /// Its body returned. In a system of luna-rt that may have been an error, which is part of what
    /// its `run` returns.
    Completed,
    /// It was cancelled: its body was dropped where it waited.
    Cancelled,
    /// Its body panicked, with this message.
    Panicked(String),
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Exit::Completed => f.write_str("completed"),
            Exit::Cancelled => f.write_str("cancelled"),
            Exit::Panicked(message) => write!(f, "panicked: {message}"),
        }
    }
}

/// A process, seen from outside. Cloning it is cheap; dropping it does nothing to the process.
///
/// It keeps the memory of the process, also when that has ended: one allocation, with the room of
/// the body.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use luna_core::{Executor, Exit, ProcessSpec, ProcessState};
/// use luna_platform::thread::Attributes;
///
/// let executor = Executor::start(Attributes::new("work"))?;
/// let process = executor.spawn(ProcessSpec::new("greeter").level(20), || async { println!("hello") });
/// executor.release();
/// assert_eq!(process.wait(), Exit::Completed);
/// assert_eq!((process.name(), process.priority(), process.polls()), ("greeter", 20, 1));
/// assert_eq!(process.state(), ProcessState::Ended);
/// executor.stop();
/// # Ok(()) }
/// ```
#[derive(Clone)]
pub struct ProcessHandle(pub(crate) ProcessRef);

// What it shows is atomic, or behind a lock under which no user code runs.
impl core::panic::UnwindSafe for ProcessHandle {}
impl core::panic::RefUnwindSafe for ProcessHandle {}

impl ProcessHandle {
    /// The process' name.
    pub fn name(&self) -> &str {
        &self.0.record.name
    }

    /// The process' number.
    pub fn id(&self) -> ProcessId {
        self.0.id()
    }

    /// The level on its executor, 0 (lowest) to 31.
    #[inline]
    pub fn priority(&self) -> u8 {
        self.0.own_priority().level
    }

    /// What the process was doing at some instant during this call.
    pub fn state(&self) -> ProcessState {
        self.0.activity()
    }

    /// How often it has been polled: how often it was given the processor.
    pub fn polls(&self) -> u64 {
        self.0.polls()
    }

    /// The longest time between two awaits, if its polls are timed ([`ProcessSpec::timed`]) and it
    /// has run.
    pub fn longest_poll(&self) -> Option<Duration> {
        let longest = self.0.longest_poll()?;
        (self.polls() > 0).then(|| Duration::from_nanos(longest))
    }

    /// Requests the end of the process: its body is dropped on its own thread, where it waits, as
    /// soon as that thread comes to it.
    ///
    /// What it waited for is withdrawn. A body that computes or blocks without awaiting ends at its
    /// next await. Does nothing to one that has ended. Real-time path: yes; O(1), a system call
    /// only if its thread sleeps.
    pub fn cancel(&self) {
        self.0.cancel();
    }

    /// Waits until the process has ended, and returns how. Cancel-safe. Real-time path: yes, but
    /// for the message of a panic, which is allocated here.
    pub fn join(&self) -> Join<'_> {
        Join::new(&self.0)
    }

    /// Blocks this thread until the process has ended, and returns how. Not for processes of an
    /// executor: they [`join`](Self::join).
    pub fn wait(&self) -> Exit {
        crate::park::block_on(self.join())
    }

    /// The processes that wait in a [`join`](Self::join) for its end. Not for the real-time path:
    /// it allocates.
    pub fn joiners(&self) -> Vec<ProcessId> {
        join::joiners(&self.0)
    }

    /// The addresses of its body, while there is one that the process holds in place: where a
    /// report may look for what the body holds. The body runs or goes meanwhile: nothing may be
    /// read there but by the kernel.
    #[cfg(feature = "std")]
    pub fn addresses_of_body(&self) -> Option<Range<usize>> {
        let range = &self.0.methods().of_body.range;
        let start = core::ptr::from_ref(&*self.0).addr();
        (!self.0.has_ended()).then(|| start + range.start..start + range.end)
    }

    /// The exit value of its body, if it is of this type and was not taken before. What is not
    /// taken is dropped with the last handle. Off the real-time path: it may free; O(1).
    #[inline]
    pub fn take_exit_value<O: ExitValue>(&self) -> Option<O> {
        self.0.take_exit_value()
    }

    /// The name itself, for a table of names.
    #[doc(hidden)]
    #[inline]
    pub fn as_name(&self) -> &Name {
        &self.0.record.name
    }

    /// Lets go of the room of its body, if it has ended and that room is large: for a handle that
    /// is kept for long. An exit value is to be taken before. Not for the real-time path: it may
    /// allocate.
    pub fn forget_body(&mut self) {
        if let Some(rest) = self.0.without_body() {
            self.0 = rest;
        }
    }

    /// How it ended, if it has.
    #[inline]
    pub fn exit(&self) -> Option<Exit> {
        self.0.exit()
    }
}

luna_platform::debug_fields!(
    ProcessHandle,
    |handle| name: handle.name(), id: handle.id().get(), level: handle.priority(),
    state: handle.state()
);

/// The message of a panic.
pub fn panic_message(payload: &(dyn Any + Send)) -> String {
    let text = luna_platform::panics::text(payload);
    text.unwrap_or("(a panic whose message is no text)")
        .to_owned()
}

//! The part of a process that outlives its body: its name, its counters, and how it ended.

mod end;
mod reference;
mod shown;

pub(crate) use end::RawExit;
pub(crate) use reference::RecordRef;
pub(in crate::process) use shown::Shown;

use crate::biased_lock::BiasedLock;
use crate::current::{Here, LEVELS, Process, ProcessId};
use crate::deferred_free::Retired;
use crate::process::poll_monitor::{self, PollMonitor, Verdict};
use crate::process::registry::ProcessRegistry;
use crate::process::{Name, ProcessSpec, ProcessState};
use crate::replay_log::LogInstaller;
use crate::{events, path};
use alloc::boxed::Box;
use alloc::sync::Arc;
use core::ops::Range;
use core::ptr::NonNull;
pub(in crate::process) use end::Outcome;
use luna_platform::clock::Instant;
use luna_platform::sync::plain::{AtomicBool, AtomicPtr, AtomicU8, AtomicU32, AtomicU64, Ordering};
use reference::free_boxed;
use shown::Seen;

/// Flags for the end of a process, stored beside its level.
pub(in crate::process) struct How;

impl How {
    /// The bits of the level.
    pub(in crate::process) const LEVEL: u8 = LEVELS - 1;
    /// Its end is listed.
    pub(in crate::process) const LISTED: u8 = 1 << 5;
    pub(in crate::process) const UNHURRIED: u8 = 1 << 6;
}

/// Causes for an executor to check a process before it polls it.
pub(crate) struct Notice;

impl Notice {
    pub(crate) const CANCELLED: u8 = 1;
    pub(crate) const TIMED: u8 = 2;
    pub(crate) const ENDED: u8 = 4;
    /// Its turns are traced: see [`events`].
    pub(crate) const TRACED: u8 = 8;
}

/// The part of a process that outlives its body: the head of a task, or in a box.
///
/// # Invariants
///
/// `references` counts the [`RecordRef`]s, and what else keeps the memory that the record lies in:
/// for a task its wakers, and one for its process. Without any, `retired` frees that memory.
#[repr(C)]
pub(crate) struct Record {
    /// First, so that a pointer to it is one to the record. Its link is that of the list of what is
    /// not built yet, and later of the list of what has ended.
    retired: Retired,
    pub(crate) name: Name,
    seen: Seen,
    /// If its polls are timed, also if only the poll monitor needs that.
    timing: Option<Box<Timing>>,
    references: AtomicU32,
    pub(crate) id: ProcessId,
    /// Its level, and [how](How) it ends.
    level_and_how: u8,
    /// One of [`Outcome`].
    outcome: AtomicU8,
    pub(in crate::process) cancelled: AtomicBool,
    /// It was ended by its poll monitor.
    is_poisoned: AtomicBool,
    /// The process' own thread takes it without atomics, unless others look at the process too.
    pub(in crate::process) shown: BiasedLock<Shown>,
}

/// What is done around each poll of a process with timed polls, or with a replay log.
pub(in crate::process) struct Timing {
    pub(in crate::process) poll_monitor: Option<Arc<dyn PollMonitor>>,
    pub(in crate::process) log_installer: Option<Arc<dyn LogInstaller>>,
    /// The polls are timed also without a monitor.
    pub(in crate::process) asked: bool,
    /// Written by the process' thread alone, as the next field.
    longest_poll: AtomicU64,
    /// When the poll began that is under way and not [ended](Record::end_poll) yet, else never.
    began: AtomicU64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            poll_monitor: None,
            log_installer: None,
            asked: false,
            longest_poll: AtomicU64::new(0),
            began: AtomicU64::new(Instant::NEVER.as_nanos()),
        }
    }
}

luna_platform::debug_fields!(Timing, |timing| asked: timing.asked);

impl Record {
    /// The record of a process that counts as living, with so many references, in memory that
    /// `free` frees. `is_on_executor`: the calling thread is the executor that it is to run on.
    #[inline]
    pub(crate) fn new(
        spec: ProcessSpec,
        registry: &ProcessRegistry,
        is_on_executor: bool,
        references: u32,
        free: unsafe fn(NonNull<Retired>),
    ) -> Self {
        registry.enter();
        let shown = Shown::nothing();
        path::name_process(spec.id, &spec.name);
        events::report(events::code::SPAWNED, spec.id.get(), || {
            [events::current_process(), 0]
        });
        Self {
            retired: Retired::new(free),
            references: AtomicU32::new(references),
            name: spec.name,
            id: spec.id,
            level_and_how: spec.level_and_how,
            outcome: AtomicU8::new(Outcome::NONE),
            cancelled: AtomicBool::new(false),
            is_poisoned: AtomicBool::new(false),
            seen: Seen::nothing(),
            shown: if is_on_executor {
                BiasedLock::biased_in(Here::now(), shown)
            } else {
                BiasedLock::new(shown)
            },
            timing: spec.timing,
        }
    }

    /// What is known of a process that has ended, in memory without the room of its body; `None` if
    /// there is more to know than is copied.
    pub(in crate::process) fn without_body(&self) -> Option<Self> {
        let outcome = match self.outcome.load(Ordering::Acquire) {
            Outcome::COMPLETED | Outcome::WITH_VALUE => Outcome::COMPLETED,
            Outcome::CANCELLED => Outcome::CANCELLED,
            _ => return None,
        };
        let (name, level) = (self.name.clone(), self.level());
        let has_more = self.timing.is_some();
        (!has_more).then(|| Self::of_ended(self.id, name, level, outcome, self.polls()))
    }

    /// See [`ProcessHandle::completed`](crate::ProcessHandle::completed).
    #[inline]
    pub(in crate::process) fn completed(&self) -> Option<(Name, u64)> {
        let has_more = self.outcome.load(Ordering::Acquire) != Outcome::COMPLETED;
        if has_more || self.timing.is_some() {
            return None;
        }
        Some((self.name.clone(), self.seen.last_polls()?))
    }

    /// That of a process that has ended, in memory of its own, with one reference.
    pub(in crate::process) fn of_ended(
        id: ProcessId,
        name: Name,
        level: u8,
        outcome: u8,
        polls: u64,
    ) -> Self {
        Self {
            retired: Retired::new(free_boxed),
            name,
            seen: Seen::gone(polls),
            timing: None,
            references: AtomicU32::new(1),
            id,
            level_and_how: level,
            outcome: AtomicU8::new(outcome),
            cancelled: AtomicBool::new(outcome == Outcome::CANCELLED),
            is_poisoned: AtomicBool::new(false),
            shown: BiasedLock::new(Shown::nothing()),
        }
    }

    /// Counts one more reference, for a caller that has one.
    #[inline]
    pub(crate) fn count_one_more(&self) {
        // Relaxed: code that has a reference may pass it on, and provides the ordering that this
        // needs itself.
        if self.references.fetch_add(1, Ordering::Relaxed) > i32::MAX as u32 {
            // So many were leaked: to wrap would be to free what is owned.
            luna_platform::panics::abort();
        }
    }

    /// Counts so many references less; after the last, frees the memory by `free`.
    ///
    /// # Safety
    ///
    /// They were counted for the caller, which does not use the record any more. The pointer may be
    /// used for all of the memory that the record lies in. `free` is
    /// [`retire`](crate::deferred_free::retire), or off the real-time path
    /// [`free`](crate::deferred_free::free).
    #[inline]
    pub(crate) unsafe fn count_less(
        this: NonNull<Self>,
        count: u32,
        free: unsafe fn(NonNull<Retired>),
    ) {
        // SAFETY: the caller promises that the references were counted for it, so the record is
        // live until they are not. Without any no other code uses it, and the pointer may be used
        // for all of its memory, as freeing requires. AcqRel, and no fence, which ThreadSanitizer
        // does not know: the thread that frees the memory does so after all that others did with
        // it. A thread with the only references is alone with it: looking costs less than counting.
        unsafe {
            let references = &this.as_ref().references;
            if references.load(Ordering::Acquire) == count
                || references.fetch_sub(count, Ordering::AcqRel) == count
            {
                free(this.cast());
            }
        }
    }

    /// The link of the lists that the record may be in.
    pub(crate) fn link(&self) -> &AtomicPtr<Retired> {
        self.retired.link()
    }

    fn has_ended_in_a_hurry(&self) -> bool {
        let outcome = self.outcome.load(Ordering::Relaxed);
        !self.is(How::UNHURRIED) || matches!(outcome, Outcome::CANCELLED | Outcome::PANICKED)
    }

    #[inline]
    pub(crate) fn level(&self) -> u8 {
        self.level_and_how & How::LEVEL
    }

    fn is(&self, how: u8) -> bool {
        self.level_and_how & how != 0
    }

    #[inline]
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Acquire)
    }

    /// What its executor is to look at before its first poll.
    pub(crate) fn notices(&self) -> u8 {
        let cancelled = self.is_cancelled();
        let timed = if self.timing.is_some() {
            Notice::TIMED
        } else {
            0
        };
        let traced = if events::is_on() { Notice::TRACED } else { 0 };
        timed | traced | if cancelled { Notice::CANCELLED } else { 0 }
    }

    /// Whether the body has ended.
    #[inline]
    pub(crate) fn has_ended(&self) -> bool {
        self.outcome.load(Ordering::Acquire) != Outcome::NONE
    }

    /// There is one if its polls are timed.
    fn timed(&self) -> Option<&Timing> {
        let timing = self.timing.as_deref()?;
        (timing.asked || timing.poll_monitor.is_some()).then_some(timing)
    }

    /// The longest of its polls in nanoseconds, if they are timed.
    pub(in crate::process) fn longest_poll(&self) -> Option<u64> {
        Some(self.timed()?.longest_poll.load(Ordering::Relaxed))
    }

    /// Installs its replay log around each poll.
    pub(in crate::process) fn log_installer(&self) -> Option<&Arc<dyn LogInstaller>> {
        self.timing.as_ref()?.log_installer.as_ref()
    }

    fn poll_monitor(&self) -> Option<&Arc<dyn PollMonitor>> {
        self.timing.as_ref()?.poll_monitor.as_ref()
    }

    pub(crate) fn state(&self) -> ProcessState {
        let _shown = self.shown.lock();
        if self.has_ended() {
            return ProcessState::Ended;
        }
        // SAFETY: the lock is held.
        let process = unsafe { self.seen.process() };
        process.map_or(ProcessState::Created, Process::activity)
    }

    /// How often it was polled.
    pub(in crate::process) fn polls(&self) -> u64 {
        self.seen.last_polls().unwrap_or_else(|| {
            let _shown = self.shown.lock();
            // SAFETY: the lock is held.
            unsafe { self.seen.polls() }
        })
    }

    /// Begins a poll, if polls are timed.
    #[cold]
    pub(in crate::process) fn begin_poll(&self) {
        let Some(timing) = self.timed() else {
            return;
        };
        let began = Instant::now();
        if let Some(poll_monitor) = self.poll_monitor() {
            // It may panic, so the poll monitor is not installed while it runs.
            poll_monitor.poll_begins(began);
            poll_monitor::set(Some(poll_monitor.clone()));
        }
        timing.began.store(began.as_nanos(), Ordering::Relaxed);
    }

    /// Ends a timed poll, once. If the poll monitor wants the process ended, it counts as cancelled
    /// from here on. The poll monitor may panic.
    #[inline]
    pub(in crate::process) fn end_poll(&self) {
        if let Some(timing) = self.timed() {
            self.end_timed_poll(timing);
        }
    }

    #[cold]
    fn end_timed_poll(&self, timing: &Timing) {
        let began = Instant::from_nanos(timing.began.load(Ordering::Relaxed));
        if began == Instant::NEVER {
            return;
        }
        let never = Instant::NEVER.as_nanos();
        timing.began.store(never, Ordering::Relaxed);
        let now = Instant::now();
        let took = now.nanos_since(began);
        if took > timing.longest_poll.load(Ordering::Relaxed) {
            timing.longest_poll.store(took, Ordering::Relaxed);
        }
        let Some(poll_monitor) = self.poll_monitor() else {
            return;
        };
        // The record has another reference, so nothing is freed here.
        poll_monitor::set(None);
        if poll_monitor.poll_ends(began, now) == Verdict::Poison {
            self.is_poisoned.store(true, Ordering::Relaxed);
            self.cancelled.store(true, Ordering::Release);
        }
    }

    /// Whether the channel ends that go with its body are to poison their channels.
    pub(in crate::process) fn is_poisoned(&self) -> bool {
        self.is_poisoned.load(Ordering::Relaxed)
    }

    /// Sets the address of the process. The process, which has a waker, stays there until it has
    /// [finished](Self::finish).
    ///
    /// # Safety
    ///
    /// `process` is the process of this record. It has a waker, and stays at its address until it
    /// has finished. This is its executor's thread.
    pub(crate) unsafe fn set_process(&self, process: NonNull<Process>) {
        {
            let _shown = self.shown.lock();
            self.seen.0.store(process.as_ptr(), Ordering::Release);
        }
        if self.cancelled.load(Ordering::Acquire) {
            // SAFETY: the caller promises that the process stays at its address until it has
            // finished. It finishes on its executor's thread, which is this one, so not during this
            // call.
            unsafe { process.as_ref() }.notify(Notice::CANCELLED);
        }
    }

    /// The addresses at which the body lies, while the process is there.
    pub(in crate::process) fn body(&self) -> Option<Range<usize>> {
        let _shown = self.shown.lock();
        // SAFETY: the lock is held as long as the process is used. A process that is shown has an
        // owner, which lives as long as it is shown.
        unsafe {
            let process = self.seen.process()?;
            Some((process.methods().body)(process.owner()))
        }
    }

    pub(crate) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
        let waker = {
            let _shown = self.shown.lock();
            // SAFETY: the lock is held as long as it is used.
            unsafe { self.seen.process() }.and_then(|process| {
                process.notify(Notice::CANCELLED);
                process.waker().cloned()
            })
        };
        if let Some(waker) = waker {
            waker.wake();
        }
    }
}

luna_platform::debug_fields!(
    Record,
    |record| name: record.name, id: record.id.get(), level: record.level(), state: record.state()
);

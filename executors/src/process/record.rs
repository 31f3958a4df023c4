//! The part of a process that outlives its body: its name, its counters, and how it ended.

use super::exit_value::{ErasedExitValue, ExitValue};
use super::join::JoinNode;
use super::poll_monitor::{self, PollMonitor, Verdict};
use super::registry::ProcessRegistry;
use super::{Exit, Name, ProcessSpec, ProcessState, panic_message};
use luna_core::biased_lock::BiasedLock;
use luna_core::current::{Activity, LEVELS, Process, ProcessId};
use luna_core::deferred_free::{self, Retired};
use luna_core::events;
use luna_core::path;
use luna_core::replay_log::LogInstaller;
use luna_core::wait_list::WaitList;
use luna_platform::clock::Instant;
use std::any::Any;
use std::fmt;
use std::mem::ManuallyDrop;
use std::ops::{Deref, Range};
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::task::Waker;

/// How it ended, before any query: the message of a panic is made off the real-time path.
pub(crate) enum RawExit {
    Completed,
    /// Completed, with an exit value.
    Value(ErasedExitValue),
    Cancelled,
    Panicked(Box<dyn Any + Send>),
}

/// How a process has ended, readable without the lock.
struct Outcome;

impl Outcome {
    const NONE: u8 = 0;
    const COMPLETED: u8 = 1;
    const CANCELLED: u8 = 2;
    /// The panic's payload is behind the lock.
    const PANICKED: u8 = 3;
    /// Completed, and the exit value is behind the lock.
    const WITH_VALUE: u8 = 4;
}

/// Flags for the end of a process, stored beside its level.
struct How;

impl How {
    /// Its end is listed.
    const LISTED: u8 = 1 << 5;
    const UNHURRIED: u8 = 1 << 6;
    /// The room of its body is large.
    const LARGE: u8 = 1 << 7;
}

/// Flags for what happened to a process.
struct Fate;

impl Fate {
    /// It was ended by its poll_monitor.
    const POISONED: u8 = 2;
}

/// Causes for an executor to check a process before it polls it.
pub(crate) struct Notice;

impl Notice {
    pub(crate) const CANCELLED: u8 = 1;
    pub(crate) const TIMED: u8 = 2;
    pub(crate) const ENDED: u8 = 4;
    /// Its turns are recorded: see [`events`].
    pub(crate) const RECORDED: u8 = 8;
}

/// The record's view of the process itself, in one word: nothing yet, its address, or how often it
/// was polled before it went.
///
/// # Invariants
///
/// It is changed under the record's lock. A process that is here while the lock is held is live,
/// and has a waker: it clears this before it goes.
struct Seen(AtomicPtr<Process>);

impl Seen {
    const fn nothing() -> Self {
        Self(AtomicPtr::new(ptr::null_mut()))
    }

    /// How often a process that has gone was polled. No process lies at an odd address.
    fn polls_of_gone(word: *mut Process) -> Option<u64> {
        let word = word.addr();
        (word & 1 != 0).then_some((word >> 1) as u64)
    }

    /// How often the process was polled, if it has gone: without the lock, since that does not
    /// change any more.
    fn last_polls(&self) -> Option<u64> {
        Self::polls_of_gone(self.0.load(Ordering::Acquire))
    }

    /// The process, if it is there.
    ///
    /// # Safety
    ///
    /// The record's lock is held as long as what is returned is used.
    unsafe fn process(&self) -> Option<&Process> {
        let word = self.0.load(Ordering::Relaxed);
        if Self::polls_of_gone(word).is_some() {
            return None;
        }
        // SAFETY: the invariant.
        unsafe { word.as_ref() }
    }

    /// How often it was polled.
    ///
    /// # Safety
    ///
    /// The record's lock is held.
    unsafe fn polls(&self) -> u64 {
        // SAFETY: the contract.
        let process = unsafe { self.process() };
        process.map_or(self.last_polls().unwrap_or(0), Process::polls)
    }

    /// Clears the pointer: the process goes.
    ///
    /// # Safety
    ///
    /// The record's lock is held.
    unsafe fn forget(&self) {
        // SAFETY: the contract.
        let polls = unsafe { self.polls() };
        let most = usize::MAX >> 1;
        let polls = usize::try_from(polls).unwrap_or(most).min(most);
        let word = ptr::without_provenance_mut(polls << 1 | 1);
        self.0.store(word, Ordering::Release);
    }
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
    pub(super) name: Name,
    seen: Seen,
    /// If its polls are timed, also if only the poll monitor needs that.
    timing: Option<Box<Timing>>,
    references: AtomicU32,
    pub(super) id: ProcessId,
    /// Its level, and [how](How) it ends.
    level_and_how: u8,
    /// One of [`Outcome`].
    outcome: AtomicU8,
    pub(super) cancelled: AtomicBool,
    /// Further facts about its end: flags of [`Fate`].
    fate: AtomicU8,
    /// The process' own thread takes it without atomics, unless others look at the process too.
    pub(super) shown: BiasedLock<Shown>,
}

/// A counted reference to a record.
///
/// # Invariants
///
/// It is counted, so the record is live. The pointer may be used for all of the memory that the
/// record lies in.
pub(crate) struct RecordRef(NonNull<Record>);

// SAFETY: a record is used by shared references on any thread, and what frees it runs on any.
unsafe impl Send for RecordRef {}
// SAFETY: as above.
unsafe impl Sync for RecordRef {}

/// A reference may go to any thread because of this.
const _: () = {
    const fn shared<T: Send + Sync>() {}
    shared::<Record>();
};

impl RecordRef {
    /// The first reference to a record in memory of its own. Allocates.
    pub(crate) fn boxed(record: Record) -> Self {
        Self(NonNull::from(Box::leak(Box::new(record))))
    }

    /// # Safety
    ///
    /// One reference was counted for this one, and the pointer may be used for all of the memory
    /// that the record lies in.
    pub(crate) unsafe fn from_raw(record: NonNull<Record>) -> Self {
        Self(record)
    }

    /// The pointer. The reference stays counted.
    pub(crate) fn into_raw(self) -> NonNull<Record> {
        ManuallyDrop::new(self).0
    }

    /// Publishes how a process has ended that is not polled any more, and reports it.
    pub(crate) fn end(&self, exit: RawExit, registry: &ProcessRegistry) {
        if self.finish(exit) {
            self.clone().report(registry);
        }
    }

    /// Reports the end of this process, which has [finished](Record::finish), to the registry that
    /// counts and lists it. The list takes this reference.
    pub(crate) fn report(self, registry: &ProcessRegistry) {
        let is_listed = self.is(How::LISTED);
        let in_a_hurry = self.has_ended_in_a_hurry();
        let Err(record) = registry.keep(is_listed.then_some(self), in_a_hurry) else {
            return;
        };
        // In the order of their ends.
        registry.report_kept();
        if let Some(record) = record {
            registry.list_ended(record);
        }
        registry.leave(in_a_hurry);
    }
}

impl Deref for RecordRef {
    type Target = Record;

    #[inline]
    fn deref(&self) -> &Record {
        // SAFETY: the invariant.
        unsafe { self.0.as_ref() }
    }
}

impl Clone for RecordRef {
    #[inline]
    fn clone(&self) -> Self {
        self.count_one_more();
        Self(self.0)
    }
}

impl Drop for RecordRef {
    #[inline]
    fn drop(&mut self) {
        // SAFETY: the invariant; this reference is not used any more.
        unsafe { Record::count_less(self.0, 1) };
    }
}

/// # Safety
///
/// `head` begins a record that [`boxed`](RecordRef::boxed) made, without any reference.
unsafe fn free_boxed(head: NonNull<Retired>) {
    // SAFETY: the contract.
    drop(unsafe { Box::from_raw(head.cast::<Record>().as_ptr()) });
}

/// State that other threads read and change.
pub(super) struct Shown {
    pub(super) joining: WaitList,
    beside: Beside,
}

/// State of a process that is not there yet, or has ended.
enum Beside {
    Nothing,
    /// How to wake one that is not there yet.
    Waker(Box<Waker>),
    /// The payload of its panic.
    Panic(Box<dyn Any + Send>),
    /// Its exit value.
    ExitValue(ErasedExitValue),
}

impl Shown {
    fn waker(&self) -> Option<&Waker> {
        match &self.beside {
            Beside::Waker(waker) => Some(waker),
            _ => None,
        }
    }

    fn take_waker(&mut self) -> Option<Box<Waker>> {
        match std::mem::replace(&mut self.beside, Beside::Nothing) {
            Beside::Waker(waker) => Some(waker),
            other => {
                self.beside = other;
                None
            }
        }
    }
}

/// The timing of a process with timed polls.
struct Timing {
    poll_monitor: Option<Arc<dyn PollMonitor>>,
    log_installer: Option<Box<Arc<dyn LogInstaller>>>,
    /// The polls are timed: this is not timed for the replay log alone.
    is_timed: bool,
    /// Written by the process' thread alone.
    longest_poll: AtomicU64,
}

impl Record {
    /// The record of a process that has memory of its own. It counts as living, with one reference.
    pub(crate) fn new(spec: ProcessSpec, registry: &ProcessRegistry) -> Self {
        Self::within(spec, registry, false, 1, free_boxed)
    }

    /// The record of a process that counts as living, with so many references, in memory that
    /// `free` frees. `is_on_executor`: the calling thread is the executor that it is to run on.
    #[inline]
    pub(crate) fn within(
        spec: ProcessSpec,
        registry: &ProcessRegistry,
        is_on_executor: bool,
        references: u32,
        free: unsafe fn(NonNull<Retired>),
    ) -> Self {
        registry.enter();
        let shown = Shown {
            joining: WaitList::new(),
            beside: Beside::Nothing,
        };
        path::name_process(spec.id, &spec.name);
        events::report(events::code::SPAWNED, spec.id.get(), || {
            [events::current_process(), 0]
        });
        let flag = |is_set, bit| if is_set { bit } else { 0 };
        let is_timed = spec.timed || spec.poll_monitor.is_some();
        let timing = (is_timed || spec.log_installer.is_some()).then(|| {
            Box::new(Timing {
                poll_monitor: spec.poll_monitor,
                log_installer: spec.log_installer,
                is_timed,
                longest_poll: AtomicU64::new(0),
            })
        });
        Self {
            retired: Retired::new(free),
            references: AtomicU32::new(references),
            name: spec.name,
            id: spec.id,
            level_and_how: spec.level
                | flag(spec.listed, How::LISTED)
                | flag(spec.unhurried, How::UNHURRIED),
            outcome: AtomicU8::new(Outcome::NONE),
            cancelled: AtomicBool::new(false),
            fate: AtomicU8::new(0),
            seen: Seen::nothing(),
            shown: if is_on_executor {
                BiasedLock::biased_to_this_executor(shown)
            } else {
                BiasedLock::new(shown)
            },
            timing,
        }
    }

    /// Notes that the memory in which it lies is large.
    pub(crate) fn set_large(&mut self) {
        self.level_and_how |= How::LARGE;
    }

    /// What is known of a process that has ended, in memory without the room of its body; `None` if
    /// that is not large, or there is more to know than is copied.
    pub(super) fn without_body(&self) -> Option<Self> {
        let outcome = match self.outcome.load(Ordering::Acquire) {
            Outcome::COMPLETED | Outcome::WITH_VALUE => Outcome::COMPLETED,
            Outcome::CANCELLED => Outcome::CANCELLED,
            _ => return None,
        };
        if !self.is(How::LARGE) || self.timing.is_some() {
            return None;
        }
        Some(Self {
            retired: Retired::new(free_boxed),
            name: self.name.clone(),
            seen: Seen(AtomicPtr::new(self.seen.0.load(Ordering::Relaxed))),
            timing: None,
            references: AtomicU32::new(1),
            id: self.id,
            level_and_how: self.level_and_how & !How::LARGE,
            outcome: AtomicU8::new(outcome),
            cancelled: AtomicBool::new(self.is_cancelled()),
            fate: AtomicU8::new(self.fate.load(Ordering::Relaxed)),
            shown: BiasedLock::new(Shown {
                joining: WaitList::new(),
                beside: Beside::Nothing,
            }),
        })
    }

    /// Counts one more reference, for a caller that has one.
    #[inline]
    pub(crate) fn count_one_more(&self) {
        // Relaxed: code that has a reference may pass it on, and provides the ordering that this
        // needs itself.
        if self.references.fetch_add(1, Ordering::Relaxed) > i32::MAX as u32 {
            // So many were leaked: to wrap would be to free what is owned.
            std::process::abort();
        }
    }

    /// Counts so many references less; the last frees the memory: at once, or off the real-time
    /// path.
    ///
    /// # Safety
    ///
    /// They were counted for the caller, which does not use the record any more. The pointer may be
    /// used for all of the memory that the record lies in.
    #[inline]
    pub(crate) unsafe fn count_less(this: NonNull<Self>, count: u32) {
        // SAFETY: the caller's contract. AcqRel, and no fence, which ThreadSanitizer does not know:
        // the thread that frees the memory does so after all that others did with it. A thread with
        // the only references is alone with it: looking costs less than counting.
        unsafe {
            let references = &this.as_ref().references;
            if references.load(Ordering::Acquire) == count
                || references.fetch_sub(count, Ordering::AcqRel) == count
            {
                deferred_free::retire(this.cast());
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

    pub(crate) fn id(&self) -> ProcessId {
        self.id
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn level(&self) -> u8 {
        self.level_and_how & (LEVELS - 1)
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
        let recorded = if events::is_on() { Notice::RECORDED } else { 0 };
        timed | recorded | if cancelled { Notice::CANCELLED } else { 0 }
    }

    /// Whether the body has ended.
    #[inline]
    pub(crate) fn has_ended(&self) -> bool {
        self.outcome.load(Ordering::Acquire) != Outcome::NONE
    }

    /// How it ended, if it has. The message of a panic is made here.
    #[inline]
    pub(super) fn exit(&self) -> Option<Exit> {
        Some(match self.outcome.load(Ordering::Acquire) {
            Outcome::NONE => return None,
            Outcome::COMPLETED | Outcome::WITH_VALUE => Exit::Completed,
            Outcome::CANCELLED => Exit::Cancelled,
            _ => self.panicked(),
        })
    }

    #[cold]
    #[inline(never)]
    fn panicked(&self) -> Exit {
        Exit::Panicked(match &self.shown.lock().beside {
            Beside::Panic(payload) => panic_message(&**payload),
            _ => String::new(),
        })
    }

    /// The exit value, if it is of this type and was not taken.
    #[inline]
    pub(super) fn take_exit_value<O: ExitValue>(&self) -> Option<O> {
        if self.outcome.load(Ordering::Acquire) != Outcome::WITH_VALUE {
            return None;
        }
        self.take_stored_exit_value()
    }

    #[cold]
    fn take_stored_exit_value<O: ExitValue>(&self) -> Option<O> {
        let mut shown = self.shown.lock();
        // Checked in place: if they were taken out and put back, they would be missing meanwhile.
        let value = match &shown.beside {
            Beside::ExitValue(value) if value.are::<O>() => {
                std::mem::replace(&mut shown.beside, Beside::Nothing)
            }
            _ => return None,
        };
        drop(shown);
        // Outside of the lock: it frees.
        match value {
            Beside::ExitValue(value) => value.take().ok(),
            _ => None,
        }
    }

    /// Whether its polls are timed.
    pub(super) fn is_timed(&self) -> bool {
        self.timing.as_ref().is_some_and(|timing| timing.is_timed)
    }

    /// The longest of its polls in nanoseconds, if they are timed.
    pub(super) fn longest_poll(&self) -> Option<u64> {
        let timing = self.timing.as_ref().filter(|timing| timing.is_timed)?;
        Some(timing.longest_poll.load(Ordering::Relaxed))
    }

    /// Installs its replay log around each poll.
    pub(super) fn log_installer(&self) -> Option<&Arc<dyn LogInstaller>> {
        self.timing.as_ref()?.log_installer.as_deref()
    }

    fn poll_monitor(&self) -> Option<&Arc<dyn PollMonitor>> {
        self.timing.as_ref()?.poll_monitor.as_ref()
    }

    pub(crate) fn state(&self) -> ProcessState {
        let shown = self.shown.lock();
        if self.has_ended() {
            return ProcessState::Ended;
        }
        // SAFETY: the lock is held.
        let activity = unsafe { self.seen.process() }.map(Process::activity);
        drop(shown);
        match activity {
            None | Some(Activity::New) => ProcessState::Created,
            Some(Activity::Ready) => ProcessState::Ready,
            Some(Activity::Running) => ProcessState::Running,
            Some(Activity::Waiting) => ProcessState::Waiting,
        }
    }

    /// How often it was polled.
    pub(super) fn polls(&self) -> u64 {
        self.seen.last_polls().unwrap_or_else(|| {
            let _shown = self.shown.lock();
            // SAFETY: the lock is held.
            unsafe { self.seen.polls() }
        })
    }

    /// Begins a timed poll; returns its start.
    #[cold]
    pub(super) fn begin_poll(&self) -> Instant {
        let began = Instant::now();
        if let Some(poll_monitor) = self.poll_monitor() {
            // It may panic, so the poll monitor is not installed while it runs.
            poll_monitor.poll_begins(began);
            poll_monitor::set(Some(poll_monitor.clone()));
        }
        began
    }

    /// Ends a timed poll. If the poll monitor wants the process ended, it counts as cancelled from
    /// here on.
    #[cold]
    pub(super) fn end_poll(&self, began: Instant) {
        let now = Instant::now();
        let took = now.nanos_since(began);
        if let Some(Timing { longest_poll, .. }) = self.timing.as_deref()
            && took > longest_poll.load(Ordering::Relaxed)
        {
            longest_poll.store(took, Ordering::Relaxed);
        }
        let Some(poll_monitor) = self.poll_monitor() else {
            return;
        };
        // The record has another reference, so nothing is freed here.
        poll_monitor::set(None);
        if poll_monitor.poll_ends(began, now) == Verdict::Poison {
            self.fate.fetch_or(Fate::POISONED, Ordering::Relaxed);
            self.cancelled.store(true, Ordering::Release);
        }
    }

    /// Whether the channel ends that go with its body are to poison their channels.
    pub(super) fn is_poisoned(&self) -> bool {
        self.fate.load(Ordering::Relaxed) & Fate::POISONED != 0
    }

    /// Sets the waker before the process is there. Allocates.
    pub(crate) fn set_waker(&self, waker: Waker) {
        let waker = Box::new(waker);
        let before = {
            let mut shown = self.shown.lock();
            let before = shown.take_waker();
            if matches!(shown.beside, Beside::Nothing) {
                shown.beside = Beside::Waker(waker);
            }
            before
        };
        drop(before);
    }

    /// Sets the address of the process. The process, which has a waker, stays there until it has
    /// [finished](Self::finish), or it was [forgotten](Self::forget_process).
    ///
    /// # Safety
    ///
    /// `process` is the process of this record. It has a waker, and stays at its address until it
    /// has finished, or was forgotten.
    pub(crate) unsafe fn set_process(&self, process: NonNull<Process>) {
        let before = {
            let mut shown = self.shown.lock();
            self.seen.0.store(process.as_ptr(), Ordering::Release);
            shown.take_waker()
        };
        // Dropped here, and not on the real-time path.
        drop(before);
        if self.cancelled.load(Ordering::Acquire) {
            // SAFETY: the contract.
            unsafe { process.as_ref() }.notify(Notice::CANCELLED);
        }
    }

    /// The addresses at which the body lies, while the process is there.
    pub(super) fn body(&self) -> Option<Range<usize>> {
        let _shown = self.shown.lock();
        // SAFETY: the lock is held as long as the process is used. A process that is shown has an
        // owner, which lives as long as it is shown.
        unsafe {
            let process = self.seen.process()?;
            Some((process.methods().body)(process.owner()))
        }
    }

    /// Clears the address: the process goes.
    pub(crate) fn forget_process(&self) {
        let waker = {
            let mut shown = self.shown.lock();
            // SAFETY: the lock is held.
            unsafe { self.seen.forget() };
            shown.take_waker()
        };
        drop(waker);
    }

    pub(crate) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
        let waker = {
            let shown = self.shown.lock();
            // SAFETY: the lock is held as long as it is used.
            if let Some(process) = unsafe { self.seen.process() } {
                process.notify(Notice::CANCELLED);
                process.waker().cloned()
            } else {
                shown.waker().cloned()
            }
        };
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// Publishes how the process has ended, once, to its waiters. `false`: it had ended before.
    pub(crate) fn finish(&self, exit: RawExit) -> bool {
        let mut shown = self.shown.lock();
        if self.has_ended() {
            drop(shown);
            return false;
        }
        events::done(
            self.id.get(),
            match exit {
                RawExit::Completed | RawExit::Value(_) => events::code::ended::OK,
                RawExit::Cancelled => events::code::ended::CANCELLED,
                RawExit::Panicked(_) => events::code::ended::PANICKED,
            },
        );
        let mut waker = shown.take_waker();
        let outcome = match exit {
            RawExit::Completed => Outcome::COMPLETED,
            RawExit::Value(value) => {
                shown.beside = Beside::ExitValue(value);
                Outcome::WITH_VALUE
            }
            RawExit::Cancelled => Outcome::CANCELLED,
            RawExit::Panicked(payload) => {
                shown.beside = Beside::Panic(payload);
                Outcome::PANICKED
            }
        };
        // No further query to the process itself can come. SAFETY: the lock is held.
        unsafe { self.seen.forget() };
        self.outcome.store(outcome, Ordering::Release);
        // One by one, so that the lock is never held for more than a few steps.
        while let Some(node) = shown.joining.pop() {
            // No further waiter can come.
            let is_last = shown.joining.is_empty();
            // SAFETY: a node in the list is live and guarded by the lock that is held; its join
            // uses it no more once it is not listed.
            let ready = unsafe {
                let node = node.cast::<JoinNode>().as_ptr();
                let ready = (*node)
                    .wait
                    .wake_handle_mut()
                    .take()
                    .map(|wake_handle| wake_handle.take());
                (*node).listed.store(false, Ordering::Release);
                ready
            };
            drop(shown);
            drop(waker.take());
            if let Some(ready) = ready {
                // The other waiters are notified all the same.
                ready.wake_contained();
            }
            if is_last {
                return true;
            }
            shown = self.shown.lock();
        }
        drop(shown);
        drop(waker);
        true
    }
}

impl fmt::Debug for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Process")
            .field("name", &self.name)
            .field("id", &self.id.get())
            .field("level", &self.level())
            .field("state", &self.state())
            .finish_non_exhaustive()
    }
}

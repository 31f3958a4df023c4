//! What outlives the body of a process: its name, what it does, and how it ended.

use super::join::JoinNode;
use super::living::Living;
use super::overseer::{self, Overseer, Sentence};
use super::{Exit, ProcessSpec, ProcessState, panic_message};
use luna_platform::clock::Instant;
use luna_platform::current::{Activity, Process, ProcessId};
use luna_platform::lock::PiLock;
use luna_platform::path;
use luna_platform::wait_list::WaitList;
use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, AtomicU64, Ordering};
use std::task::Waker;

/// How it ended, before anybody asked: the message of a panic is made off the real-time path.
pub(super) enum RawExit {
    Completed,
    Cancelled,
    Panicked(Box<dyn Any + Send>),
}

/// How a process has ended, for who does not want to lock.
struct Outcome;

impl Outcome {
    const NONE: u8 = 0;
    const COMPLETED: u8 = 1;
    const CANCELLED: u8 = 2;
    /// What was said is behind the lock.
    const PANICKED: u8 = 3;
}

/// Why an executor looks twice at a process before it polls it.
pub(crate) struct Notice;

impl Notice {
    pub(crate) const CANCELLED: u8 = 1;
    pub(crate) const TIMED: u8 = 2;
    pub(crate) const ENDED: u8 = 4;
}

/// What the record sees of the process itself.
///
/// # Invariants
///
/// A process that is here is live: it says before it goes.
enum Seen {
    /// It is not there yet, or not any more, and was polled so often.
    Nothing {
        polls: u64,
    },
    Waker(Waker),
    Process(Waker, NonNull<Process>),
}

// SAFETY: a process can be looked at from any thread.
unsafe impl Send for Seen {}

impl Seen {
    fn process(&self) -> Option<&Process> {
        match self {
            // SAFETY: the type's invariant.
            Seen::Process(_, process) => Some(unsafe { process.as_ref() }),
            _ => None,
        }
    }

    fn polls(&self) -> u64 {
        match self {
            Seen::Nothing { polls } => *polls,
            seen => seen.process().map_or(0, Process::polls),
        }
    }
}

/// What outlives the body of a process.
pub(crate) struct Record {
    pub(super) name: Arc<str>,
    pub(super) id: ProcessId,
    pub(super) level: u8,
    /// Whether its polls are timed, be it for the overseer's sake.
    pub(super) timed: bool,
    overseer: Option<Arc<dyn Overseer>>,
    /// One of [`Outcome`].
    outcome: AtomicU8,
    /// Its thread has gone under with the body, which still refers to what it was made of.
    body_left: AtomicBool,
    pub(super) cancelled: AtomicBool,
    /// It was ended by its overseer.
    poisoned: AtomicBool,
    /// Written by the process' thread alone.
    pub(super) longest_poll: AtomicU64,
    seen: PiLock<Seen>,
    pub(super) end: PiLock<End>,
    living: Arc<Living>,
    /// Whether its end is to be listed.
    listed: bool,
    unhurried: bool,
    /// Who ended before it, while it is listed.
    pub(super) after: AtomicPtr<Record>,
}

/// How it ended, and who waits for that.
pub(super) struct End {
    exit: Option<RawExit>,
    pub(super) joining: WaitList,
}

impl Record {
    pub(crate) fn new(spec: ProcessSpec, living: Arc<Living>) -> Arc<Self> {
        living.enter();
        path::name_process(spec.id, &spec.name);
        Arc::new(Self {
            name: spec.name,
            id: spec.id,
            level: spec.level,
            timed: spec.timed || spec.overseer.is_some(),
            overseer: spec.overseer,
            outcome: AtomicU8::new(Outcome::NONE),
            body_left: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            poisoned: AtomicBool::new(false),
            longest_poll: AtomicU64::new(0),
            seen: PiLock::new(Seen::Nothing { polls: 0 }),
            end: PiLock::new(End {
                exit: None,
                joining: WaitList::new(),
            }),
            living,
            listed: spec.listed,
            unhurried: spec.unhurried,
            after: AtomicPtr::new(ptr::null_mut()),
        })
    }

    pub(crate) fn id(&self) -> ProcessId {
        self.id
    }

    pub(crate) fn level(&self) -> u8 {
        self.level
    }

    #[inline]
    pub(crate) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Acquire)
    }

    /// What its executor is to look at before its first poll.
    pub(crate) fn notices(&self) -> u8 {
        let cancelled = self.is_cancelled();
        let timed = if self.timed { Notice::TIMED } else { 0 };
        timed | if cancelled { Notice::CANCELLED } else { 0 }
    }

    /// Whether the body has ended.
    #[inline]
    pub(crate) fn has_ended(&self) -> bool {
        self.outcome.load(Ordering::Acquire) != Outcome::NONE
    }

    /// How it ended, if it has. The message of a panic is made here.
    pub(super) fn exit(&self) -> Option<Exit> {
        match self.outcome.load(Ordering::Acquire) {
            Outcome::NONE => None,
            Outcome::COMPLETED => Some(Exit::Completed),
            Outcome::CANCELLED => Some(Exit::Cancelled),
            _ => self.end.lock().exit(),
        }
    }

    pub(crate) fn state(&self) -> ProcessState {
        let seen = self.seen.lock();
        if self.has_ended() {
            return ProcessState::Ended;
        }
        match seen.process().map(Process::activity) {
            None | Some(Activity::New) => ProcessState::Created,
            Some(Activity::Ready) => ProcessState::Ready,
            Some(Activity::Running) => ProcessState::Running,
            Some(Activity::Waiting) => ProcessState::Waiting,
        }
    }

    /// How often it was given the processor.
    pub(super) fn polls(&self) -> u64 {
        self.seen.lock().polls()
    }

    /// Begins a timed poll; gives when.
    #[cold]
    pub(super) fn begin_poll(&self) -> Instant {
        let began = Instant::now();
        if let Some(overseer) = &self.overseer {
            // It may panic, and is nobody's overseer then.
            overseer.poll_begins(began);
            overseer::set(Some(overseer.clone()));
        }
        began
    }

    /// Ends a timed poll. If the overseer wants the process ended, it counts as cancelled from here on.
    #[cold]
    pub(super) fn end_poll(&self, began: Instant) {
        let now = Instant::now();
        let took = now.nanos_since(began);
        if took > self.longest_poll.load(Ordering::Relaxed) {
            self.longest_poll.store(took, Ordering::Relaxed);
        }
        let Some(overseer) = &self.overseer else {
            return;
        };
        // The record has another, so nothing is freed here.
        overseer::set(None);
        if overseer.poll_ends(began, now) == Sentence::Poison {
            self.poisoned.store(true, Ordering::Relaxed);
            self.cancelled.store(true, Ordering::Release);
        }
    }

    /// Whether the channel ends that go with its body are to poison their channels.
    pub(super) fn is_poisoned(&self) -> bool {
        self.poisoned.load(Ordering::Relaxed)
    }

    /// Says how to wake it before it is there.
    pub(crate) fn set_waker(&self, waker: Waker) {
        *self.seen.lock() = Seen::Waker(waker);
    }

    /// Says where it is, and how to wake it. The process stays there until [`forget_process`](Self::forget_process).
    ///
    /// # Safety
    ///
    /// That.
    pub(crate) unsafe fn set_process(&self, waker: Waker, process: NonNull<Process>) {
        *self.seen.lock() = Seen::Process(waker, process);
        if self.cancelled.load(Ordering::Acquire) {
            // SAFETY: the contract.
            unsafe { process.as_ref() }.notify(Notice::CANCELLED);
        }
    }

    /// Says that the process goes.
    pub(crate) fn forget_process(&self) {
        let seen = {
            let mut seen = self.seen.lock();
            let polls = seen.polls();
            std::mem::replace(&mut *seen, Seen::Nothing { polls })
        };
        drop(seen);
    }

    pub(crate) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
        let waker = {
            let seen = self.seen.lock();
            if let Some(process) = seen.process() {
                process.notify(Notice::CANCELLED);
            }
            match &*seen {
                Seen::Nothing { .. } => None,
                Seen::Waker(waker) | Seen::Process(waker, _) => Some(waker.clone()),
            }
        };
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    /// Says that the process' body is never dropped, if it has not ended: called before it is ended.
    pub(crate) fn leave_body(&self) {
        if !self.has_ended() {
            self.body_left.store(true, Ordering::Release);
        }
    }

    pub(super) fn has_left_body(&self) -> bool {
        self.body_left.load(Ordering::Acquire)
    }

    /// Ends a process whose body never ran.
    pub(crate) fn end_unstarted(self: &Arc<Self>) {
        self.finish(RawExit::Cancelled);
    }

    /// Ends a process whose body could not be made.
    pub(crate) fn end_panicked(self: &Arc<Self>, payload: Box<dyn Any + Send>) {
        self.finish(RawExit::Panicked(payload));
    }

    pub(super) fn finish(self: &Arc<Self>, exit: RawExit) {
        let mut end = self.end.lock();
        if end.exit.is_some() {
            return;
        }
        let in_a_hurry = !self.unhurried || !matches!(exit, RawExit::Completed);
        let outcome = match exit {
            RawExit::Completed => Outcome::COMPLETED,
            RawExit::Cancelled => Outcome::CANCELLED,
            RawExit::Panicked(_) => Outcome::PANICKED,
        };
        end.exit = Some(exit);
        self.outcome.store(outcome, Ordering::Release);
        // One by one, so that the lock is never held for more than a few steps.
        while let Some(node) = end.joining.pop() {
            // Nobody comes any more.
            let is_last = end.joining.is_empty();
            // SAFETY: a node in the list is live and guarded by the lock that is held; its join is pending until `gone` is set.
            let ready = unsafe {
                let node = &mut *node.cast::<JoinNode>().as_ptr();
                let ready = node.wait.wakeup_mut().take().map(|wakeup| wakeup.take());
                node.listed = false;
                ready
            };
            drop(end);
            if let Some(ready) = ready
                && let Err(payload) = catch_unwind(AssertUnwindSafe(|| ready.wake()))
            {
                // A foreign waker's panic is its own matter: the others are told all the same. Dropping what it said could panic in turn.
                std::mem::forget(payload);
            }
            if is_last {
                return self.tell(in_a_hurry);
            }
            end = self.end.lock();
        }
        drop(end);
        self.tell(in_a_hurry);
    }

    /// Tells who counts and lists the processes that this one has ended.
    fn tell(self: &Arc<Self>, in_a_hurry: bool) {
        if self.listed {
            self.living.list_ended(self.clone());
        }
        self.living.leave(in_a_hurry);
    }
}

impl fmt::Debug for Record {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Process")
            .field("name", &self.name)
            .field("id", &self.id.get())
            .field("level", &self.level)
            .field("state", &self.state())
            .finish_non_exhaustive()
    }
}

impl End {
    /// How it ended, if it has. The message of a panic is made here.
    pub(super) fn exit(&self) -> Option<Exit> {
        Some(match self.exit.as_ref()? {
            RawExit::Completed => Exit::Completed,
            RawExit::Cancelled => Exit::Cancelled,
            RawExit::Panicked(payload) => Exit::Panicked(panic_message(&**payload)),
        })
    }
}

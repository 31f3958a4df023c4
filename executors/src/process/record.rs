//! What outlives the body of a process: its name, what it does, and how it ended.

use super::join::JoinNode;
use super::living::Living;
use super::overseer::{self, Overseer, Sentence};
use super::{Exit, ProcessSpec, ProcessState, panic_message};
use luna_platform::clock::Instant;
use luna_platform::current::ProcessId;
use luna_platform::lock::PiLock;
use luna_platform::path;
use luna_platform::wait_list::WaitList;
use std::any::Any;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::task::Waker;

/// How it ended, before anybody asked: the message of a panic is made off the real-time path.
pub(super) enum RawExit {
    Completed,
    Cancelled,
    Panicked(Box<dyn Any + Send>),
}

/// What outlives the body of a process.
pub(crate) struct Record {
    pub(super) name: String,
    pub(super) id: ProcessId,
    pub(super) level: u8,
    /// Whether its polls are timed, be it for the overseer's sake.
    pub(super) timed: bool,
    overseer: Option<Arc<dyn Overseer>>,
    /// What it is doing, as last said: a late wake may say that it is ready when it has ended, so `ended` has the last word.
    state: AtomicU8,
    ended: AtomicBool,
    /// Its thread has gone under with the body, which still refers to what it was made of.
    body_left: AtomicBool,
    pub(super) cancelled: AtomicBool,
    /// It was ended by its overseer.
    poisoned: AtomicBool,
    /// Written by the process' thread alone.
    pub(super) polls: AtomicU64,
    pub(super) longest_poll: AtomicU64,
    waker: PiLock<Option<Waker>>,
    pub(super) end: PiLock<End>,
    living: Arc<Living>,
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
            state: AtomicU8::new(ProcessState::Created as u8),
            ended: AtomicBool::new(false),
            body_left: AtomicBool::new(false),
            cancelled: AtomicBool::new(false),
            poisoned: AtomicBool::new(false),
            polls: AtomicU64::new(0),
            longest_poll: AtomicU64::new(0),
            waker: PiLock::new(None),
            end: PiLock::new(End {
                exit: None,
                joining: WaitList::new(),
            }),
            living,
        })
    }

    pub(crate) fn id(&self) -> ProcessId {
        self.id
    }

    pub(crate) fn level(&self) -> u8 {
        self.level
    }

    #[inline]
    pub(crate) fn set_state(&self, state: ProcessState) {
        self.state.store(state as u8, Ordering::Relaxed);
    }

    /// Says that it is able to run, unless it runs: then its end of the poll says so. On its own thread.
    #[inline]
    pub(crate) fn set_ready(&self) {
        if self.state.load(Ordering::Relaxed) != ProcessState::Running as u8 {
            self.set_state(ProcessState::Ready);
        }
    }

    /// Whether the body has ended.
    #[inline]
    pub(crate) fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    pub(crate) fn state(&self) -> ProcessState {
        if self.has_ended() {
            return ProcessState::Ended;
        }
        ProcessState::from_number(self.state.load(Ordering::Relaxed))
    }

    /// Begins a timed poll; gives when.
    #[cold]
    pub(super) fn begin_poll(&self) -> Instant {
        let began = Instant::now();
        if let Some(overseer) = &self.overseer {
            overseer::set(Some(overseer.clone()));
            overseer.poll_begins(began);
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

    pub(crate) fn set_waker(&self, waker: Waker) {
        *self.waker.lock() = Some(waker);
    }

    pub(crate) fn drop_waker(&self) {
        let waker = self.waker.lock().take();
        drop(waker);
    }

    pub(crate) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Release);
        let waker = self.waker.lock().clone();
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
    pub(crate) fn end_unstarted(&self) {
        self.finish(RawExit::Cancelled);
    }

    /// Ends a process whose body could not be made.
    pub(crate) fn end_panicked(&self, payload: Box<dyn Any + Send>) {
        self.finish(RawExit::Panicked(payload));
    }

    pub(super) fn finish(&self, exit: RawExit) {
        let mut end = self.end.lock();
        if end.exit.is_some() {
            return;
        }
        end.exit = Some(exit);
        self.ended.store(true, Ordering::Release);
        // One by one, so that the lock is never held for more than a few steps.
        while let Some(node) = end.joining.pop() {
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
            end = self.end.lock();
        }
        drop(end);
        self.living.leave();
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

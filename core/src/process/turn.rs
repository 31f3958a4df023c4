//! How a process becomes ready, has its turn, and yields: changes of its state by its executor.

use super::{Process, ProcessState, QueueEnd};
use crate::current::run_queue::Link;
use crate::current::turn::{PlainTurn, process};
use crate::current::{local, not_plain, with_queue};
use crate::events;
use core::hint::cold_path;
use core::ptr::{self, NonNull};
use core::sync::atomic::Ordering;

/// The state of a process, as bits of one byte that the executor's thread writes.
pub(crate) mod state {
    /// It is in the run queue, or was popped from it for a turn that has not begun.
    pub(crate) const QUEUED: u8 = 1;
    /// It is being polled.
    pub(crate) const RUNNING: u8 = 2;
    /// Its body has ended. Then the two bits of `OUTCOME` say how, instead of what follows.
    pub(crate) const ENDED: u8 = 4;
    /// It was never polled.
    pub(crate) const NEW: u8 = 8;
    /// Its wakes are traced as events.
    pub(crate) const TRACED: u8 = 16;
    /// It is queued when its turn is over, behind the others of its level.
    pub(crate) const YIELDED: u8 = 32;
    /// Its executor ends it after this turn.
    pub(crate) const FAILED: u8 = 64;

    pub(crate) const OUTCOME: u8 = 24;
    pub(crate) const COMPLETED: u8 = 0;
    pub(crate) const CANCELLED: u8 = 8;
    /// The panic's payload is behind the lock of what others see.
    pub(crate) const PANICKED: u8 = 16;
    /// Completed with an exit value, which lies in the body's room until it is taken.
    pub(crate) const WITH_VALUE: u8 = 24;
}

/// What is to be done after a turn: see [`Process::after_turn`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AfterTurn {
    /// Nothing: the process waits, or is ready again.
    Nothing,
    /// It has yielded to this process, which runs next.
    Next(NonNull<Process>),
    /// It has ended or [failed](fail_current), has yielded while it was queued, or its events are
    /// traced: the turn is [to be ended](Process::end_turn).
    More,
}

/// Marks the current process, if there is one, as failed: its executor ends it after this turn.
/// O(1), without atomics.
pub fn fail_current() {
    process(|process| {
        if let Some(process) = process {
            let now = process.state.load(Ordering::Relaxed);
            if now & state::ENDED == 0 {
                process.state.store(now | state::FAILED, Ordering::Relaxed);
            }
        }
    });
}

impl Process {
    /// Readies the process without its waker, `lowered` levels below its own. `false`: it has
    /// ended.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, the process is one of an executor's, and stays where it is
    /// until it was popped.
    #[inline]
    pub(crate) unsafe fn ready_here(&self, lowered: u8, place: QueueEnd) -> bool {
        // SAFETY: the caller's promises are those that `ready_at` requires; the level is at most
        // the process' own.
        unsafe { self.ready_at(self.level().saturating_sub(lowered), place) }
    }

    /// Readies the process, which waits, if no other one is ready and the current one need not
    /// yield to it. `false`: it is not so, and no state has changed. In one turn it succeeds once,
    /// since a process is ready from then on: so it is not counted as an operation.
    ///
    /// # Safety
    ///
    /// As for [`ready_at`](Self::ready_at): this is the executor's thread, the process is one of an
    /// executor's, and stays where it is until it was popped.
    #[inline(always)]
    pub(crate) unsafe fn ready_if_none_ready(&self, turn: PlainTurn<'_>) -> bool {
        let thread = turn.thread();
        let level = self.level();
        if self.state.load(Ordering::Relaxed) != 0
            || thread.queue.is_filled()
            || level > turn.process().level()
        {
            return false;
        }
        self.state.store(state::QUEUED, Ordering::Relaxed);
        // SAFETY: the caller's promises are those that `ready_at` requires. By its state the
        // process is in no queue, and nothing is ready.
        unsafe { thread.queue.fill(level, self.link()) };
        true
    }

    /// Puts the process into its executor's run queue at `level`, unless it is there at that level
    /// or a higher one, or has ended: `false`. O(1), without atomics.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, the process is one of an executor's, and stays where it is
    /// until it was popped. `level` is below [`LEVELS`](super::LEVELS).
    #[inline]
    pub unsafe fn ready_at(&self, level: u8, place: QueueEnd) -> bool {
        let now = self.state.load(Ordering::Relaxed);
        if now & (state::QUEUED | state::YIELDED | state::ENDED | state::TRACED) != 0 {
            // SAFETY: the caller's promises are those that `ready_more` requires.
            return unsafe { self.ready_more(level, place) };
        }
        // SAFETY: the caller's promises hold, and the process is neither queued nor ended.
        unsafe { self.queue_at(now, level, place) };
        true
    }

    /// # Safety
    ///
    /// As for [`ready_at`](Self::ready_at), of the thread, the process and `level`; and the state
    /// is `now`: neither queued nor ended.
    #[inline(always)]
    pub(crate) unsafe fn queue_at(&self, now: u8, level: u8, place: QueueEnd) {
        self.state
            .store(now & !state::NEW | state::QUEUED, Ordering::Relaxed);
        let link = self.link();
        // SAFETY: the caller promises that the process stays where it is until it was popped; by
        // the invariant its link is in no queue.
        with_queue(|queue| unsafe {
            match place {
                QueueEnd::Front => queue.push_front(level, link),
                QueueEnd::Back => queue.push_back(level, link),
            }
        });
    }

    /// As [`ready_at`](Self::ready_at), where that needs more than to queue it.
    ///
    /// # Safety
    ///
    /// As there: this is the executor's thread. The process is one of an executor's, and stays
    /// where it is until it was popped. `level` is below [`LEVELS`](super::LEVELS).
    #[cold]
    pub(crate) unsafe fn ready_more(&self, level: u8, place: QueueEnd) -> bool {
        let queued = self.link.level.get();
        let now = self.state.load(Ordering::Relaxed);
        if now & state::ENDED != 0 {
            // Its link may have left the queue already, though it still counts as queued.
            return false;
        }
        if now & (state::QUEUED | state::YIELDED) == 0 {
            events::ready(|| self.id.get());
            // SAFETY: the caller's promises hold, and the process is neither queued nor ended.
            unsafe { self.queue_at(now, level, place) };
        } else if now & state::QUEUED != 0 && queued < level {
            // A more urgent branch of it has become ready: the process is queued at the level of
            // the most urgent one.
            let link = self.link();
            // SAFETY: the caller promises that this is the executor's thread. The process is queued
            // and has not ended: only the end takes a link off without clearing that, so the link
            // is in this thread's queue.
            with_queue(|queue| unsafe {
                queue.remove(link);
                match place {
                    QueueEnd::Front => queue.push_front(level, link),
                    QueueEnd::Back => queue.push_back(level, link),
                }
            });
        }
        true
    }

    /// Begins its turn. On the executor's thread.
    #[inline]
    pub(crate) fn begin_turn(&self) {
        self.state.store(state::RUNNING, Ordering::Relaxed);
    }

    /// Counts a poll. On the executor's thread.
    #[inline]
    pub fn count_poll(&self) {
        let polls = self.polls.load(Ordering::Relaxed);
        self.polls.store(polls.wrapping_add(1), Ordering::Relaxed);
    }

    /// Takes back the count of a turn in which the body is not polled. On the executor's thread.
    pub fn uncount_poll(&self) {
        let polls = self.polls.load(Ordering::Relaxed);
        self.polls.store(polls.wrapping_sub(1), Ordering::Relaxed);
    }

    /// Ends its turn, and queues it if it has yielded.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, as for `keep_traced`, and the
    /// process has its turn.
    #[inline]
    pub unsafe fn end_turn(&self) {
        let now = self.state.load(Ordering::Relaxed);
        if now & state::ENDED != 0 {
            return;
        }
        let rest = now & !(state::RUNNING | state::YIELDED);
        self.state.store(rest, Ordering::Relaxed);
        if now & state::YIELDED != 0 {
            // SAFETY: it has yielded in a plain turn: it is a process of an executor, and this is
            // the executor's thread. Its executor keeps it until it was popped.
            unsafe { self.ready_at(self.level(), QueueEnd::Back) };
        }
    }

    /// Ends a turn of a process of an executor. One compare if the process waits, as after nearly
    /// all turns.
    ///
    /// # Safety
    ///
    /// This is the executor's thread. The process lives until it was popped. A process that is
    /// returned is given a turn, or [put back](crate::current::put_back).
    #[inline(always)]
    pub unsafe fn after_turn(&self) -> AfterTurn {
        const WAITS: u8 = state::RUNNING;
        const YIELDS: u8 = state::RUNNING | state::YIELDED;
        const READY: u8 = state::RUNNING | state::QUEUED;
        let now = self.state.load(Ordering::Relaxed);
        if now == WAITS {
            self.state.store(0, Ordering::Relaxed);
            return AfterTurn::Nothing;
        }
        if now == YIELDS {
            self.state.store(state::QUEUED, Ordering::Relaxed);
            // SAFETY: the caller promises that this is the executor's thread and that the process
            // lives until it was popped; it is not queued, by its state.
            let next = unsafe {
                let link = self.link();
                with_queue(|queue| queue.exchange(self.level(), link))
            };
            return AfterTurn::Next(next.cast());
        }
        if now == READY {
            self.state.store(state::QUEUED, Ordering::Relaxed);
            return AfterTurn::Nothing;
        }
        cold_path();
        AfterTurn::More
    }

    /// Makes the current process yield at the end of its turn. If it is queued already, it stays at
    /// the higher of the two levels.
    #[inline(always)]
    pub(crate) fn yield_at_end(&self) {
        let now = self.state.load(Ordering::Relaxed);
        self.state.store(now | state::YIELDED, Ordering::Relaxed);
    }

    /// For its waker: if this is the current process in a [plain turn](crate::current::plain_turn),
    /// it [yields](crate::current::yield_turn). `false`: it is not, and is to be readied. So is one
    /// that wakes itself in a branch: less urgent siblings then see that it is ready.
    #[inline(always)]
    pub fn yields_to_wake(&self) -> bool {
        let thread = local();
        let yields =
            ptr::eq(thread.plain.get(), self.waker_address()) && thread.branch.get().is_whole();
        if yields {
            self.yield_at_end();
        }
        yields
    }

    /// Whether the current process [yields at the end](Self::yield_at_end) of its turn.
    #[inline]
    pub(crate) fn yields(&self) -> bool {
        self.state.load(Ordering::Relaxed) & state::YIELDED != 0
    }

    /// Whether it has [failed](fail_current) in this turn. On the executor's thread.
    #[inline]
    pub fn has_failed(&self) -> bool {
        self.state.load(Ordering::Relaxed) & state::FAILED != 0
    }

    /// Whether its body has ended. From any thread.
    #[inline]
    pub(crate) fn has_ended(&self) -> bool {
        self.state.load(Ordering::Acquire) & state::ENDED != 0
    }

    /// How it has ended, as one of the [outcomes](state::OUTCOME). From any thread.
    #[cfg(not(loom))]
    #[inline]
    pub(crate) fn outcome(&self) -> Option<u8> {
        let now = self.state.load(Ordering::Acquire);
        (now & state::ENDED != 0).then_some(now & state::OUTCOME)
    }

    /// Ends a reference that was counted here, on the executor's thread. `false`: the process has
    /// ended, and nothing was counted.
    #[inline(always)]
    pub(crate) fn remove_unless_ended(&self) -> bool {
        let is_live = self.state.load(Ordering::Relaxed) & state::ENDED == 0;
        if is_live {
            self.references.remove_here();
        }
        is_live
    }

    /// Whether it is in its executor's run queue, or was popped for a turn that has not begun. On
    /// the executor's thread.
    #[inline]
    pub fn is_queued(&self) -> bool {
        self.state.load(Ordering::Relaxed) & state::QUEUED != 0
    }

    /// The link, as a pointer to all of the process' memory.
    #[inline(always)]
    pub(crate) fn link(&self) -> NonNull<Link> {
        self.whole().cast()
    }

    /// Marks the body as ended, with its outcome: the process is not readied any more, and does not
    /// yield. Nothing, if that was done before.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, as for `keep_traced`; or the process was
    /// never built.
    pub(crate) unsafe fn set_ended(&self, outcome: u8) {
        let now = self.state.load(Ordering::Relaxed);
        if now & state::ENDED == 0 {
            let rest = now & (state::QUEUED | state::RUNNING);
            // Release: a thread that sees the end sees what was before it. So no store follows.
            self.state
                .store(rest | state::ENDED | outcome, Ordering::Release);
            not_plain(self);
        }
    }

    /// What it is doing. From any thread.
    pub fn activity(&self) -> ProcessState {
        match self.state.load(Ordering::Acquire) {
            now if now & state::ENDED != 0 => ProcessState::Ended,
            now if now & state::RUNNING != 0 => ProcessState::Running,
            now if now & state::QUEUED != 0 => ProcessState::Ready,
            now if now & state::NEW != 0 => ProcessState::Created,
            _ => ProcessState::Waiting,
        }
    }

    /// Readies the process without its waker, `lowered` levels below its own.
    ///
    /// # Safety
    ///
    /// The caller holds a counted reference to the process, and this is not its executor's thread.
    #[inline]
    pub(crate) unsafe fn ready_elsewhere(&self, lowered: u8) {
        let level = self.lowered_priority(lowered).level;
        // SAFETY: the caller holds a reference, so the process is live; this is another thread than
        // the executor's, as `ready_elsewhere` requires.
        unsafe { (self.methods().ready_elsewhere)(self.whole(), level) };
    }
}

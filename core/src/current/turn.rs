//! The turn of the current process on this thread.

use super::branch::{Branch, lowered};
use super::{
    ExecutorId, OPERATIONS_PER_POLL, Priority, Process, ProcessId, QueueEnd, THREAD, Thread, User,
    WakeHandle, count_operation, is_outranked, local, ready_again,
};
use core::ptr::NonNull;
use core::task::{Context, Waker};
use luna_platform::on_drop::OnDrop;

/// Runs `poll` with `process` as the current one.
///
/// # Safety
///
/// This thread is that of the process' executor, and [`Process::end`] was not called.
#[inline]
pub unsafe fn with_process<R>(process: &Process, poll: impl FnOnce() -> R) -> R {
    process.begin_turn();
    let before = THREAD.with(|thread| {
        thread.operations_left.set(OPERATIONS_PER_POLL);
        thread.exchange_turn(Some(NonNull::from(process)), Branch::WHOLE)
    });
    let _restore = OnDrop::new(|| {
        // SAFETY: `with_process` requires that this is the executor's thread.
        unsafe { process.end_turn() };
        THREAD.with(|thread| thread.exchange_turn(before.0, before.1));
    });
    poll()
}

/// Runs `poll` with `process`, one of an executor's, as the current one. It stays the current one
/// until another has a turn or [`end_turns`] is called: so turns that follow each other do not
/// remove it. If `poll` panics, the code that catches the panic calls [`take_interrupted`]: so a
/// turn needs nothing that catches panics. The caller ends the turn by
/// [`Process::after_turn`] or [`Process::end_turn`].
///
/// # Safety
///
/// As for [`with_process`]: this is the executor's thread, and [`Process::end`] was not called. The
/// process lives until another has a turn, or it was taken by `end_turns` or `take_interrupted`.
#[inline(always)]
pub unsafe fn give_turn<R>(process: &Process, poll: impl FnOnce() -> R) -> R {
    process.begin_turn();
    let thread = local();
    thread.operations_left.set(OPERATIONS_PER_POLL);
    thread.process.set(Some(NonNull::from(process)));
    // Outside of turns the branch is the whole.
    thread.plain.set(process.waker_address());
    poll()
}

/// Ends a row of turns: from here on no process is the current one. Returns the id of the process
/// that was polled last. To be called before an executor does anything else than polling.
///
/// # Safety
///
/// No process is being polled on this thread: a [`PlainTurn`] relies on the current process.
#[inline]
pub unsafe fn end_turns() -> Option<ProcessId> {
    let thread = local();
    thread.plain.set(core::ptr::null());
    let last = thread.process.take()?;
    // SAFETY: `give_turn` requires that the process lives until it is taken here.
    Some(unsafe { last.as_ref() }.id())
}

/// Runs `f` as if there were no current process: for work in the middle of a turn that is not part
/// of it. If `f` panics, the turn goes on all the same.
///
/// # Safety
///
/// `f` uses no [`PlainTurn`] from before: there is no current process meanwhile.
pub unsafe fn outside<R>(f: impl FnOnce() -> R) -> R {
    let thread = local();
    let process = thread.process.take();
    let branch = thread.branch.replace(Branch::WHOLE);
    let plain = thread.plain.replace(core::ptr::null());
    let _restore = OnDrop::new(|| {
        thread.process.set(process);
        thread.branch.set(branch);
        thread.plain.set(plain);
    });
    f()
}

/// The process with the turn that a panic has ended; it is not the current one any more.
///
/// # Safety
///
/// If there is a current process, its turn was given by [`give_turn`], and its `poll` has unwound:
/// no code on this thread's stack relies on it as the current one.
pub unsafe fn take_interrupted() -> Option<NonNull<Process>> {
    THREAD.with(|thread| {
        let (process, _) = thread.exchange_turn(None, Branch::WHOLE);
        let process = process?;
        // SAFETY: the caller promises that the turn was given by `give_turn`, which requires that
        // the process lives until it is taken here.
        unsafe { process.as_ref().end_turn() };
        Some(process)
    })
}

/// A [plain turn](plain_turn) of the current process: the state of its thread.
///
/// Generic code gets it, in the user's crate, and passes it on to code that is not generic. There
/// the compiler takes an access to a thread-local for a call, and saves registers for it.
///
/// # Invariants
///
/// The current process stays the same as long as this is used: it borrows the waker of a poll, and
/// what removes the current
/// process during a poll is unsafe ([`end_turns`], [`outside`]).
#[derive(Clone, Copy)]
pub struct PlainTurn<'a>(&'a Thread);

impl<'a> PlainTurn<'a> {
    /// The present turn, if it is a plain one.
    #[inline(always)]
    pub fn of(cx: &Context<'a>) -> Option<PlainTurn<'a>> {
        let thread = local();
        core::ptr::eq(thread.plain.get(), cx.waker()).then_some(PlainTurn(thread))
    }

    /// Its thread, for locks.
    #[inline(always)]
    pub fn here(self) -> Here<'a> {
        Here(self.0)
    }

    /// The current process.
    #[inline(always)]
    pub fn process(self) -> &'a Process {
        // SAFETY: by the invariant there is a current process, and it stays the same. `give_turn`
        // requires that it lives as long as it is the current one.
        unsafe { self.0.process.get().unwrap_unchecked().as_ref() }
    }

    /// The id of the executor.
    #[inline(always)]
    pub fn executor_number(self) -> u64 {
        self.0.executor_id.get().map_or(0, ExecutorId::number)
    }

    /// Counts an operation that was done without waiting; `false`: the process is to
    /// [give way](Self::give_way), and nothing was counted.
    #[inline(always)]
    pub fn goes_on(self) -> bool {
        let left = self.0.operations_left.get();
        if left == 0 || self.0.queue.has_above(self.process().level()) {
            return false;
        }
        self.0.operations_left.set(left - 1);
        true
    }

    /// Counts an operation that is done; or yields, if more urgent processes are ready or the
    /// process has completed [`OPERATIONS_PER_POLL`] operations in this turn: then it is ready
    /// again already, and the caller returns `Pending`.
    #[inline(always)]
    pub fn yields_after_operation(self) -> bool {
        if self.goes_on() {
            return false;
        }
        self.give_way();
        true
    }

    /// Readies the process again: before the others of its level, if more urgent ones are ready,
    /// else behind them. The caller returns `Pending`.
    #[inline]
    pub fn give_way(self) {
        let place = match self.0.queue.has_above(self.process().level()) {
            true => QueueEnd::Front,
            false => QueueEnd::Back,
        };
        // SAFETY: it is the current process, of an executor: so this is its executor's thread, and
        // it lives until its executor has popped it.
        unsafe { self.process().ready_here(0, place) };
    }

    /// This thread's state, for tests of what does not ask for the process.
    #[cfg(test)]
    pub(crate) fn without_process() -> PlainTurn<'static> {
        PlainTurn(local())
    }

    #[inline(always)]
    pub(crate) fn thread_id(self) -> u32 {
        self.0.thread_id.get()
    }

    #[inline(always)]
    pub(crate) fn thread(self) -> &'a Thread {
        self.0
    }
}

luna_platform::debug_fields!(PlainTurn<'_>, |turn| process: turn.process());

/// The calling thread, as what locks ask for: looked up once, and passed on.
#[derive(Clone, Copy)]
pub struct Here<'a>(&'a Thread);

impl Here<'_> {
    /// The calling thread.
    #[inline(always)]
    pub fn now() -> Self {
        Here(local())
    }

    /// The id of its executor; 0 if it runs no processes.
    #[inline(always)]
    pub fn executor_number(self) -> u64 {
        self.0.executor_id.get().map_or(0, ExecutorId::number)
    }

    /// The current process, or none.
    #[inline(always)]
    pub fn user(self) -> User {
        match self.0.process.get() {
            // SAFETY: as for `process`: it is live as long as it is the current one.
            Some(process) => User::Process(unsafe { process.as_ref() }.id()),
            None => User::Outside,
        }
    }

    /// The priority of what runs here: see [`priority`].
    #[inline]
    pub fn priority(self) -> Priority {
        let lowered = self.0.branch.get().lowered();
        // SAFETY: as for `process`: it is live as long as it is the current one.
        let process = self
            .0
            .process
            .get()
            .map(|process| unsafe { process.as_ref() });
        process.map_or_else(Priority::default, |process| {
            process.lowered_priority(lowered)
        })
    }

    /// What it writes into a lock that is biased to its executor; 0 if it runs no processes.
    #[inline(always)]
    pub(crate) fn thread_id(self) -> u32 {
        self.0.thread_id.get()
    }
}

luna_platform::debug_fields!(Here<'_>, |here| executor: here.executor_number());

/// What a poll passes on to the operation that is polled: the state of its thread, and its waker.
/// Any poll has one; what is seldom asked is asked here as well.
///
/// # Invariants
///
/// As for [`PlainTurn`]: the current process stays the same as long as this is used.
#[derive(Clone, Copy)]
pub struct Turn<'a> {
    thread: &'a Thread,
    waker: &'a Waker,
}

impl<'a> Turn<'a> {
    /// Of the present poll.
    #[inline(always)]
    pub fn of(cx: &Context<'a>) -> Self {
        Turn {
            thread: local(),
            waker: cx.waker(),
        }
    }

    /// Its thread, for locks.
    #[inline(always)]
    pub fn here(self) -> Here<'a> {
        Here(self.thread)
    }

    /// The turn, if it is a [plain](plain_turn) one: that of a process, without a failed branch,
    /// a log or a waker of its own. One compare.
    #[inline(always)]
    pub fn plain(self) -> Option<PlainTurn<'a>> {
        core::ptr::eq(self.thread.plain.get(), self.waker).then_some(PlainTurn(self.thread))
    }

    /// The context, for code that has not been passed the turn yet.
    #[inline]
    pub fn context(self) -> Context<'a> {
        Context::from_waker(self.waker)
    }

    /// Whether its process has a replay log.
    #[inline(always)]
    pub fn has_replay_log(self) -> bool {
        self.thread.branch.get().has_replay_log()
    }

    /// Whether a sibling of the current branch has failed.
    #[inline(always)]
    pub fn branch_failed(self) -> bool {
        self.thread.branch.get().has_failed()
    }

    /// Its wake handle. It may clone a waker: not to be called under a lock.
    #[cold]
    pub fn wake_handle(self) -> WakeHandle {
        WakeHandle::of(&self.context())
    }

    /// Counts an operation that is done; or yields: see [`PlainTurn::yields_after_operation`].
    #[inline(always)]
    pub fn yields_after_operation(self) -> bool {
        match self.plain() {
            Some(turn) => turn.yields_after_operation(),
            None => self.yields_otherwise(),
        }
    }

    #[cold]
    #[inline(never)]
    fn yields_otherwise(self) -> bool {
        let place = match is_outranked() {
            true => QueueEnd::Front,
            false if count_operation() => return false,
            false => QueueEnd::Back,
        };
        ready_again(&self.context(), place);
        true
    }
}

luna_platform::debug_fields!(Turn<'_>, |turn| executor: turn.here().executor_number());

/// The current process, if its turn is a plain one: the process is an executor's, `cx` has its own
/// waker and no combinator's, its events are not traced and it has no replay log, and the branch
/// that is being polled, if any, has not failed and runs at the process' level. Nearly all polls
/// are plain. One compare: the waker lies in the process, so its address says which process it is.
#[inline(always)]
pub fn plain_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    PlainTurn::of(cx).map(PlainTurn::process)
}

/// Calls `f` with the current process, if there is one.
#[inline]
pub fn process<R>(f: impl FnOnce(Option<&Process>) -> R) -> R {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: the process is live. `with_process` sets the pointer from a reference that lives
    // until it restores the pointer before; `give_turn` requires that the process lives as long as
    // the pointer is set. The closure cannot keep the reference.
    f(current.map(|process| unsafe { process.as_ref() }))
}

/// The user of this thread: the current process, or [`User::Outside`].
#[inline]
pub fn user() -> User {
    process(|process| process.map_or(User::Outside, |process| User::Process(process.id())))
}

/// The priority of the current process, or of the branch of it that is being polled; the lowest
/// priority if there is none.
#[inline]
pub fn priority() -> Priority {
    process(|process| {
        process
            .map(|process| process.lowered_priority(lowered()))
            .unwrap_or_default()
    })
}

//! Whose turn it is on this thread.

use super::branch::{Branch, lowered};
use super::{OPERATIONS_PER_POLL, Priority, Process, THREAD, User};
use std::ptr::NonNull;
use std::task::Context;

/// Runs `poll` with `process` as the current one.
///
/// # Safety
///
/// This thread is the process' home, and the process has not ended.
#[inline]
pub unsafe fn with_process<R>(process: &Process, poll: impl FnOnce() -> R) -> R {
    struct Restore<'a> {
        running: &'a Process,
        process: Option<NonNull<Process>>,
        branch: Branch,
    }
    impl Drop for Restore<'_> {
        #[inline]
        fn drop(&mut self) {
            self.running.end_turn();
            THREAD.with(|thread| {
                thread.process.set(self.process);
                thread.branch.set(self.branch);
            });
        }
    }
    process.begin_turn();
    let _restore = THREAD.with(|thread| {
        thread.operations_left.set(OPERATIONS_PER_POLL);
        Restore {
            running: process,
            process: thread.process.replace(Some(NonNull::from(process))),
            branch: thread.branch.replace(Branch::WHOLE),
        }
    });
    poll()
}

/// Runs `poll` with `process`, one of an executor's, as the current one, where none was before. If `poll` panics, the process stays
/// the current one: whoever catches that asks [`take_interrupted`] for it. So a turn needs nothing that catches panics.
///
/// # Safety
///
/// As for [`with_process`]; and if the panic is caught, the process lives until it was taken.
#[inline]
pub unsafe fn give_turn<R>(process: &Process, poll: impl FnOnce() -> R) -> R {
    process.begin_turn();
    THREAD.with(|thread| {
        thread.operations_left.set(OPERATIONS_PER_POLL);
        thread.process.set(Some(NonNull::from(process)));
    });
    let polled = poll();
    THREAD.with(|thread| thread.process.set(None));
    process.end_turn();
    polled
}

/// Runs `f` as if no process had its turn: for what is done in the middle of one, and is none of its own. If `f` panics, the turn goes on all the same.
pub fn outside<R>(f: impl FnOnce() -> R) -> R {
    struct Restore(Option<NonNull<Process>>, Branch);
    impl Drop for Restore {
        fn drop(&mut self) {
            THREAD.with(|thread| {
                thread.process.set(self.0);
                thread.branch.set(self.1);
            });
        }
    }
    let _restore = THREAD.with(|thread| {
        Restore(
            thread.process.replace(None),
            thread.branch.replace(Branch::WHOLE),
        )
    });
    f()
}

/// The process whose turn a panic has ended; from here on it is not the current one any more.
///
/// # Safety
///
/// If there is a current process, its turn was given by [`give_turn`], whose `poll` has unwound:
/// nobody on this thread's stack relies on it as the current one.
pub unsafe fn take_interrupted() -> Option<NonNull<Process>> {
    THREAD.with(|thread| {
        thread.branch.set(Branch::WHOLE);
        let process = thread.process.take()?;
        // SAFETY: by the contract its turn was given by `give_turn`, whose caller keeps the process
        // until it is taken here.
        unsafe { process.as_ref() }.end_turn();
        Some(process)
    })
}

/// The current process, if its turn is a plain one: it is an executor's, `cx` has its own waker and no combinator's, and no branch of it is
/// being polled that failed or runs at another level. Nearly all polls are.
#[inline(always)]
pub fn plain_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    turn(cx, Process::is_owned)
}

/// As [`plain_turn`], of a process whose events nobody records ([`Process::set_recorded`]): so who asks for this tells none of it.
#[inline(always)]
pub fn unrecorded_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    turn(cx, Process::is_owned_unrecorded)
}

#[inline(always)]
fn turn<'a>(cx: &Context<'a>, is_owned: impl FnOnce(&Process) -> bool) -> Option<&'a Process> {
    let (current, branch) = THREAD.with(|thread| (thread.process.get(), thread.branch.get()));
    // SAFETY: the pointer is that of a process which is being polled, so it is live now. It is live for longer if its waker is what `cx`
    // borrows, since the waker lies in it.
    let process = unsafe { &*current?.as_ptr() };
    (process.is_polled_by(cx) && branch.is_plain() && is_owned(process)).then_some(process)
}

/// The process whose turn this is, for who knows that there is one.
///
/// # Safety
///
/// There is one, and its turn lasts as long as the reference is used.
#[inline(always)]
pub unsafe fn this_process<'a>() -> &'a Process {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: the contract; a process that is being polled is live.
    unsafe { &*current.unwrap_unchecked().as_ptr() }
}

/// Calls `f` with the current process, if there is one.
#[inline]
pub fn process<R>(f: impl FnOnce(Option<&Process>) -> R) -> R {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: `with_process` sets the pointer from a reference that lives until it restores the one before, and the closure
    // cannot keep what it is lent.
    f(current.map(|process| unsafe { process.as_ref() }))
}

/// Who is at work on this thread: the current process, or somebody outside of all.
#[inline]
pub fn user() -> User {
    process(|process| process.map_or(User::Outside, |process| User::Process(process.id())))
}

/// How urgent the current process is, or the branch of it that is being polled; the lowest priority where there is none.
#[inline]
pub fn priority() -> Priority {
    process(|process| {
        process
            .map(|process| process.lowered_priority(lowered()))
            .unwrap_or_default()
    })
}

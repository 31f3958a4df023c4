//! The turn of the current process on this thread.

use super::branch::{Branch, lowered};
use super::{OPERATIONS_PER_POLL, Priority, Process, THREAD, User};
use std::ptr::NonNull;
use std::task::Context;

/// Runs `poll` with `process` as the current one.
///
/// # Safety
///
/// This thread is that of the process' executor, and the process has not ended.
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

/// Runs `poll` with `process`, one of an executor's, as the current one, where none was before. If
/// `poll` panics, the process stays the current one: the code that catches the panic calls
/// [`take_interrupted`]. So a turn needs nothing that catches panics.
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

/// Runs `f` as if there were no current process: for work in the middle of a turn that is not part
/// of it. If `f` panics, the turn goes on all the same.
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

/// The process with the turn that a panic has ended; it is not the current one any more.
///
/// # Safety
///
/// If there is a current process, its turn was given by [`give_turn`], and its `poll` has unwound:
/// no code on this thread's stack relies on it as the current one.
pub unsafe fn take_interrupted() -> Option<NonNull<Process>> {
    THREAD.with(|thread| {
        thread.branch.set(Branch::WHOLE);
        let process = thread.process.take()?;
        // SAFETY: the caller promises that the turn was given by `give_turn`, which requires that
        // the process lives until it is taken here.
        unsafe { process.as_ref() }.end_turn();
        Some(process)
    })
}

/// The current process, if its turn is a plain one: the process is an executor's, `cx` has its own
/// waker and no combinator's, and the branch that is being polled, if any, has not failed and runs
/// at the process' level. Nearly all polls are plain.
#[inline(always)]
pub fn plain_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    turn(cx, Process::is_owned)
}

/// As [`plain_turn`], for a process that is not recorded ([`Process::set_recorded`]): the caller
/// need not record events.
#[inline(always)]
pub fn unrecorded_turn<'a>(cx: &Context<'a>) -> Option<&'a Process> {
    turn(cx, Process::is_owned_unrecorded)
}

#[inline(always)]
fn turn<'a>(cx: &Context<'a>, is_owned: impl FnOnce(&Process) -> bool) -> Option<&'a Process> {
    let (current, branch) = THREAD.with(|thread| (thread.process.get(), thread.branch.get()));
    // SAFETY: the pointer is that of a process which is being polled, so it is live now. If the
    // waker that `cx` borrows is the process' own, the process lives as long as that borrow, since
    // the waker lies in it.
    let process = unsafe { &*current?.as_ptr() };
    (process.is_polled_by(cx) && branch.is_plain() && is_owned(process)).then_some(process)
}

/// The current process, for callers that know that there is one.
///
/// # Safety
///
/// There is one, and its turn lasts as long as the reference is used.
#[inline(always)]
pub unsafe fn this_process<'a>() -> &'a Process {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: the caller promises that there is a current process; a process that is being polled
    // is live.
    unsafe { &*current.unwrap_unchecked().as_ptr() }
}

/// Calls `f` with the current process, if there is one.
#[inline]
pub fn process<R>(f: impl FnOnce(Option<&Process>) -> R) -> R {
    let current = THREAD.with(|thread| thread.process.get());
    // SAFETY: `with_process` sets the pointer from a reference that lives until it restores the one
    // before, and the closure cannot keep the reference.
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

//! The processes of this thread's executor: how they begin, have their turns, are woken, and leave.

use super::end::Abandoned;
use super::{AfterTurn, Notice, Process, ProcessRef, QueueEnd};
use crate::current::{self, with_processes};
use crate::events;
use crate::executor::Shared;
use crate::interference;
use crate::remote_wakes::RemoteWakes;
use alloc::borrow::ToOwned;
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::mem;
use core::ptr::NonNull;
use core::task::{Context, Poll};
use luna_platform::panics::{catch_unwind, resume};

/// The processes of an executor that are built and have not ended, found by their wake slots.
///
/// # Invariants
///
/// Each is live, and has its slot.
pub(crate) struct Processes(RemoteWakes<NonNull<Process>>);

impl Processes {
    pub(crate) const fn new() -> Self {
        Self(RemoteWakes::new())
    }

    pub(crate) fn count(&self) -> usize {
        self.0.count()
    }
}

/// How many processes this thread's executor has.
pub(crate) fn count() -> usize {
    with_processes(|own| own.count())
}

/// The processes of this thread's executor. Allocates.
pub(crate) fn records() -> Vec<ProcessRef> {
    with_processes(|own| {
        let members = own.0.members();
        // SAFETY: by the invariant they are live.
        let processes = members.map(|process| ProcessRef::to(unsafe { process.as_ref() }));
        processes.collect()
    })
}

/// Queues the processes that other threads have woken at `level`. O(their number).
pub(crate) fn queue_woken(shared: &Shared, level: u8) {
    with_processes(|own| {
        shared.inbound.take(level, &own.0, |process| {
            // SAFETY: by the invariant it is live, and this is its executor's thread.
            unsafe {
                // What it had inherited may have been given back meanwhile, or the wake was one of
                // the slot's former owner.
                let process = process.as_ref();
                process.ready_at(level.min(process.level()), QueueEnd::Back);
            }
        });
    });
}

/// As [`Methods`](super::Methods) require.
///
/// # Safety
///
/// The process is referred to, and has a slot.
pub(super) unsafe fn ready_elsewhere(process: NonNull<Process>, level: u8) {
    // SAFETY: the caller promises that the process is referred to, so it is live, and that it has a
    // slot.
    let (process, slot) = unsafe { (process.as_ref(), process.as_ref().slot()) };
    events::ready(|| process.id.get());
    if let (Some(executor), Some(slot)) = (&process.record.executor, slot) {
        executor.inbound.wake(slot, level);
    }
}

/// Gives a process that was just built its slot, and queues it.
///
/// # Safety
///
/// This is its executor's thread, which has just built it.
pub(super) unsafe fn start(process: NonNull<Process>) {
    // SAFETY: the caller promises a process that has not ended, so it is live; it is not polled
    // yet.
    let this = unsafe { process.as_ref() };
    if events::is_on() {
        this.notify(Notice::TRACED);
        // SAFETY: this is its executor's thread, and it was not readied yet.
        unsafe { this.set_traced() };
    }
    let slot = with_processes(|own| own.0.enter(process));
    // SAFETY: as above; it is built once.
    unsafe { this.set_slot(slot) };
    let name = || (*this.record.name).to_owned();
    events::name_process(this.id.get(), this.own_level, name);
    // SAFETY: this is its executor's thread. It is taken out of the queue before it goes.
    unsafe { this.ready_at(this.own_level, QueueEnd::Back) };
}

/// Polls the process that has this turn. If that panics, the caller must call [`interrupted`].
/// Returns the process that has the next turn, if this one has yielded to it.
///
/// # Safety
///
/// `process` was just taken from this thread's run queue. What is returned is run next, or
/// [put back](current::put_back).
#[inline(always)]
#[must_use = "the process that is returned is in no queue"]
pub(crate) unsafe fn run(process: NonNull<Process>) -> Option<NonNull<Process>> {
    // SAFETY: a process in the queue of its executor has not ended, so it is live, and its waker is
    // its own. Nothing else accesses its body.
    unsafe {
        let this = process.as_ref();
        let mut cx = Context::from_waker(this.waker().unwrap_unchecked());
        this.count_poll();
        current::give_turn(this, || Process::poll(process, &mut cx));
        match this.after_turn() {
            AfterTurn::Nothing => None,
            AfterTurn::Next(next) => Some(next),
            AfterTurn::More => {
                finish_turn(process);
                None
            }
        }
    }
}

/// Ends a turn in which the process has ended or failed, or has yielded while it was queued. Or the
/// turn is traced.
///
/// # Safety
///
/// This is its executor's thread, and the process has had its turn just now.
#[inline(never)]
unsafe fn finish_turn(process: NonNull<Process>) {
    // SAFETY: the caller promises the executor's thread and a process whose turn is just over. Only
    // `leave`, the last call, may free it. The poll is over, so nothing else accesses a body that
    // has not ended, as `abandon` requires.
    unsafe {
        let this = process.as_ref();
        if this.has_failed() && !this.has_ended() {
            (this.methods().of_body.abandon)(process, Abandoned::Failed);
        }
        if this.has_ended() {
            return leave(process);
        }
        this.end_turn();
        if this.has_notice(Notice::TRACED) {
            events::end_turn(this.id.get(), this.is_queued());
        }
    }
}

/// Polls a process with [notices](Notice).
///
/// # Safety
///
/// As for [`Methods::poll`](super::Methods): it has its turn on its executor's thread, and its body
/// has not ended.
#[cold]
pub(super) unsafe fn poll_attentively(process: NonNull<Process>, cx: &mut Context<'_>) {
    // SAFETY: the caller promises the turn of a live process, whose body has not ended. It is
    // abandoned only if the poll has not ended it.
    unsafe {
        let this = process.as_ref();
        let methods = this.methods();
        let abandon = |abandoned| (methods.of_body.abandon)(process, abandoned);
        if this.is_cancelled() {
            this.uncount_poll();
            return abandon(Abandoned::Cancelled);
        }
        if this.has_notice(Notice::TRACED) {
            events::begin_turn(this.id.get());
            this.keep_traced();
        }
        this.begin_poll();
        let mut poll = |cx: &mut Context<'_>| {
            (methods.poll)(process, cx);
            match this.has_ended() {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        };
        let polled = catch_unwind(|| match this.log_installer() {
            None => poll(cx),
            Some(log_installer) => log_installer.poll(cx, &mut poll),
        });
        if this.has_ended() {
            // Its end is published. Dropping what a panic carried could panic in turn.
            return mem::forget(polled);
        }
        this.end_poll();
        match polled {
            Err(payload) => abandon(Abandoned::Panicked(payload)),
            Ok(Poll::Ready(())) => abandon(Abandoned::Over),
            Ok(Poll::Pending) if this.is_cancelled() => abandon(Abandoned::Cancelled),
            Ok(Poll::Pending) => {}
        }
    }
}

/// No process is the current one from here on, until the next turn: to be called before an executor
/// does anything else than polling.
///
/// # Safety
///
/// No process is being polled on this thread.
#[inline]
pub(crate) unsafe fn end_turns() {
    // SAFETY: the caller promises that no process is being polled on this thread: no turn is relied
    // on.
    if let Some(last) = unsafe { current::end_turns() } {
        interference::polled(last);
    }
}

/// Runs rounds of turns; ends the process that panics in one. Catching it here and not around each
/// poll saves that. A panic outside of any turn is the thread's own, and goes on.
pub(crate) fn turns(rounds: impl FnOnce()) {
    let Err(payload) = catch_unwind(rounds) else {
        return;
    };
    let Some(process) = current::process(|process| process.map(Process::whole)) else {
        resume(payload);
    };
    // SAFETY: it is the current process, with a turn of this thread's executor. Its poll has
    // unwound, so nothing accesses its body, unless that has ended: then it belongs to those that
    // take its exit value.
    unsafe {
        match process.as_ref().has_ended() {
            // Dropping the payload could panic in turn.
            true => mem::forget(payload),
            false => {
                (process.as_ref().methods().of_body.abandon)(process, Abandoned::Panicked(payload));
            }
        }
        current::take_interrupted();
        interference::polled(process.as_ref().id);
        leave(process);
    }
}

/// Ends all processes of this thread's executor as panicked, after a panic outside of any process
/// has ended the thread's work. The channel ends in their bodies poison their channels. A body that
/// panics when it is dropped does not stop the drop of the others. The executor builds no process
/// meanwhile. O(processes), and what the drops take. Allocates.
pub(crate) fn end_all(why: &str) {
    let mut number = 0;
    while let Some(process) = with_processes(|own| own.0.next(&mut number)) {
        // SAFETY: by the invariant it is live and has not ended. This is its executor's thread,
        // where no process has a turn: so nothing else accesses the body.
        unsafe {
            let this = process.as_ref();
            current::unqueue(this);
            let ended = catch_unwind(|| {
                current::give_turn(this, || {
                    current::poison_dropped_ends(|| {
                        let payload = Abandoned::Panicked(Box::new(why.to_owned()));
                        (this.methods().of_body.abandon)(process, payload);
                    });
                });
            });
            // Dropping what a panic carried could panic in turn.
            mem::forget(ended);
            current::take_interrupted();
            leave(process);
        }
    }
}

/// Reports the end of a process, which is in no queue from here on. It may be freed.
///
/// # Safety
///
/// Its body has ended in a turn just now, which is over. This is its executor's thread.
#[cold]
unsafe fn leave(process: NonNull<Process>) {
    // SAFETY: the caller promises that the turn is over, and that the body has ended just now: so
    // this is the only call, and the process is live until `end` frees it, if at all.
    unsafe {
        end_turns();
        let this = process.as_ref();
        debug_assert!(this.has_ended());
        current::unqueue(this);
        if let Some(slot) = this.slot() {
            with_processes(|own| own.0.leave(slot.number()));
        }
        this.report();
        Process::end(process);
    }
}

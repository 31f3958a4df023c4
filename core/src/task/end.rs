//! The end of a task: its report, its retirement, and its memory.

use super::body::Whole;
use super::{REMOTE_WAKES, Task, another_reference, end_turns, memory};
use crate::current::{self, Process};
use crate::deferred_free::Retired;
use crate::process::{Abandoned, Notice, RecordRef};
use crate::{executor, interference};
use alloc::borrow::ToOwned;
use alloc::boxed::Box;
use alloc::sync::Arc;
use core::any::Any;
use core::future::Future;
use core::mem::{self, ManuallyDrop, offset_of};
use core::ptr::NonNull;
use luna_platform::panics::catch_unwind;

/// Ends the process in the turn of which the panic occurred. If there is none, returns the payload:
/// the panic is the thread's own.
pub(crate) fn interrupted(payload: Box<dyn Any + Send>) -> Result<(), Box<dyn Any + Send>> {
    // SAFETY: on this thread only tasks have turns, which have owners.
    let owner = current::process(|process| Some(unsafe { process?.owner() }));
    let Some(owner) = owner else {
        return Err(payload);
    };
    let task = owner.cast::<Task>();
    // SAFETY: it is the current process. Its poll has unwound, so nothing accesses its body, unless
    // that has ended: then it belongs to those that take its exit value. Its methods are those of a
    // task: on this thread only tasks have turns.
    unsafe {
        match task.as_ref().process.has_ended() {
            // Dropping the payload could panic in turn.
            true => mem::forget(payload),
            false => (task.as_ref().methods().abandon)(task, Abandoned::Panicked(payload)),
        }
        if current::take_interrupted().is_some() {
            interference::polled(task.as_ref().process.id());
            end(task);
        }
    }
    Ok(())
}

/// Ends all tasks of this thread's executor as panicked, after a panic outside of any process has
/// ended the thread's work. The channel ends in their bodies poison their channels. A body that
/// panics when it is dropped does not stop the drop of the others. The executor builds no process
/// meanwhile. O(tasks), and what the drops take. Allocates.
pub(crate) fn end_all(why: &str) {
    let mut number = 0;
    loop {
        // First the queued tasks: a turn belongs to a task that is not queued. A drop may queue
        // others. SAFETY: each dequeued task is given a turn below, before anything else is done,
        // or retired.
        let queued = unsafe { current::next_ready() }.map(NonNull::cast::<Task>);
        let next = queued
            .or_else(|| REMOTE_WAKES.with_borrow(|remote_wakes| remote_wakes.next(&mut number)));
        let Some(task) = next else {
            return;
        };
        // SAFETY: a task is retired only when it is not queued, and then has no wake slot, so this
        // one is live. It is not queued now, this is its executor's thread, and no process has a
        // turn.
        unsafe {
            match (task.as_ref().record.has_ended(), queued) {
                (false, _) => end_left(task, why),
                (true, Some(_)) => retire(task),
                (true, None) => {}
            }
        }
    }
}

/// Ends a task in a turn in which it is not polled.
///
/// # Safety
///
/// `task` is live, not queued, and has not ended. This is its executor's thread, where no process
/// has a turn.
pub(super) unsafe fn end_left(task: NonNull<Task>, why: &str) {
    // SAFETY: the caller promises a task that has not ended, on its executor's thread, where no
    // process has a turn: so nothing else accesses the body, and the task lives until it is
    // retired, at the end.
    unsafe {
        let this = task.as_ref();
        let ended = catch_unwind(|| {
            current::give_turn(&this.process, || {
                current::poison_dropped_ends(|| {
                    let payload = Box::new(why.to_owned());
                    (this.methods().abandon)(task, Abandoned::Panicked(payload));
                });
            });
            this.process.end_turn();
        });
        if let Err(payload) = ended {
            // Dropping it could panic in turn.
            core::mem::forget(payload);
            current::take_interrupted();
        }
        end(task);
    }
}

/// Reports the end of a process, and retires its task.
///
/// # Safety
///
/// The body of the task has ended in a turn just now. This is its executor's thread.
#[cold]
pub(super) unsafe fn end(task: NonNull<Task>) {
    // SAFETY: the task's turn is over. It may be freed below.
    unsafe { end_turns() };
    // SAFETY: the caller promises that the body has ended just now, on this thread, its executor's:
    // so the task was not retired before, and is live. This thread has a reference to the
    // executor's part that others see, so the registry outlives the task. Without a reference to
    // the process nothing reads its waker any more: its record has finished, so no other thread
    // finds it there.
    unsafe {
        let this = task.as_ref();
        let registry = &(*Arc::as_ptr(&this.shared)).registry;
        if this.process.is_queued() {
            // It retires when its turn comes.
            this.process.notify(Notice::ENDED);
            another_reference(task).report(registry);
        } else if this.process.is_unreferenced() {
            leave(task);
            // The waker's reference is passed on.
            mem::forget(this.process.take_waker());
            RecordRef::from_raw(Task::record(task)).report(registry);
        } else {
            another_reference(task).report(registry);
            retire(task);
        }
    }
}

/// Gives the wake slot of a task back.
///
/// # Safety
///
/// As for [`retire`]: its body has ended, it is not queued and was not retired before. This is its
/// executor's thread.
pub(super) unsafe fn leave(task: NonNull<Task>) {
    // SAFETY: the caller promises that the task was not retired before, so it is live.
    let number = unsafe { task.as_ref() }.slot.number();
    REMOTE_WAKES.with_borrow_mut(|remote_wakes| remote_wakes.leave(number));
}

/// # Safety
///
/// The body of the task has ended, the task is not queued, and it was not retired before. This is
/// its executor's thread.
#[cold]
pub(super) unsafe fn retire(task: NonNull<Task>) {
    // SAFETY: the process is not polled again, and this is its executor's thread. Pending wakes and
    // wakers keep the task alive themselves.
    unsafe {
        leave(task);
        Process::end(task.cast());
    }
}

/// Drops the waker that a task has of itself: its process has ended, and no pending wake refers to
/// it any more.
///
/// # Safety
///
/// As `free` of [`Methods`](crate::current::Methods) says: the process has ended, and there is
/// no reference to it. `owner` is the task.
pub(super) unsafe fn free(owner: NonNull<()>) {
    // SAFETY: the caller promises that the process has ended and has no reference, so nothing reads
    // its waker any more. That waker keeps the task until it is dropped, which is the last step
    // here.
    unsafe {
        drop(owner.cast::<Task>().as_ref().process.take_waker());
    }
}

/// # Safety
///
/// `head` begins the record of a `Whole<F, B>` to which no reference remains. Its body has ended,
/// or was never built.
pub(super) unsafe fn free_retired<F: Future, B>(head: NonNull<Retired>) {
    // SAFETY: the caller promises that no reference remains, so this alone accesses the whole,
    // which `Unbuilt::new` allocated, by the pointer to all of it. A task with a wake slot has a
    // process. What is left of the body is its exit value, which can go on any thread, and belongs
    // to the record until that is dropped.
    unsafe {
        let whole = head
            .byte_sub(offset_of!(Task, record))
            .cast::<Whole<F, B>>();
        let task = &raw mut (*whole.as_ptr()).task;
        let skipped = (*task).skipped;
        let shared = ManuallyDrop::take(&mut (*task).shared);
        if (*task).slot.is_taken() {
            ManuallyDrop::drop(&mut (*task).process.process);
        }
        (&raw mut (*task).slot).drop_in_place();
        (&raw mut (*task).record).drop_in_place();
        (&raw mut (*whole.as_ptr()).body).drop_in_place();
        executor::give_back(shared);
        memory::free(whole, skipped);
    }
}

//! The task of a process on an executor: its body in one allocation with its record and all that is
//! needed to build, wake, queue, poll and free it.
//!
//! ```text
//!              waker or handle, from elsewhere      +--> slot and signal (inbound), then as below
//!             /                                     |
//!   waiting -<--------------------------------------+
//!             \                                     |
//!              waker or handle, on this thread      +--> run queue --> run --> Body::poll
//! ```
//!
//! On the executor's own thread a wake is a flag and a push, without atomics. A process that wakes
//! itself is pushed when its turn is over, but in a branch at once. From another thread a wake is a
//! fixed number of instructions, none of which relies on another waker to continue
//! ([`remote_wakes`](crate::remote_wakes)). A waker that is preempted half-way blocks no other
//! thread.
//!
//! A task is made with what builds its body, on any thread ([`Unbuilt`]). It is built, polled, and
//! its body dropped, on its executor's thread alone. It is *retired* when its body has ended and it
//! is in no queue. Its memory is freed when no reference to it remains: pending wakes are counted
//! in its [`current::Process`]; handles and wakers in its [`Record`]. The process' own waker stands
//! for all pending wakes among them. When nothing but the record's references is left, it becomes
//! that of the list of processes that have ended. Memory that becomes free on the real-time path is
//! freed off it (deferred free), except by a spawn: it frees the memory of the processes that have
//! ended, as it allocates that of the new one.

mod body;
mod end;
mod memory;
mod unbuilt;
mod waker;

pub(crate) use end::{end_all, interrupted};
pub(crate) use unbuilt::{Arrivals, Unbuilt};

use self::body::BodyMethods;
use self::end::{end, retire};
use crate::current::{self, AfterTurn, Methods, Process, QueueEnd};
use crate::events;
use crate::executor::Shared;
use crate::interference;
use crate::process::{self, Abandoned, Notice, Record, RecordRef};
use crate::remote_wakes::{RemoteWakes, WakeSlot};
use alloc::borrow::ToOwned;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::cell::RefCell;
use core::mem::ManuallyDrop;
use core::ops::Deref;
use core::ptr::NonNull;
use core::task::{Context, Poll};

luna_platform::local! {
    /// The tasks of this thread's executor that are not retired.
    static REMOTE_WAKES: RefCell<RemoteWakes<NonNull<Task>>> =
        const { RefCell::new(RemoteWakes::new()) };
}

/// The tasks of one of several executors that share a thread, while another has its turn.
pub(crate) struct Tasks(RemoteWakes<NonNull<Task>>);

impl Tasks {
    pub(crate) const fn new() -> Self {
        Self(RemoteWakes::new())
    }

    /// How many have not been retired.
    pub(crate) fn count(&self) -> usize {
        self.0.count()
    }

    /// Makes these tasks the thread's, and keeps the former ones here: called before a turn and
    /// after it.
    pub(crate) fn exchange(&mut self) {
        REMOTE_WAKES.with_borrow_mut(|remote_wakes| core::mem::swap(remote_wakes, &mut self.0));
    }
}

/// The part of a task that does not depend on its body, which lies behind it.
///
/// # Invariants
///
/// It is the first field of a [`Whole`](body::Whole), in [memory] of its own. All pointers to it,
/// and to its record, derive from the pointer to the whole. There is a borrow of all of it only
/// once it is built, and then it has a wake slot. Only the executor's thread touches a body that is
/// built and has not ended. The record's references keep the whole. The process has an owner, the
/// task, and until it has ended and has no reference a waker, which is one of the record's
/// references.
#[repr(C)]
struct Task {
    /// First, so that task and process have the same address.
    process: Head,
    record: Record,
    /// Dropped when the task is freed.
    shared: ManuallyDrop<Arc<Shared>>,
    slot: WakeSlot,
    /// How many bytes in front of the task belong to its memory.
    skipped: u8,
}

/// The process of a task that is built; before that, how it is built.
union Head {
    unbuilt: &'static unbuilt::Methods,
    process: ManuallyDrop<Process>,
}

impl Deref for Head {
    type Target = Process;

    #[inline(always)]
    fn deref(&self) -> &Process {
        // SAFETY: the task's invariant: what borrows it finds it built.
        unsafe { &self.process }
    }
}

impl Task {
    /// Its record, built or not.
    ///
    /// # Safety
    ///
    /// The task is live.
    #[inline]
    unsafe fn record(this: NonNull<Task>) -> NonNull<Record> {
        // SAFETY: the caller promises that the task is live, so its record lies in its memory, not
        // at null.
        unsafe { NonNull::new_unchecked(&raw mut (*this.as_ptr()).record) }
    }

    /// # Safety
    ///
    /// Its process has an owner, the task.
    unsafe fn methods(&self) -> &'static BodyMethods {
        // SAFETY: the caller promises that the process has an owner, so its methods were set with
        // it.
        let seldom = unsafe { self.process.methods() }.seldom;
        let methods = seldom.and_then(|methods| methods.downcast_ref());
        methods.expect("`start` has said them")
    }
}

/// Makes the process of a task that has a body, and queues it.
///
/// # Safety
///
/// The body was just built, on this thread, which is its executor's. `methods` are those of this
/// kind of task.
unsafe fn start(task: NonNull<Task>, methods: &'static Methods) {
    let head = task.as_ptr();
    // SAFETY: no other code has a pointer to more of the task than its record, so nothing polls it.
    // It stays in place until `free` is called, and is ended once, by `end`.
    unsafe {
        let (record, shared) = (&(*head).record, &(*head).shared);
        let level = record.level();
        // In its place, where nothing is dropped: what was there says how it was built.
        let place = (&raw mut (*head).process).cast::<Process>();
        let (id, executor_id) = (record.id, shared.executor_id);
        place.write(Process::new(
            id,
            executor_id,
            shared.thread_priority(),
            level,
        ));
        let slot = REMOTE_WAKES.with_borrow_mut(|remote_wakes| remote_wakes.enter(task));
        (&raw mut (*head).slot).write(slot);
        let this = task.as_ref();
        this.process.set_waker(waker::first(task));
        this.process.set_owner(task.cast(), methods);
        let notices = this.record.notices();
        if notices != 0 {
            this.process.notify(notices);
            if notices & Notice::TRACED != 0 {
                this.process.set_traced();
            }
        }
        this.record.set_process(NonNull::from(&*this.process));
        let (id, name) = (this.record.id, || (*this.record.name).to_owned());
        events::name_process(id.get(), level, name);
        this.process.ready_at(level, QueueEnd::Back);
    }
}

/// How many tasks of this thread's executor have not been retired.
pub(crate) fn count() -> usize {
    REMOTE_WAKES.with_borrow(RemoteWakes::count)
}

/// The processes of this thread's executor that have not been retired. Allocates.
pub(crate) fn records() -> Vec<RecordRef> {
    REMOTE_WAKES.with_borrow(|remote_wakes| {
        // SAFETY: a task that has a wake slot is not retired, so it is live.
        let record = |task: NonNull<Task>| unsafe { another_reference(task) };
        remote_wakes.members().map(record).collect()
    })
}

/// Queues the processes that other threads have woken at `level`. O(their number).
pub(crate) fn queue_woken(shared: &Shared, level: u8) {
    REMOTE_WAKES.with_borrow(|remote_wakes| {
        shared.inbound.take(level, remote_wakes, |task| {
            // SAFETY: a task that has a wake slot is not retired, so it is live, and this is its
            // executor's thread.
            unsafe {
                // What it had inherited may have been given back meanwhile, or the wake was one of
                // the slot's former owner.
                let process = &task.as_ref().process;
                process.ready_at(level.min(process.level()), QueueEnd::Back);
            }
        });
    });
}

/// One more reference to the record of a task.
///
/// # Safety
///
/// The task is live, and stays so during the call.
unsafe fn another_reference(task: NonNull<Task>) -> RecordRef {
    // SAFETY: the caller promises that the task is live during the call, and the reference that is
    // made was counted. By the task's invariant the pointer is one to all of its memory.
    unsafe {
        let record = Task::record(task);
        record.as_ref().count_one_more();
        RecordRef::from_raw(record)
    }
}

/// As [`Methods::ready_elsewhere`] requires.
///
/// # Safety
///
/// `owner` is a task that is referred to.
unsafe fn ready_elsewhere(owner: NonNull<()>, level: u8) {
    // SAFETY: the caller promises that the task is referred to: that keeps it, and with it its
    // executor's part that others see, even if both end meanwhile.
    let this = unsafe { owner.cast::<Task>().as_ref() };
    events::ready(|| this.record.id.get());
    this.shared.inbound.wake(&this.slot, level);
}

/// Polls the process that has this turn. If that panics, the caller must call [`interrupted`].
/// Returns the process that has the next turn, if this one has yielded to it.
///
/// # Safety
///
/// `owner` was just taken from this thread's run queue, where only tasks are. What is returned is
/// run next, or [put back](current::put_back).
#[inline(always)]
#[must_use = "the process that is returned is in no queue"]
pub(crate) unsafe fn run(owner: NonNull<()>) -> Option<NonNull<()>> {
    // SAFETY: a task is retired only when it is not queued, so this one is live, and it keeps a
    // waker of its own during the poll. By the invariant nothing else accesses its body.
    unsafe {
        let task = owner.cast::<Task>();
        let this = task.as_ref();
        // By the invariant it has one.
        let waker = this.process.waker().unwrap_unchecked();
        let mut cx = Context::from_waker(waker);
        this.process.count_poll();
        let poll = this.process.poll();
        current::give_turn(&this.process, || poll(owner, &mut cx));
        match this.process.after_turn() {
            AfterTurn::Nothing => None,
            AfterTurn::Next(next) => Some(next),
            AfterTurn::More => {
                finish_turn(task);
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
/// This is its executor's thread, and the task has had its turn just now.
#[inline(never)]
unsafe fn finish_turn(task: NonNull<Task>) {
    // SAFETY: the caller promises the executor's thread and a task whose turn is just over. Only
    // the calls below, each of them last, retire such a task: until then it is live. A body that
    // ended while its task was queued has had that turn, so its task is queued no more. The poll is
    // over, so nothing else accesses a body that has not ended, as `abandon` requires.
    unsafe {
        let process = &task.as_ref().process;
        if process.has_failed() && !process.has_ended() {
            (task.as_ref().methods().abandon)(task, Abandoned::Failed);
        }
        process.end_turn();
        let notices = process.notices();
        if !process.has_ended() {
            if notices & Notice::TRACED != 0 {
                events::end_turn(process.id().get(), process.is_queued());
            }
        } else if notices & Notice::ENDED == 0 {
            end(task);
        } else {
            end_turns();
            retire(task);
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

/// Polls a process that was cancelled, has a poll monitor, or has its turns traced. One that has
/// ended while it was queued is not polled: it retires after this turn.
///
/// # Safety
///
/// As [`current::Methods::poll`] requires: `owner` is a task that was taken from the run queue and
/// has its turn, on its executor's thread.
#[cold]
unsafe fn poll_attentively(owner: NonNull<()>, cx: &mut Context<'_>) {
    // SAFETY: the caller promises the turn of a live task, on its executor's thread, so nothing
    // else accesses the body. It is polled or abandoned only if its record says that it has not
    // ended, and abandoned only if that poll has not ended it.
    unsafe {
        let task = owner.cast::<Task>();
        let this = task.as_ref();
        if this.record.has_ended() {
            this.process.uncount_poll();
            return this.process.set_ended();
        }
        if this.record.is_cancelled() {
            this.process.uncount_poll();
        }
        let notices = this.process.notices();
        if notices & Notice::TRACED != 0 {
            events::begin_turn(this.process.id().get());
            this.process.keep_traced();
        }
        let poll = this.process.methods().poll;
        if events::is_on() && notices == Notice::TRACED {
            return poll(owner, cx);
        }
        let abandoned = process::poll_attentively(&this.record, cx, |cx| {
            poll(owner, cx);
            match this.process.has_ended() {
                true => Poll::Ready(()),
                false => Poll::Pending,
            }
        });
        if let Some(abandoned) = abandoned {
            (this.methods().abandon)(task, abandoned);
        }
    }
}

#[cfg(all(test, not(loom), target_pointer_width = "64"))]
mod tests {
    use super::*;

    /// Each process pays for it: what is added here, or to a [`Process`], is added a million times
    /// in a system of a million.
    #[test]
    fn a_task_takes_little_beside_its_body() {
        assert!(size_of::<Task>() <= 328, "{}", size_of::<Task>());
        assert!(size_of::<Record>() <= 128, "{}", size_of::<Record>());
        assert!(size_of::<Process>() <= 168, "{}", size_of::<Process>());
    }
}

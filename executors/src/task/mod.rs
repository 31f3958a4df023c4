//! The task of a process on an executor: its body in one allocation with its record and all that is
//! needed to build, wake, queue, poll and free it.
//!
//! ```text
//!               waker or handle, from elsewhere        +--> slot and signal (inbound), then as below
//!             /                                       |
//!   waiting -<----------------------------------------+
//!             \                                       |
//!               waker or handle, on this thread       +--> run queue --> run --> Body::poll
//! ```
//!
//! On the executor's own thread a wake is a flag and a push, without atomics. From another thread
//! it is a fixed number of instructions, none of which relies on another waker to continue
//! ([`remote_wakes`](crate::remote_wakes)). A waker that is preempted half-way blocks no other
//! thread.
//!
//! A task is made with what builds its body, on any thread ([`Unbuilt`]). It is built, polled, and
//! its body dropped, on its executor's thread alone. It is *retired* when its body has ended and it
//! is in no queue. Its memory is freed when no reference to it remains: pending wakes are counted
//! in its [`current::Process`]; handles and wakers in its [`Record`]. The process' own waker stands
//! for all pending wakes among them. When nothing but the record's references is left, it becomes
//! that of the list of processes that have ended. Memory that becomes free on the real-time path is
//! freed off it (deferred free).

mod memory;
mod unbuilt;
mod waker;

pub(crate) use unbuilt::{Arrivals, Unbuilt};

use crate::executor::{self, Shared};
use crate::interference;
use crate::process::{
    Body, End, ErasedExitValue, ExitValue, ExitValueMethods, Notice, Record, RecordRef,
};
use crate::remote_wakes::{RemoteWakes, WakeSlot};
use luna_core::current::{self, AfterTurn, Methods, Process, QueueEnd};
use luna_core::deferred_free::Retired;
use luna_core::events;
use std::any::{Any, TypeId};
use std::cell::{Cell, RefCell, UnsafeCell};
use std::future::Future;
use std::mem::{self, ManuallyDrop, offset_of};
use std::ops::{Deref, Range};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::task::{Context, Poll};

thread_local! {
    /// The tasks of this thread's executor that are not retired.
    static REMOTE_WAKES: RefCell<RemoteWakes<NonNull<Task>>> = const { RefCell::new(RemoteWakes::new()) };
    static TASKS: Cell<usize> = const { Cell::new(0) };
}

/// The tasks of one of several executors that share a thread, while another has its turn.
pub(crate) struct Tasks {
    remote_wakes: RemoteWakes<NonNull<Task>>,
    count: usize,
}

impl Tasks {
    pub(crate) const fn new() -> Self {
        Self {
            remote_wakes: RemoteWakes::new(),
            count: 0,
        }
    }

    /// How many have not been retired.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Makes these tasks the thread's, and keeps the former ones here: called before a turn and
    /// after it.
    pub(crate) fn exchange(&mut self) {
        REMOTE_WAKES
            .with_borrow_mut(|remote_wakes| std::mem::swap(remote_wakes, &mut self.remote_wakes));
        self.count = TASKS.replace(self.count);
    }
}

/// The part of a task that does not depend on its body, which lies behind it.
///
/// # Invariants
///
/// It is the first field of a [`Whole`], in [memory] of its own. All pointers to it, and to its
/// record, derive from the pointer to the whole. There is a borrow of all of it only once it is
/// built, and then it has a wake slot. Only the executor's thread touches the body. The record's
/// references keep the whole. The process has an owner, the task, and until it is freed a waker,
/// which is one of these references.
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

/// Rare operations on a body: found through its process' methods.
struct BodyMethods {
    /// Polls it, if it was not cancelled, with all optional work around a poll, and marks the
    /// process if it has ended.
    poll_attentively: unsafe fn(NonNull<()>, &mut Context<'_>),
    /// Ends a body that has panicked.
    end_panicked: unsafe fn(NonNull<Task>, Box<dyn Any + Send>),
}

impl Task {
    /// Its record, built or not.
    ///
    /// # Safety
    ///
    /// The task is live.
    #[inline]
    unsafe fn record(this: NonNull<Task>) -> NonNull<Record> {
        // SAFETY: the contract.
        unsafe { NonNull::new_unchecked(&raw mut (*this.as_ptr()).record) }
    }

    /// # Safety
    ///
    /// Its process has an owner, the task.
    unsafe fn methods(&self) -> &'static BodyMethods {
        // SAFETY: the contract.
        let seldom = unsafe { self.process.methods() }.seldom;
        let methods = seldom.and_then(|methods| methods.downcast_ref());
        methods.expect("`start` has said them")
    }
}

#[repr(C)]
struct Whole<F: Future, B> {
    task: Task,
    body: UnsafeCell<Body<F, B>>,
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
        let process = Process::new(
            record.id(),
            shared.executor_id(),
            shared.thread_priority(),
            level,
        );
        let slot = REMOTE_WAKES.with_borrow_mut(|remote_wakes| remote_wakes.enter(task));
        let process = ManuallyDrop::new(process);
        (&raw mut (*head).process).write(Head { process });
        (&raw mut (*head).slot).write(slot);
        let this = task.as_ref();
        this.process.set_waker(waker::first(task));
        this.process.set_owner(task.cast(), methods);
        let notices = this.record.notices();
        if notices != 0 {
            this.process.notify(notices);
            if notices & Notice::RECORDED != 0 {
                this.process.set_recorded();
            }
        }
        this.record.set_process(NonNull::from(&*this.process));
        TASKS.set(TASKS.get() + 1);
        let (id, name) = (this.record.id(), || this.record.name().to_owned());
        events::name_process(id.get(), level, name);
        this.process.ready_at(level, QueueEnd::Back);
    }
}

/// How many tasks of this thread's executor have not been retired.
pub(crate) fn count() -> usize {
    TASKS.get()
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
pub(crate) fn take_in(shared: &Shared, level: u8) {
    REMOTE_WAKES.with_borrow(|remote_wakes| {
        shared.inbound().take(level, remote_wakes, |task| {
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
    // SAFETY: the contract; by the task's invariant the pointer is one to all of it.
    unsafe {
        let record = Task::record(task);
        record.as_ref().count_one_more();
        RecordRef::from_raw(record)
    }
}

/// The body behind a task.
///
/// # Safety
///
/// `task` is the head of a live `Whole<F, B>`, this is the thread of its executor, and nothing else
/// accesses its body while the borrow lasts.
#[inline(always)]
unsafe fn body<'a, F: Future, B>(task: NonNull<Task>) -> Pin<&'a mut Body<F, B>> {
    // SAFETY: the contract; the body stays where it is until it is dropped.
    unsafe { Pin::new_unchecked(&mut *(*task.cast::<Whole<F, B>>().as_ptr()).body.get()) }
}

/// # Safety
///
/// `owner` is the head of a live `Whole<F, B>`.
unsafe fn body_range<F: Future, B>(owner: NonNull<()>) -> Range<usize> {
    let start = owner.addr().get() + offset_of!(Whole<F, B>, body);
    start..start + size_of::<Body<F, B>>()
}

/// # Safety
///
/// As for [`body`]: `owner` is the head of that `Whole<F, B>`. The body has not ended.
unsafe fn poll<F, B>(owner: NonNull<()>, cx: &mut Context<'_>)
where
    F: Future<Output: ExitValue>,
{
    let task = owner.cast::<Task>();
    // SAFETY: the contract.
    unsafe {
        if let Poll::Ready(value) = body::<F, B>(task).poll_unended(cx) {
            end_body::<F, B>(task, End::Completed(value));
        }
    }
}

/// # Safety
///
/// As for [`poll`], but the body may have ended.
unsafe fn poll_attentively<F, B>(owner: NonNull<()>, cx: &mut Context<'_>)
where
    F: Future<Output: ExitValue>,
{
    let task = owner.cast::<Task>();
    // SAFETY: the caller's contract. `run_attentively` does not poll a body that has ended, so this
    // body has not ended and has no exit value yet.
    unsafe {
        if let Some(end) = body::<F, B>(task).poll_attentively(&task.as_ref().record, cx) {
            end_body::<F, B>(task, end);
        }
    }
}

/// # Safety
///
/// As for [`body`].
unsafe fn end_panicked<F, B>(task: NonNull<Task>, payload: Box<dyn Any + Send>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the contract.
    unsafe { end_body::<F, B>(task, End::Panicked(payload)) };
}

/// Drops the body and publishes how it ended. The exit value takes the body's place until it is
/// taken, or the task is freed.
///
/// # Safety
///
/// As for [`body`]; and it has not ended before.
#[cold]
unsafe fn end_body<F, B>(task: NonNull<Task>, end: End<F::Output>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller's contract. No borrow of the body is left when the exit value is
    // published, and from then on it belongs to the threads that take it.
    unsafe {
        let this = task.as_ref();
        let end = body::<F, B>(task).end(&this.record, end);
        let exit = end.into_raw(|value| {
            body::<F, B>(task).keep(value);
            let methods = const {
                &ExitValueMethods {
                    type_id: TypeId::of::<F::Output>,
                    take: take_exit_value::<F, B>,
                    discard: discard_exit_value::<F, B>,
                }
            };
            ErasedExitValue::new(task.cast(), methods)
        });
        this.process.set_ended();
        this.record.finish(exit);
    }
}

/// # Safety
///
/// `owner` is the head of a live `Whole<F, B>`. Its body has ended. The caller owns its exit
/// value; `to` is room for it.
unsafe fn take_exit_value<F: Future, B>(owner: NonNull<()>, to: *mut ()) {
    // SAFETY: the caller's contract; the exit value belongs to this call, so nothing else accesses
    // the body.
    unsafe {
        let task = owner.cast::<Task>();
        let value = body::<F, B>(task).take_exit_value();
        // By the contract there is an exit value.
        to.cast::<F::Output>().write(value.unwrap_unchecked());
    }
}

/// # Safety
///
/// As for [`take_exit_value`].
unsafe fn discard_exit_value<F: Future, B>(owner: NonNull<()>) {
    // SAFETY: the contract.
    unsafe {
        let task = owner.cast::<Task>();
        let value = body::<F, B>(task).take_exit_value();
        drop(value);
    }
}

/// As [`Methods::ready_elsewhere`] requires.
///
/// # Safety
///
/// `owner` is a task that is referred to.
unsafe fn ready_elsewhere(owner: NonNull<()>, level: u8) {
    // SAFETY: the contract keeps the task, and with it its executor's part that others see, even if
    // both end meanwhile.
    let this = unsafe { owner.cast::<Task>().as_ref() };
    events::ready(|| this.record.id().get());
    this.shared.inbound().wake(&this.slot, level);
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
        if this.process.notices() != 0 {
            run_attentively(task, &mut cx);
            return None;
        }
        this.process.count_poll();
        let poll = this.process.methods().poll;
        current::give_turn(&this.process, || poll(owner, &mut cx));
        match this.process.after_turn() {
            AfterTurn::Nothing => None,
            AfterTurn::Next(next) => next,
            AfterTurn::More => {
                finish_turn(task);
                None
            }
        }
    }
}

/// Ends a turn in which the process has ended.
///
/// # Safety
///
/// This is its executor's thread, and the task has had its turn just now.
#[inline(never)]
unsafe fn finish_turn(task: NonNull<Task>) {
    // SAFETY: the contract: a task is retired only here or in a turn of its own, so this one is
    // live.
    unsafe {
        let process = &task.as_ref().process;
        process.end_turn();
        if process.has_ended() {
            end(task);
        }
    }
}

/// No process is the current one from here on, until the next turn: to be called before an executor
/// does anything else than polling.
#[inline]
pub(crate) fn end_turns() {
    if let Some(last) = current::end_turns() {
        interference::polled(last);
    }
}

/// Polls a process that was cancelled, has a poll monitor, has ended, or has its turns recorded.
///
/// # Safety
///
/// As for [`run`].
#[cold]
unsafe fn run_attentively(task: NonNull<Task>, cx: &mut Context<'_>) {
    // SAFETY: the contract.
    unsafe {
        let this = task.as_ref();
        if this.record.has_ended() {
            return retire(task);
        }
        if !this.record.is_cancelled() {
            this.process.count_poll();
        }
        let id = this.process.id();
        events::begin_turn(id.get());
        let is_plain = events::is_on() && this.process.notices() == Notice::RECORDED;
        let poll = match is_plain {
            true => this.process.methods().poll,
            false => this.methods().poll_attentively,
        };
        current::give_turn(&this.process, || {
            if this.process.notices() & Notice::RECORDED != 0 {
                this.process.keep_recorded();
            }
            poll(task.cast(), cx);
        });
        this.process.end_turn();
        if this.process.has_ended() {
            end(task);
        } else {
            events::end_turn(id.get(), this.process.is_queued());
        }
    }
}

/// Ends the process in the turn of which the panic occurred. If there is none, returns the payload:
/// the panic is the thread's own.
pub(crate) fn interrupted(payload: Box<dyn Any + Send>) -> Result<(), Box<dyn Any + Send>> {
    // SAFETY: on this thread only tasks have turns, which have owners.
    let owner = current::process(|process| Some(unsafe { process?.owner() }));
    let Some(owner) = owner else {
        return Err(payload);
    };
    let task = owner.cast::<Task>();
    // SAFETY: it is the current process. Its poll has unwound, so nothing accesses its body. Its
    // methods are those of a task: on this thread only tasks have turns.
    unsafe {
        (task.as_ref().methods().end_panicked)(task, payload);
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
unsafe fn end_left(task: NonNull<Task>, why: &str) {
    // SAFETY: the caller's contract: nothing else accesses the body, and the task lives until it is
    // retired, at the end.
    unsafe {
        let this = task.as_ref();
        let ended = catch_unwind(AssertUnwindSafe(|| {
            current::give_turn(&this.process, || {
                current::poison_dropped_ends(|| {
                    (this.methods().end_panicked)(task, Box::new(why.to_owned()));
                });
            });
            this.process.end_turn();
        }));
        if let Err(payload) = ended {
            // Dropping it could panic in turn.
            std::mem::forget(payload);
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
unsafe fn end(task: NonNull<Task>) {
    // It may be freed here.
    end_turns();
    // SAFETY: the contract. This thread has a reference to the executor's part that others see, so
    // the registry outlives the task.
    unsafe {
        let this = task.as_ref();
        let registry = (*Arc::as_ptr(&this.shared)).registry();
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
/// As for [`retire`].
unsafe fn leave(task: NonNull<Task>) {
    TASKS.set(TASKS.get() - 1);
    // SAFETY: the contract: the task is live.
    let number = unsafe { task.as_ref() }.slot.number();
    REMOTE_WAKES.with_borrow_mut(|remote_wakes| remote_wakes.leave(number));
}

/// # Safety
///
/// The body of the task has ended, the task is not queued, and it was not retired before. This is
/// its executor's thread.
#[cold]
unsafe fn retire(task: NonNull<Task>) {
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
/// As [`Methods::free`] requires; `owner` is the task.
unsafe fn free(owner: NonNull<()>) {
    // SAFETY: the contract. The process' waker keeps the task until it is dropped, which is the
    // last that is done here.
    unsafe {
        drop(owner.cast::<Task>().as_ref().process.take_waker());
    }
}

/// # Safety
///
/// `head` begins the record of a `Whole<F, B>` to which no reference remains. Its body has ended,
/// or was never built.
unsafe fn free_retired<F: Future, B>(head: NonNull<Retired>) {
    // SAFETY: the contract; `Unbuilt::new` allocated it. What is left of the body is its exit
    // value, which can go on any thread, and belongs to the record until that is dropped.
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

#[cfg(all(test, not(loom), target_pointer_width = "64"))]
mod tests {
    use super::*;

    /// Each process pays for it: what is added here, or to a [`Process`], is added a million times
    /// in a system of a million.
    #[test]
    fn a_task_takes_little_beside_its_body() {
        assert!(size_of::<Task>() <= 320, "{}", size_of::<Task>());
        assert!(size_of::<Record>() <= 128, "{}", size_of::<Record>());
        assert!(size_of::<Process>() <= 160, "{}", size_of::<Process>());
    }
}

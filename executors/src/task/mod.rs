//! The task of a process on an executor: its body in one allocation with all that is needed to
//! wake, queue, poll and free it.
//!
//! ```text
//!               waker or wakeup, from elsewhere        +--> its seat and a signal (inbound), then, by the owner, as below
//!             /                                       |
//!   waiting -<----------------------------------------+
//!             \                                       |
//!               waker or wakeup, on this thread       +--> run queue --> run --> Body::poll
//! ```
//!
//! On the executor's own thread a wake is a flag and a push, without atomics. From another thread
//! it is a fixed number of instructions, none of which relies on another waker to continue
//! ([`remote_wakes`](crate::remote_wakes)). A waker that is preempted half-way blocks no other
//! thread.
//!
//! A task is polled, and its body dropped, on its executor's thread alone. It is *retired* when its
//! body has ended and it is in no queue. Its memory is freed when no reference to it remains:
//! pending wakes are counted in its [`current::Process`], wakers in the task. The process' own
//! waker stands for all pending wakes among the wakers. Memory that becomes free on the real-time
//! path is freed off it (deferred free).

mod memory;
mod waker;

use crate::executor::{self, Shared};
use crate::interference;
use crate::process::{Body, End, ExitValue, Notice, Record, Words, WordsMethods};
use crate::remote_wakes::{RemoteWakes, Seat};
use luna_core::current::{self, AfterTurn, Methods, Place, Process};
use luna_core::events;
use luna_core::reclaim::Retired;
use std::any::{Any, TypeId};
use std::cell::{Cell, RefCell, UnsafeCell};
use std::future::Future;
use std::mem::{ManuallyDrop, offset_of};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::task::{Context, Poll};

thread_local! {
    /// The tasks of this thread's executor that are not retired.
    static SEATS: RefCell<RemoteWakes<NonNull<Task>>> = const { RefCell::new(RemoteWakes::new()) };
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
        SEATS.with_borrow_mut(|remote_wakes| std::mem::swap(remote_wakes, &mut self.remote_wakes));
        self.count = TASKS.replace(self.count);
    }
}

/// The part of a task that does not depend on its body, which lies behind it.
///
/// # Invariants
///
/// It is the first field of a [`Whole`], in [memory] of its own. All pointers to it derive from the
/// pointer to the whole. Only the executor's thread touches the body. `references` counts the
/// wakers; the drop of the last one frees the whole. The process has an owner, the task, and until
/// it is freed a waker.
#[repr(C)]
struct Task {
    /// First, so that task and process have the same address.
    process: Process,
    record: Arc<Record>,
    /// Dropped when the task is freed.
    shared: ManuallyDrop<Arc<Shared>>,
    seat: Seat,
    references: AtomicU32,
    /// How many bytes in front of the task belong to its memory.
    skipped: u8,
    retired: Retired,
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
struct Whole<F: Future> {
    task: Task,
    body: UnsafeCell<Body<F>>,
}

/// Makes the task of `record` on the executor `shared` and queues it. Called on that executor's
/// thread. Allocates.
pub(crate) fn start<F>(shared: Arc<Shared>, record: Arc<Record>, future: F)
where
    F: Future<Output: ExitValue> + 'static,
{
    let process = Process::new(
        record.id(),
        shared.home(),
        shared.thread_priority(),
        record.level(),
    );
    let seat = SEATS.with_borrow_mut(RemoteWakes::reserve);
    let number = seat.number();
    let (whole, skipped) = memory::allocate::<Whole<F>>();
    let level = record.level();
    let notices = record.notices();
    // Each part is written in place: a whole that is made first would be copied there.
    let head = Task {
        process,
        record,
        shared: ManuallyDrop::new(shared),
        seat,
        references: AtomicU32::new(waker::FIRST),
        skipped,
        retired: Retired::new(free_retired::<F>),
    };
    // SAFETY: it is room for both.
    unsafe {
        (&raw mut (*whole.as_ptr()).task).write(head);
        (&raw mut (*whole.as_ptr()).body).write(UnsafeCell::new(Body::new(future)));
    }
    let task = whole.cast::<Task>();
    // SAFETY: no other code has a pointer to the task yet, so nothing polls it. It stays in place
    // until `free` is called, and is ended once, by `retire`.
    unsafe {
        let this = task.as_ref();
        this.process.set_waker(waker::first(task));
        let methods = const {
            &Methods {
                ready_elsewhere,
                free,
                poll: poll::<F>,
                body: body_range::<F>,
                seldom: Some(&BodyMethods {
                    poll_attentively: poll_attentively::<F>,
                    end_panicked: end_panicked::<F>,
                }),
            }
        };
        this.process.set_owner(task.cast(), methods);
        if notices != 0 {
            this.process.notify(notices);
            if notices & Notice::RECORDED != 0 {
                this.process.set_recorded();
            }
        }
        this.record.set_process(NonNull::from(&this.process));
        SEATS.with_borrow_mut(|remote_wakes| remote_wakes.fill(number, task));
        TASKS.set(TASKS.get() + 1);
        let (id, name) = (this.record.id(), || this.record.name().to_owned());
        events::name_process(id.get(), level, name);
        this.process.ready_at(level, Place::Last);
    }
}

/// How many tasks of this thread's executor have not been retired.
pub(crate) fn count() -> usize {
    TASKS.get()
}

/// The processes of this thread's executor that have not been retired. Allocates.
pub(crate) fn records() -> Vec<Arc<Record>> {
    SEATS.with_borrow(|remote_wakes| {
        // SAFETY: a task that has a wake slot is not retired, so it is live.
        let record = |task: NonNull<Task>| unsafe { task.as_ref() }.record.clone();
        remote_wakes.members().map(record).collect()
    })
}

/// Queues the processes that other threads have woken at `level`. O(their number).
pub(crate) fn take_in(shared: &Shared, level: u8) {
    SEATS.with_borrow(|remote_wakes| {
        shared.inbound().take(level, remote_wakes, |task| {
            // SAFETY: a task that has a wake slot is not retired, so it is live, and this is its
            // executor's thread.
            unsafe {
                // What it had inherited may have been given back meanwhile, or the wake was one of
                // the slot's former owner.
                let process = &task.as_ref().process;
                process.ready_at(level.min(process.level()), Place::Last);
            }
        });
    });
}

/// The body behind a task.
///
/// # Safety
///
/// `task` is the head of a live `Whole<F>`, this is the thread of its executor, and nothing else
/// accesses its body while the borrow lasts.
#[inline(always)]
unsafe fn body<'a, F: Future>(task: NonNull<Task>) -> Pin<&'a mut Body<F>> {
    // SAFETY: the contract; the body stays where it is until it is dropped.
    unsafe { Pin::new_unchecked(&mut *task.cast::<Whole<F>>().as_ref().body.get()) }
}

/// # Safety
///
/// `owner` is the head of a live `Whole<F>`.
unsafe fn body_range<F: Future>(owner: NonNull<()>) -> Range<usize> {
    let start = owner.addr().get() + offset_of!(Whole<F>, body);
    start..start + size_of::<Body<F>>()
}

/// # Safety
///
/// As for [`body`]: `owner` is the head of that `Whole<F>`. The body has not ended.
unsafe fn poll<F>(owner: NonNull<()>, cx: &mut Context<'_>)
where
    F: Future<Output: ExitValue>,
{
    let task = owner.cast::<Task>();
    // SAFETY: the contract.
    unsafe {
        if let Poll::Ready(words) = body::<F>(task).poll_unended(cx) {
            end_body::<F>(task, End::Completed(words));
        }
    }
}

/// # Safety
///
/// As for [`poll`], but the body may have ended.
unsafe fn poll_attentively<F>(owner: NonNull<()>, cx: &mut Context<'_>)
where
    F: Future<Output: ExitValue>,
{
    let task = owner.cast::<Task>();
    // SAFETY: the caller's contract. `run_attentively` does not poll a body that has ended, so this
    // body has not ended and has no exit value yet.
    unsafe {
        if let Some(end) = body::<F>(task).poll_attentively(&task.as_ref().record, cx) {
            end_body::<F>(task, end);
        }
    }
}

/// # Safety
///
/// As for [`body`].
unsafe fn end_panicked<F>(task: NonNull<Task>, payload: Box<dyn Any + Send>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the contract.
    unsafe { end_body::<F>(task, End::Panicked(payload)) };
}

/// Drops the body and returns how it ended. The exit value takes the body's place and keeps the
/// task alive until it is taken.
///
/// # Safety
///
/// As for [`body`]; and it has not ended before.
#[cold]
unsafe fn end_body<F>(task: NonNull<Task>, end: End<F::Output>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller's contract. No borrow of the body is left when the exit value is
    // published, and from then on it belongs to the threads that take it.
    unsafe {
        let this = task.as_ref();
        let end = body::<F>(task).end(&this.record, end);
        let exit = end.told(|words| {
            body::<F>(task).keep(words);
            let methods = const {
                &WordsMethods {
                    type_id: TypeId::of::<F::Output>,
                    take: take_words::<F>,
                    discard: discard_words::<F>,
                }
            };
            waker::add(task);
            Words::new(task.cast(), methods)
        });
        this.process.set_ended();
        this.record.finish(exit, this.shared.living());
    }
}

/// # Safety
///
/// `owner` is the head of a live `Whole<F>`. Its body has ended. The caller owns its exit value and
/// one reference to it; `to` is room for the exit value.
unsafe fn take_words<F: Future>(owner: NonNull<()>, to: *mut ()) {
    // SAFETY: the caller's contract; the exit value belongs to this call, so nothing else accesses
    // the body.
    unsafe {
        let task = owner.cast::<Task>();
        let words = body::<F>(task).take_words();
        // By the contract there is an exit value.
        to.cast::<F::Output>().write(words.unwrap_unchecked());
        waker::remove(task);
    }
}

/// # Safety
///
/// As for [`take_words`].
unsafe fn discard_words<F: Future>(owner: NonNull<()>) {
    // SAFETY: the contract.
    unsafe {
        let task = owner.cast::<Task>();
        let words = body::<F>(task).take_words();
        waker::remove(task);
        drop(words);
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
    this.shared.inbound().wake(&this.seat, level);
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
        let next =
            queued.or_else(|| SEATS.with_borrow(|remote_wakes| remote_wakes.next(&mut number)));
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

/// # Safety
///
/// The body of the task has ended in a turn just now. This is its executor's thread.
#[cold]
unsafe fn end(task: NonNull<Task>) {
    // It may be freed here.
    end_turns();
    // SAFETY: the contract.
    unsafe {
        let process = &task.as_ref().process;
        if process.is_queued() {
            // It retires when its turn comes.
            process.notify(Notice::ENDED);
        } else {
            retire(task);
        }
    }
}

/// # Safety
///
/// The body of the task has ended, the task is not queued, and it was not retired before. This is
/// its executor's thread.
#[cold]
unsafe fn retire(task: NonNull<Task>) {
    TASKS.set(TASKS.get() - 1);
    // SAFETY: the process is not polled again, and this is its executor's thread. Pending wakes and
    // wakers keep the task alive themselves.
    unsafe {
        SEATS.with_borrow_mut(|remote_wakes| remote_wakes.leave(task.as_ref().seat.number()));
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
/// `head` is the field of a `Whole<F>` to which no reference remains. Its body has ended.
unsafe fn free_retired<F: Future>(head: NonNull<Retired>) {
    // SAFETY: the contract; `start` allocated it. What is left of the body is the framework's own,
    // and can go on any thread.
    unsafe {
        let task = head.byte_sub(offset_of!(Task, retired)).cast::<Task>();
        let skipped = task.as_ref().skipped;
        let shared = ptr::read(&raw const *task.as_ref().shared);
        let whole = task.cast::<Whole<F>>();
        whole.drop_in_place();
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
        assert!(size_of::<Task>() <= 216, "{}", size_of::<Task>());
        assert!(size_of::<Record>() <= 104, "{}", size_of::<Record>());
        assert!(size_of::<Process>() <= 160, "{}", size_of::<Process>());
    }
}

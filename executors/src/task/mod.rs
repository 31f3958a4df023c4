//! The task of a process on an executor: its body in one allocation with all that is needed to wake, queue, poll and free it.
//!
//! ```text
//!               waker or wakeup, from elsewhere        +--> its seat and a signal (inbound), then, by the owner, as below
//!             /                                       |
//!   waiting -<----------------------------------------+
//!             \                                       |
//!               waker or wakeup, on this thread       +--> run queue --> run --> Body::poll
//! ```
//!
//! On the executor's own thread a wake is a flag and a push, without atomics. From elsewhere it is a fixed number of instructions, none of which
//! relies on another waker to go on ([`seats`](crate::seats)): a waker that is preempted half-way holds up nobody.
//!
//! A task is polled, and its body dropped, on its executor's thread alone. It is *retired* when its body has ended and it is in no queue; its
//! memory then goes when nobody refers to it any more: wakeups are counted in its [`current::Process`], wakers in the task. The process' own waker
//! stands for all wakeups among the wakers. Memory that goes on the real-time path is freed off it.

mod waker;

use crate::executor::Shared;
use crate::link::Link;
use crate::process::{Body, ProcessState, Record};
use crate::run_queue::RunQueue;
use crate::seats::{Seat, Seats};
use luna_platform::current::{self, Methods, Place};
use luna_platform::reclaim::Retired;
use std::cell::{Cell, RefCell, UnsafeCell};
use std::future::Future;
use std::mem::offset_of;
use std::pin::Pin;
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::task::Context;

thread_local! {
    /// The run queue of the executor that this thread is, if it is one.
    static QUEUE: RunQueue = const { RunQueue::new() };
    /// Its tasks that are not retired.
    static SEATS: RefCell<Seats<NonNull<Task>>> = const { RefCell::new(Seats::new()) };
    static TASKS: Cell<usize> = const { Cell::new(0) };
}

/// This thread's run queue. It is used only while the thread is an executor's.
#[inline]
pub(crate) fn with_queue<R>(f: impl FnOnce(&RunQueue) -> R) -> R {
    QUEUE.with(f)
}

static METHODS: Methods = Methods {
    ready_here,
    ready_elsewhere,
    free,
};

/// The part of a task that does not depend on its body, which lies behind it.
///
/// # Invariants
///
/// It is the first field of a [`Whole`], in a box of its own, and all pointers to it are made of that box's. `link` is in this thread's run queue
/// exactly while `is_queued`, at `queued_level`. These three, and the body, are touched by the home's thread alone. `references` counts the wakers;
/// with the last one the whole goes.
struct Task {
    link: Link,
    is_queued: Cell<bool>,
    queued_level: Cell<u8>,
    /// Polls the body; `true` if it has ended.
    poll: unsafe fn(NonNull<Task>, &mut Context<'_>) -> bool,
    seat: Seat,
    process: current::Process,
    record: Arc<Record>,
    shared: Arc<Shared>,
    references: AtomicUsize,
    retired: Retired,
}

#[repr(C)]
struct Whole<F> {
    task: Task,
    body: UnsafeCell<Body<F>>,
}

/// Leads from a task to its link, with a pointer that leads back.
///
/// # Safety
///
/// The task is live.
#[inline]
unsafe fn link_of(task: NonNull<Task>) -> NonNull<Link> {
    // SAFETY: the contract.
    unsafe { NonNull::new_unchecked(&raw mut (*task.as_ptr()).link) }
}

/// Makes the task of `record` on the executor `shared`, whose thread this is, and queues it. Allocates.
pub(crate) fn start<F>(shared: &Arc<Shared>, record: Arc<Record>, future: F)
where
    F: Future<Output = ()> + 'static,
{
    let process = current::Process::new(
        record.id(),
        shared.home(),
        shared.thread_priority(),
        record.level(),
    );
    let seat = SEATS.with_borrow_mut(Seats::reserve);
    let number = seat.number();
    let whole = Box::new(Whole {
        task: Task {
            link: Link::new(),
            is_queued: Cell::new(false),
            queued_level: Cell::new(0),
            poll: poll::<F>,
            seat,
            process,
            record: record.clone(),
            shared: shared.clone(),
            references: AtomicUsize::new(0),
            retired: Retired::new(free_retired::<F>),
        },
        body: UnsafeCell::new(Body::new(future, record.clone())),
    });
    let task = NonNull::from(Box::leak(whole)).cast::<Task>();
    // SAFETY: nobody else knows the task yet, so nobody polls it. It stays where it is until `free` was called, and is ended once, by `retire`.
    unsafe {
        record.set_waker(waker::new(task));
        let this = task.as_ref();
        this.process.set_waker(waker::new(task));
        this.process.set_owner(task.cast(), &METHODS);
        SEATS.with_borrow_mut(|seats| seats.fill(number, task));
        TASKS.set(TASKS.get() + 1);
        ready(task, record.level(), Place::Last);
    }
}

/// How many tasks of this thread's executor have not been retired.
pub(crate) fn count() -> usize {
    TASKS.get()
}

/// Queues those who were woken from elsewhere at `level`. O(their number).
pub(crate) fn take_in(shared: &Shared, level: u8) {
    SEATS.with_borrow(|seats| {
        shared.inbound().take(level, seats, |task| {
            // SAFETY: who has a seat is not retired, so it is live, and this is its home's thread.
            unsafe {
                // What it had inherited may have been given back meanwhile, or the wake was one of the seat's former owner.
                let level = level.min(task.as_ref().process.level());
                ready(task, level, Place::Last);
            }
        });
    });
}

/// # Safety
///
/// `task` is the head of a live `Whole<F>` on whose home's thread this is, and nobody else accesses its body.
unsafe fn poll<F: Future<Output = ()>>(task: NonNull<Task>, cx: &mut Context<'_>) -> bool {
    // SAFETY: the contract; the body stays where it is until it is dropped.
    unsafe {
        let body = task.cast::<Whole<F>>().as_ref().body.get();
        Pin::new_unchecked(&mut *body).poll(cx).is_ready()
    }
}

/// Puts a task into the run queue at `level`, if it is not there at that level or a higher one. No atomics.
///
/// # Safety
///
/// The task is live, and this is its home's thread.
#[inline]
unsafe fn ready(task: NonNull<Task>, level: u8, place: Place) {
    // SAFETY: the contract; by the invariant the link is queued exactly if the flag says so. A live task with an unended body is not retired.
    unsafe {
        let this = task.as_ref();
        if this.record.has_ended() {
            return;
        }
        let link = link_of(task);
        if this.is_queued.replace(true) {
            let queued = this.queued_level.get();
            if queued >= level {
                return;
            }
            // A more urgent branch of it has become ready: the process waits at the level of the most urgent one.
            with_queue(|queue| queue.remove(queued, link));
        } else {
            this.record.set_ready();
        }
        this.queued_level.set(level);
        with_queue(|queue| match place {
            Place::First => queue.push_front(level, link),
            Place::Last => queue.push_back(level, link),
        });
    }
}

/// As [`Methods::ready_here`] says.
///
/// # Safety
///
/// `owner` is a task that is referred to, and this is its home's thread.
unsafe fn ready_here(owner: NonNull<()>, level: u8, place: Place) {
    // SAFETY: the contract.
    unsafe { ready(owner.cast(), level, place) };
}

/// As [`Methods::ready_elsewhere`] says.
///
/// # Safety
///
/// `owner` is a task that is referred to.
unsafe fn ready_elsewhere(owner: NonNull<()>, level: u8) {
    // SAFETY: the contract keeps the task, and with it its executor's part that others see, even if both end meanwhile.
    let this = unsafe { owner.cast::<Task>().as_ref() };
    this.shared.inbound().wake(&this.seat, level);
}

/// Polls a task whose turn it is.
///
/// # Safety
///
/// `link` is the link of a task and was just popped from this thread's run queue.
#[inline]
pub(crate) unsafe fn run(link: NonNull<Link>) {
    // SAFETY: a task is retired only when it is not queued, so this one is live, and keeps a waker of its own during the poll. By the invariant
    // nobody else accesses its body.
    unsafe {
        let task = link.byte_sub(offset_of!(Task, link)).cast::<Task>();
        let this = task.as_ref();
        this.is_queued.set(false);
        if this.record.has_ended() {
            return retire(task);
        }
        let Some(waker) = this.process.waker() else {
            return;
        };
        let mut cx = Context::from_waker(waker);
        let has_ended = current::with_process(&this.process, || (this.poll)(task, &mut cx));
        match (has_ended, this.is_queued.get()) {
            (true, false) => retire(task),
            // It retires when its turn comes.
            (true, true) => {}
            (false, true) => this.record.set_state(ProcessState::Ready),
            (false, false) => {}
        }
    }
}

/// # Safety
///
/// The body of the task has ended, the task is not queued, and it was not retired before. This is its home's thread.
#[cold]
unsafe fn retire(task: NonNull<Task>) {
    TASKS.set(TASKS.get() - 1);
    // SAFETY: the process is not polled again, and this is its home's thread. Wakeups and wakers keep the task alive themselves.
    unsafe {
        SEATS.with_borrow_mut(|seats| seats.leave(task.as_ref().seat.number()));
        current::Process::end(NonNull::new_unchecked(&raw mut (*task.as_ptr()).process));
    }
}

/// Lets go of the wakers that a task has of itself: its process has ended, and no wakeup refers to it any more.
///
/// # Safety
///
/// As [`Methods::free`] says; `owner` is the task.
unsafe fn free(owner: NonNull<()>) {
    // SAFETY: the contract. The process' waker keeps the task until it is dropped, which is the last that is done here.
    unsafe {
        let this = owner.cast::<Task>().as_ref();
        this.record.drop_waker();
        let last = this.process.take_waker();
        drop(last);
    }
}

/// # Safety
///
/// `head` is the field of a `Whole<F>` that nobody uses any more, and whose body has ended.
unsafe fn free_retired<F>(head: NonNull<Retired>) {
    // SAFETY: the contract; `start` made it of a box. What is left of the body is the framework's own, and can go on any thread.
    unsafe {
        let task = head.byte_sub(offset_of!(Task, retired)).cast::<Task>();
        drop(Box::from_raw(task.cast::<Whole<F>>().as_ptr()));
    }
}

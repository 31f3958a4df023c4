//! The task of a process on an executor: `async-task`'s life cycle, and a short way around it for wakes on the executor's own thread.
//!
//! async-task owns the memory, the future and the wakers, and takes wakes from any thread: about four atomic read-modify-write
//! operations for each poll. Most wakes come from the executor's own thread, where a channel hands over to a partner on the
//! same executor. They need no atomics: the task's second link goes straight to the run queue, and its future is polled where it
//! lies. Both ways may be on at once; the future is then polled once too often, which a future must stand.
//!
//! ```text
//!               waker, from anywhere           +--> inbound, then run queue --> Runnable::run --+
//!             /   (link `scheduled`)                                                            |
//!   waiting -<                                                                                  +--> Body::poll
//!             \   ready_here, on this thread                                                    |
//!               \ (link `direct`)              +--> run queue ------------------> poll_in_place -+
//! ```
//!
//! What remains of others' progress: async-task marks a task as scheduled before it is handed over, so a second waker of the *same* task
//! relies on the first one to go on. Wakers of different tasks do not rely on each other.
//!
//! When the future has ended in a direct poll, async-task is told by one last run, which finds it ended. From its making until it
//! is retired a task holds a reference to itself (the wakers in its [`current::Process`] and in its record), so that no waker's
//! drop frees it on the real-time path.

use crate::executor::Shared;
use crate::link::Link;
use crate::process::{Body, ProcessState, Record};
use crate::run_queue::RunQueue;
use async_task::{Builder, Runnable, ScheduleInfo, WithInfo};
use luna_platform::current::{self, Methods, Place};
use luna_platform::reclaim::{self, Retired};
use std::cell::Cell;
use std::future::Future;
use std::mem::offset_of;
use std::pin::Pin;
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::sync::atomic::{AtomicPtr, Ordering};
use std::task::{Context, Poll};

thread_local! {
    /// The run queue of the executor that this thread is, if it is one.
    static QUEUE: RunQueue = const { RunQueue::new() };
    static TASKS: Cell<usize> = const { Cell::new(0) };
}

/// This thread's run queue. It is used only while the thread is an executor's.
#[inline]
pub(crate) fn with_queue<R>(f: impl FnOnce(&RunQueue) -> R) -> R {
    QUEUE.with(f)
}

static METHODS: Methods = Methods { ready_here, free };

/// Polls the body at the pointer; `true` if it has ended.
type PollInPlace = unsafe fn(NonNull<()>, &mut Context<'_>) -> bool;

/// The metadata of a task.
///
/// # Invariants
///
/// `scheduled` is queued exactly while async-task has it scheduled; `raw` is then its runnable. `direct` is queued exactly while
/// `is_ready`, at the level `ready_level`. The cells are touched by the home's thread alone. `body` leads to the task's future from its first poll
/// through async-task on, which is before any direct one.
struct Task {
    scheduled: Link,
    direct: Link,
    is_ready: Cell<bool>,
    ready_level: Cell<u8>,
    /// async-task has completed the task.
    is_completed: Cell<bool>,
    body: Cell<Option<(NonNull<()>, PollInPlace)>>,
    raw: AtomicPtr<()>,
    process: current::Process,
    retired: Retired,
    shared: Arc<Shared>,
    record: Arc<Record>,
}

// SAFETY: the cells belong to the home's thread, by the invariants; all else is `Send` and `Sync`.
unsafe impl Send for Task {}
// SAFETY: as above.
unsafe impl Sync for Task {}

/// Leads from a task to a field, with a pointer that leads back.
macro_rules! field_of {
    ($field:ident, $task:expr) => {
        NonNull::new_unchecked(&raw mut (*$task.as_ptr()).$field)
    };
}

/// Leads from such a pointer back to the task.
macro_rules! task_of {
    ($field:ident, $pointer:expr) => {
        $pointer.byte_sub(offset_of!(Task, $field)).cast::<Task>()
    };
}

/// Makes the task of `record` on the executor `shared`, whose thread this is, and queues it.
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
    let task = Task {
        scheduled: Link::new(run_scheduled),
        direct: Link::new(run_direct),
        is_ready: Cell::new(false),
        ready_level: Cell::new(0),
        is_completed: Cell::new(false),
        body: Cell::new(None),
        raw: AtomicPtr::new(ptr::null_mut()),
        process,
        retired: Retired::new(free_retired),
        shared: shared.clone(),
        record: record.clone(),
    };
    let body = Body::new(future, record.clone());
    // A function item captures nothing, which spares async-task a reference around each call.
    let schedule = WithInfo(schedule);
    // SAFETY: the future need not be `Send`: a task is polled on its executor's thread alone, and dropped there too, since its body ends
    // (completed, cancelled or panicked) before the executor does. All of it is 'static, and the schedule function can be called
    // on any thread. The task's metadata stays where it is as long as the future, so the future may keep a pointer to it.
    let (runnable, join) = unsafe {
        Builder::new().metadata(task).spawn_unchecked(
            |task: &Task| Placed {
                task: task.into(),
                body,
            },
            schedule,
        )
    };
    join.detach();
    let waker = runnable.waker();
    record.set_waker(waker.clone());
    let owner = NonNull::from(runnable.metadata());
    // SAFETY: the task has not been polled, and nobody else knows it yet but for the record's waker, which does not look here. It
    // stays where it is until its wakers are dropped by `free_retired`, and `retire` ends the process once.
    unsafe {
        owner.as_ref().process.set_waker(waker);
        owner.as_ref().process.set_owner(owner.cast(), &METHODS);
    }
    TASKS.set(TASKS.get() + 1);
    runnable.schedule();
}

/// How many tasks of this thread's executor have not been retired.
pub(crate) fn count() -> usize {
    TASKS.get()
}

/// The future that async-task owns: the body, which tells its task where it lies.
struct Placed<F> {
    task: NonNull<Task>,
    body: Body<F>,
}

impl<F: Future<Output = ()>> Future for Placed<F> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: the body is pinned with the whole. The task lives as long as its future, and this is its home's thread.
        unsafe {
            let this = self.get_unchecked_mut();
            let place = NonNull::from(&mut this.body);
            this.task
                .as_ref()
                .body
                .set(Some((place.cast(), poll_in_place::<F>)));
            Pin::new_unchecked(&mut *place.as_ptr()).poll(cx)
        }
    }
}

/// # Safety
///
/// `body` leads to a pinned `Body<F>` that nobody else accesses.
unsafe fn poll_in_place<F: Future<Output = ()>>(body: NonNull<()>, cx: &mut Context<'_>) -> bool {
    // SAFETY: the contract.
    unsafe { Pin::new_unchecked(body.cast::<Body<F>>().as_mut()) }
        .poll(cx)
        .is_ready()
}

/// Called by async-task, from any thread, when a waiting task is woken, or one that was woken while it ran has been polled.
fn schedule(runnable: Runnable<Task>, _: ScheduleInfo) {
    let task = NonNull::from(runnable.metadata());
    let raw = runnable.into_raw();
    // SAFETY: the runnable that was given up above keeps the task alive until it is popped and run.
    let (level, here, link) = unsafe {
        let task_at = task;
        let task = task.as_ref();
        task.raw.store(raw.as_ptr(), Ordering::Relaxed);
        task.record.set_state(ProcessState::Ready);
        (
            task.process.level(),
            current::home() == Some(task.shared.home()),
            field_of!(scheduled, task_at),
        )
    };
    if here {
        // SAFETY: the task is live, and async-task schedules it once at a time, so the link is in no queue.
        with_queue(|queue| unsafe { queue.push_back(level, link) });
    } else {
        // The executor may run and end the task, and end itself, while this thread is still about to ring.
        // SAFETY: the task is live, as above.
        let shared = unsafe { task.as_ref() }.shared.clone();
        // SAFETY: the task is live until the owner has taken it, and its link in no queue, as above.
        unsafe { shared.inbound().push(level, link) };
    }
}

/// Runs a task that async-task had scheduled.
///
/// # Safety
///
/// `link` is the `scheduled` link of a task and was just popped from this thread's run queue.
unsafe fn run_scheduled(link: NonNull<Link>) {
    // SAFETY: a scheduled task is live, and stays so during the poll and after it, since it holds a reference to itself until it is
    // retired. Being scheduled, it is a runnable that nobody else holds.
    unsafe {
        let task = task_of!(scheduled, link);
        let raw = NonNull::new_unchecked(task.as_ref().raw.load(Ordering::Relaxed));
        let runnable = Runnable::<Task>::from_raw(raw);
        current::with_process(&task.as_ref().process, || runnable.run());
        let this = task.as_ref();
        if this.record.has_ended() {
            this.is_completed.set(true);
            // If the direct link is still queued, it is the last to let go.
            if !this.is_ready.get() {
                retire(task);
            }
        } else if this.is_ready.get() {
            this.record.set_state(ProcessState::Ready);
        }
    }
}

/// # Safety
///
/// The task is completed, neither of its links is queued, and it was not retired before.
unsafe fn retire(task: NonNull<Task>) {
    TASKS.set(TASKS.get() - 1);
    // SAFETY: the process is not polled again, and this is its home's thread. Wakers keep the task alive themselves.
    unsafe { current::Process::end(field_of!(process, task)) };
}

/// Frees a task whose process has ended and that nobody refers to, off the real-time path.
///
/// # Safety
///
/// As `Methods::free` says; `owner` is the task.
unsafe fn free(owner: NonNull<()>) {
    // SAFETY: the contract.
    unsafe { reclaim::retire(field_of!(retired, owner.cast::<Task>())) };
}

/// Puts a process of this thread's executor into the run queue at `level`, if it is not there at that level or a higher one: no atomics.
///
/// # Safety
///
/// As `Methods::ready_here` says: `owner` is a task that is still referred to, and this is its home's thread.
unsafe fn ready_here(owner: NonNull<()>, level: u8, place: Place) {
    // SAFETY: the contract; a task that is not ready is not queued by its direct link, and one that is ready is.
    unsafe {
        let task = owner.cast::<Task>();
        let this = task.as_ref();
        if this.record.has_ended() {
            return;
        }
        let link = field_of!(direct, task);
        if this.is_ready.replace(true) {
            let queued = this.ready_level.get();
            if queued >= level {
                return;
            }
            // A more urgent branch of it has become ready: the process waits at the level of the most urgent one.
            with_queue(|queue| queue.remove(queued, link));
        } else {
            this.record.set_state(ProcessState::Ready);
        }
        this.ready_level.set(level);
        with_queue(|queue| match place {
            Place::First => queue.push_front(level, link),
            Place::Last => queue.push_back(level, link),
        });
    }
}

/// Runs a task that was readied on its own thread.
///
/// # Safety
///
/// `link` is the `direct` link of a task and was just popped from this thread's run queue.
unsafe fn run_direct(link: NonNull<Link>) {
    // SAFETY: the task is live: it is retired only when neither link is queued. async-task polls on this thread alone, so nobody
    // else accesses the body.
    unsafe {
        let task = task_of!(direct, link);
        let this = task.as_ref();
        this.is_ready.set(false);
        if this.record.has_ended() {
            // Either a scheduled run completed it and left it to this one, or one is still to come.
            if this.is_completed.get() {
                retire(task);
            }
            return;
        }
        let (Some((body, poll)), Some(waker)) = (this.body.get(), this.process.waker()) else {
            return;
        };
        let mut cx = Context::from_waker(waker);
        if current::with_process(&this.process, || poll(body, &mut cx)) {
            // Lets async-task complete the task: its next run finds the body ended.
            waker.wake_by_ref();
        } else if this.is_ready.get() {
            this.record.set_state(ProcessState::Ready);
        }
    }
}

/// Gives up the task's references to itself, off the real-time path.
///
/// # Safety
///
/// `head` is the field `retired` of a task that async-task has completed.
unsafe fn free_retired(head: NonNull<Retired>) {
    // SAFETY: the task lives until its last waker is dropped below, after which it is not used.
    unsafe {
        let task = task_of!(retired, head);
        let record = task.as_ref().record.clone();
        let last = task.as_ref().process.take_waker();
        record.drop_waker();
        drop(last);
    }
}

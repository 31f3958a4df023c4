//! The task of a process on an executor: `async-task`'s life cycle, with the link and the home in its metadata.
//!
//! ```text
//!             wake (once)                  popped                       pending
//!   waiting ---------------> in a queue -----------> running -----------------------> waiting
//!                (inbound from elsewhere,               | ready, cancelled, panicked
//!                 run queue from here)                  v
//!                                                     ended --> retired: freed off the real-time path
//! ```
//!
//! From its making until it is retired a task holds a reference to itself (the waker in its [`current::Process`] and the one in
//! its record), so that no waker's drop frees it on the path.

use crate::executor::Shared;
use crate::link::Link;
use crate::process::{Body, ProcessState, Record};
use crate::run_queue::RunQueue;
use async_task::{Builder, Runnable, ScheduleInfo, WithInfo};
use luna_platform::current;
use luna_platform::reclaim::{self, Retired};
use std::future::Future;
use std::mem::offset_of;
use std::ptr::{self, NonNull};
use std::sync::Arc;
use std::sync::atomic::{AtomicPtr, Ordering};

thread_local! {
    /// The run queue of the executor that this thread is, if it is one.
    static QUEUE: RunQueue = const { RunQueue::new() };
}

/// This thread's run queue. It is used only while the thread is an executor's.
#[inline]
pub(crate) fn with_queue<R>(f: impl FnOnce(&RunQueue) -> R) -> R {
    QUEUE.with(f)
}

/// The metadata of a task. `link` comes first, so that a link in a queue leads back here.
///
/// # Invariants
///
/// `raw` is the task's own runnable, as `Runnable::into_raw` gave it: the same pointer for the task's whole life.
#[repr(C)]
pub(crate) struct Task {
    link: Link,
    retired: Retired,
    raw: AtomicPtr<()>,
    process: current::Process,
    shared: Arc<Shared>,
    record: Arc<Record>,
}

impl Task {
    /// Makes the task of `record` on the executor `shared`, whose thread this is, and queues it.
    pub(crate) fn start<F>(shared: &Arc<Shared>, record: Arc<Record>, future: F)
    where
        F: Future<Output = ()> + 'static,
    {
        let task = Task {
            link: Link::new(),
            retired: Retired::new(free),
            raw: AtomicPtr::new(ptr::null_mut()),
            process: current::Process::new(record.id(), shared.home(), shared.thread_priority(), record.level()),
            shared: shared.clone(),
            record: record.clone(),
        };
        let body = Body::new(future, record.clone());
        // A function item captures nothing, which spares async-task a reference around each call.
        let schedule = WithInfo(schedule as fn(Runnable<Task>, ScheduleInfo));
        // SAFETY: the future need not be `Send`: a task is polled by the run loop of its executor's thread alone, and dropped in a
        // poll too, since its body ends (completed, cancelled or panicked) before the executor does. It is 'static, and so is
        // the schedule function, which may be called and dropped on any thread.
        let (runnable, join) = unsafe { Builder::new().metadata(task).spawn_unchecked(|_| body, schedule) };
        join.detach();
        let waker = runnable.waker();
        record.set_waker(waker.clone());
        // SAFETY: the task has not been polled, and nobody else knows it yet but for the record's waker, which does not look here.
        unsafe { runnable.metadata().process.set_waker(waker) };
        runnable.schedule();
    }

    /// Runs the queued task behind `link` once, as the current process.
    ///
    /// # Safety
    ///
    /// `link` was just popped from this thread's run queue.
    #[inline]
    pub(crate) unsafe fn run(link: NonNull<Link>) {
        let task = link.cast::<Task>();
        // SAFETY: a queued task is live, and stays so during the poll and after it, since it holds a reference to itself until it
        // is retired below. Being queued, it is a runnable that nobody else holds.
        unsafe {
            let raw = NonNull::new_unchecked(task.as_ref().raw.load(Ordering::Relaxed));
            let runnable = Runnable::<Task>::from_raw(raw);
            current::with_process(&task.as_ref().process, || runnable.run());
            if task.as_ref().record.state() == ProcessState::Ended {
                retire(task);
            }
        }
    }
}

/// Called by async-task, from any thread, when a waiting task is woken, or one that was woken while it ran has been polled.
fn schedule(runnable: Runnable<Task>, info: ScheduleInfo) {
    let task = NonNull::from(runnable.metadata());
    let raw = runnable.into_raw();
    // SAFETY: the runnable that was given up above keeps the task alive until it is popped and run.
    let (level, here) = unsafe {
        let task = task.as_ref();
        task.raw.store(raw.as_ptr(), Ordering::Relaxed);
        task.record.set_state(ProcessState::Ready);
        (task.process.level(), current::home() == Some(task.shared.home()))
    };
    let link = task.cast::<Link>();
    if here {
        let first = info.woken_while_running && current::take_resumes_first();
        // SAFETY: the task is live and scheduled, so it is in no queue; this is its executor's thread.
        with_queue(|queue| unsafe {
            if first {
                queue.push_front(level, link);
            } else {
                queue.push_back(level, link);
            }
        });
    } else {
        // The executor may run and end the task, and end itself, while this thread is still about to ring.
        // SAFETY: the task is live, as above.
        let shared = unsafe { task.as_ref() }.shared.clone();
        // SAFETY: the task is live until the owner has taken it, and scheduled, so in no queue.
        unsafe { shared.inbound().push(level, link) };
    }
}

/// Gives up the task's references to itself, off the real-time path.
///
/// # Safety
///
/// The task has ended, and was not retired before.
unsafe fn retire(task: NonNull<Task>) {
    // SAFETY: the head lies in the task, which stays alive through its reference to itself until `free` is called.
    unsafe { reclaim::retire(NonNull::from(&task.as_ref().retired)) };
}

unsafe fn free(head: NonNull<Retired>) {
    // SAFETY: `head` is the field `retired` of a task that has ended; dropping its wakers may free it, so it is not used after.
    unsafe {
        let task = head.byte_sub(offset_of!(Task, retired)).cast::<Task>();
        let record = task.as_ref().record.clone();
        let last = task.as_ref().process.take_waker();
        record.drop_waker();
        drop(last);
    }
}

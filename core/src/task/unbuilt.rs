//! A task that is not built yet: its executor's thread makes the body of what lies in its place.

use super::body::{BodyMethods, Whole, abandon, body, body_range, poll};
use super::end::{free, free_retired};
use super::{Head, Task, memory, poll_attentively, ready_elsewhere, start};
use crate::current;
use crate::deferred_free::Retired;
use crate::executor::Shared;
use crate::process::{Body, ExitValue, ProcessSpec, RawExit, Record, RecordRef};
use crate::remote_wakes::WakeSlot;
use alloc::sync::Arc;
use core::cell::UnsafeCell;
use core::future::Future;
use core::mem::{ManuallyDrop, offset_of};
use core::ptr::{self, NonNull};
use core::sync::atomic::Ordering;
use luna_platform::panics::catch_unwind;

/// How a task is built.
pub(super) struct Methods {
    /// Builds its body and queues it. If that panics, nothing of the builder is left.
    build: unsafe fn(NonNull<Task>),
    /// Drops its builder.
    clear: unsafe fn(NonNull<Task>),
}

/// A process that has not begun: dropped, it ends as cancelled, with its builder.
///
/// # Invariants
///
/// The task is not built, and this alone accesses its builder. It has the reference that is counted
/// for the process.
pub(crate) struct Unbuilt(NonNull<Task>);

// SAFETY: its builder may be sent, and the rest is shared by atomics.
unsafe impl Send for Unbuilt {}

impl Unbuilt {
    /// A process that counts as living on the executor `shared`, and a reference to it. Allocates.
    #[inline]
    pub(crate) fn new<F, B>(shared: Arc<Shared>, spec: ProcessSpec, builder: B) -> (Self, RecordRef)
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output: ExitValue> + 'static,
    {
        let is_on_executor = current::executor_id() == Some(shared.executor_id);
        let free = free_retired::<F, B>;
        let (whole, skipped) = memory::allocate::<Whole<F, B>>();
        let record = Record::new(spec, &shared.registry, is_on_executor, 2, free);
        let unbuilt = const {
            &Methods {
                build: build::<F, B>,
                clear: clear::<F, B>,
            }
        };
        // Each part is written in place: a whole that is made first would be copied there. SAFETY:
        // it is room for all of them. The record counts one reference for each of the results.
        unsafe {
            let task = &raw mut (*whole.as_ptr()).task;
            (&raw mut (*task).process).write(Head { unbuilt });
            (&raw mut (*task).record).write(record);
            (&raw mut (*task).shared).write(ManuallyDrop::new(shared));
            (&raw mut (*task).slot).write(WakeSlot::NONE);
            (&raw mut (*task).skipped).write(skipped);
            let body = UnsafeCell::new(Body::unbuilt(builder));
            (&raw mut (*whole.as_ptr()).body).write(body);
            let task = whole.cast::<Task>();
            (Self(task), RecordRef::from_raw(Task::record(task)))
        }
    }

    pub(crate) fn record(&self) -> &Record {
        // SAFETY: this has a reference to the task, so it is live; its record is there, built or
        // not.
        unsafe { &(*self.0.as_ptr()).record }
    }

    pub(crate) fn shared(&self) -> &Arc<Shared> {
        // SAFETY: this has a reference to the task, so it is live.
        unsafe { &(*self.0.as_ptr()).shared }
    }

    fn methods(&self) -> &'static Methods {
        // SAFETY: this has a reference to the task, so it is live; and by the invariant it is not
        // built.
        unsafe { (*self.0.as_ptr()).process.unbuilt }
    }

    /// Builds the body and queues the process, on its executor's thread. A builder is the user's
    /// code: if it panics, the process has ended before it began. Allocates.
    ///
    /// # Panics
    ///
    /// If this thread is not that of its executor.
    #[inline]
    pub(crate) fn build(self) {
        assert_eq!(
            current::executor_id(),
            Some(self.shared().executor_id),
            "a process is built on its executor's thread"
        );
        let this = ManuallyDrop::new(self);
        // SAFETY: by the invariant the task is not built, and this is its executor's thread. The
        // reference of the process passes to its waker, unless the builder panics.
        let built = catch_unwind(|| unsafe { (this.methods().build)(this.0) });
        if let Err(payload) = built {
            // SAFETY: nothing is left of the builder, and this is not used any more.
            unsafe { this.end(RawExit::Panicked(payload)) };
        }
    }

    /// # Safety
    ///
    /// Nothing is left of the builder, and this is not used any more.
    unsafe fn end(&self, exit: RawExit) {
        let shared = self.shared().clone();
        // SAFETY: by the invariant this has the reference of the process; it is passed on here, and
        // the caller promises not to use this any more.
        let record = unsafe { RecordRef::from_raw(Task::record(self.0)) };
        record.finish(exit);
        record.report(&shared.registry);
    }
}

impl Drop for Unbuilt {
    fn drop(&mut self) {
        // What the builder holds is the user's: dropping it may panic. SAFETY: by the invariant the
        // task is not built, and this alone accesses its builder.
        let cleared = catch_unwind(|| unsafe { (self.methods().clear)(self.0) });
        let exit = cleared.map_or_else(RawExit::Panicked, |()| RawExit::Cancelled);
        // SAFETY: also a drop that panics leaves nothing; this is the end of it.
        unsafe { self.end(exit) };
    }
}

/// # Safety
///
/// `task` is the head of a `Whole<F, B>` that is not built. This is its executor's thread.
unsafe fn build<F, B>(task: NonNull<Task>)
where
    B: FnOnce() -> F,
    F: Future<Output: ExitValue> + 'static,
{
    let methods = const {
        &current::Methods {
            ready_elsewhere,
            free,
            poll: poll::<F, B>,
            poll_attentively,
            body: body_range::<F, B>,
            seldom: Some(&BodyMethods {
                abandon: abandon::<F, B>,
            }),
        }
    };
    // SAFETY: the caller promises the head of a `Whole<F, B>` that is not built, on its executor's
    // thread. By the invariant of `Unbuilt` nothing else accesses its body.
    unsafe {
        body::<F, B>(task).build();
        start(task, methods);
    }
}

/// # Safety
///
/// As for [`build`], on any thread: `task` is the head of a `Whole<F, B>` that is not built.
unsafe fn clear<F: Future, B>(task: NonNull<Task>) {
    // SAFETY: the caller promises the head of a `Whole<F, B>` that is not built, so its body is the
    // builder, which may be sent. By the invariant of `Unbuilt` nothing else accesses it.
    unsafe { body::<F, B>(task).clear() };
}

/// Processes to be built, first come first served.
///
/// # Invariants
///
/// `first` leads to `last` along the links of records, each of an [`Unbuilt`] that is owned here.
pub(crate) struct Arrivals {
    first: *mut Retired,
    last: *mut Retired,
}

// SAFETY: it is a list of what may be sent.
unsafe impl Send for Arrivals {}

impl Default for Arrivals {
    fn default() -> Self {
        Self {
            first: ptr::null_mut(),
            last: ptr::null_mut(),
        }
    }
}

impl Arrivals {
    pub(crate) fn is_empty(&self) -> bool {
        self.first.is_null()
    }

    pub(crate) fn push(&mut self, one: Unbuilt) {
        one.record()
            .link()
            .store(ptr::null_mut(), Ordering::Relaxed);
        // SAFETY: the task of an `Unbuilt` is live.
        let record = unsafe { Task::record(ManuallyDrop::new(one).0) }
            .as_ptr()
            .cast();
        // SAFETY: by the invariant the last one, if there is one, is the record of an `Unbuilt`
        // that is owned here, so it is live; a record begins with its link.
        match unsafe { self.last.as_ref() } {
            Some(last) => last.link().store(record, Ordering::Relaxed),
            None => self.first = record,
        }
        self.last = record;
    }

    pub(crate) fn pop(&mut self) -> Option<Unbuilt> {
        let first = NonNull::new(self.first)?;
        // SAFETY: by the invariant the first one is the record of an `Unbuilt` that is owned here,
        // so it is live and lies in a task. It leaves the list, and is owned by the result.
        unsafe {
            self.first = first.as_ref().link().load(Ordering::Relaxed);
            if self.first.is_null() {
                self.last = ptr::null_mut();
            }
            Some(Unbuilt(first.byte_sub(offset_of!(Task, record)).cast()))
        }
    }
}

impl Drop for Arrivals {
    fn drop(&mut self) {
        while let Some(one) = self.pop() {
            drop(one);
        }
    }
}

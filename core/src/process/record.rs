//! The part of a process that others see: its name, how it ended, and what is done around its
//! polls.

use super::end::Shown;
use super::handle::ProcessSpec;
use super::monitor::Timing;
use super::{Kind, Methods, Name, Notice, Process, ProcessId, state};
use crate::biased_lock::BiasedLock;
use crate::current;
use crate::deferred_free::{self, Retired};
use crate::executor::Shared;
use crate::remote_wakes::WakeSlot;
use alloc::boxed::Box;
use alloc::sync::Arc;
use core::mem::offset_of;
use core::ops::Deref;
use core::ptr::{self, NonNull};
use core::task::Waker;
use luna_platform::sync::OnceLock;
use luna_platform::sync::plain::{AtomicPtr, Ordering};

/// What others see of a process.
pub(super) struct Record {
    /// Frees the memory that the process lies in.
    pub(super) retired: Retired,
    /// The next of the list of processes that have ended.
    pub(super) next: AtomicPtr<Process>,
    pub(super) name: Name,
    /// If something is done around each of its polls.
    pub(super) timing: Option<Box<Timing>>,
    /// The executor that runs it; none of one that is alone, and of what is left of one.
    pub(super) executor: Option<Arc<Shared>>,
    /// Where it is woken from other threads. Set under the lock `shown`, when it is built.
    pub(super) slot: OnceLock<WakeSlot>,
    /// Its end is [listed](ProcessSpec::listed).
    pub(super) is_listed: bool,
    /// See [`ProcessSpec::unhurried`].
    pub(super) is_unhurried: bool,
    /// The process' own thread takes it without atomics, unless others look at the process too.
    pub(super) shown: BiasedLock<Shown>,
}

impl Record {
    /// That of a process in a box, which nobody sees but by its name.
    pub(super) fn named(name: Name) -> Self {
        Self {
            retired: Retired::new(free::<Process>),
            next: AtomicPtr::new(ptr::null_mut()),
            name,
            timing: None,
            executor: None,
            slot: OnceLock::new(),
            is_listed: false,
            is_unhurried: false,
            shown: BiasedLock::new(Shown::new()),
        }
    }
}

/// Frees a process, which is the first part of a boxed `W`.
///
/// # Safety
///
/// `head` is the field of a process at the beginning of a boxed `W`, and is a pointer to all of
/// that. No reference to the process remains.
pub(super) unsafe fn free<W>(head: NonNull<Retired>) {
    // SAFETY: the caller promises that this alone has the process, by a pointer to all of the box.
    unsafe {
        let process = head.byte_sub(offset_of!(Process, record.retired));
        drop(Box::from_raw(process.cast::<W>().as_ptr()));
    }
}

/// As [`Methods::free`] requires: off the real-time path.
///
/// # Safety
///
/// The process has ended, and there is no reference to it. Its record frees the memory of which
/// `process` is a pointer.
pub(super) unsafe fn retire(process: NonNull<Process>) {
    // SAFETY: the caller promises that the process is not used any more, and that the pointer is
    // one to all of its memory.
    unsafe {
        let retired = &raw mut (*process.as_ptr()).record.retired;
        deferred_free::retire(NonNull::new_unchecked(retired));
    }
}

static WITHOUT_BODY: Methods = Methods::without_body(|_, _| {}, retire);

impl Process {
    /// A process of an executor, with one reference.
    pub(super) fn of_executor(
        spec: ProcessSpec,
        executor: Arc<Shared>,
        free: unsafe fn(NonNull<Retired>),
    ) -> Self {
        let (executor_id, priority) = (executor.executor_id, executor.thread_priority());
        let is_here = current::executor_id() == Some(executor_id);
        let record = Record {
            retired: Retired::new(free),
            timing: spec.timing,
            executor: Some(executor),
            is_listed: spec.is_listed,
            is_unhurried: spec.is_unhurried,
            shown: match is_here {
                true => BiasedLock::biased_in(current::Here::now(), Shown::new()),
                false => BiasedLock::new(Shown::new()),
            },
            ..Record::named(spec.name)
        };
        let process = Self::with_record(spec.id, executor_id, priority, spec.level, record);
        process.references.add_elsewhere();
        process
    }

    /// Puts it into memory of its own.
    fn boxed(self, kind: Kind) -> NonNull<Process> {
        let process = NonNull::from(Box::leak(Box::new(self)));
        // SAFETY: no other code knows it. Its record is that of a box, and what has its only
        // reference ends it once, or it has ended.
        unsafe {
            Process::set_methods(process, &WITHOUT_BODY);
            process.as_ref().kind.set(kind);
        }
        process
    }

    /// What is known of it once it has ended, in memory without the room of its body; `None` if
    /// there is more to know than is copied, or little to gain. Allocates.
    pub(super) fn without_body(&self) -> Option<ProcessRef> {
        let how = match self.outcome()? {
            state::PANICKED => return None,
            state::CANCELLED => state::CANCELLED,
            _ => state::COMPLETED,
        };
        let is_small = self.methods().of_body.range.len() <= 2 * size_of::<Process>();
        if is_small || self.record.timing.is_some() {
            return None;
        }
        let record = Record::named(self.record.name.clone());
        let rest = Self::with_record(self.id, self.executor_id, 0, self.own_level, record);
        rest.polls.store(self.polls(), Ordering::Relaxed);
        rest.references.add_elsewhere();
        let rest = rest.boxed(Kind::Alone);
        // SAFETY: it was never built, and this is the only call. The reference keeps it.
        unsafe {
            rest.as_ref().set_ended(how);
            Process::end(rest);
        }
        Some(ProcessRef(rest))
    }

    /// Requests its end, from any thread.
    pub(crate) fn cancel(&self) {
        self.notify(Notice::CANCELLED);
        let is_built = {
            // In one order with the thread that builds it: that finds the notice, or is found here.
            let _shown = self.record.shown.lock();
            self.record.slot.get().is_some()
        };
        if is_built && !self.has_ended() {
            self.wake();
        }
    }
}

/// A counted reference to a process.
///
/// # Invariants
///
/// It is counted among those that are not the executor's, so the process is live. The pointer may
/// be used for all of its memory.
pub(crate) struct ProcessRef(pub(super) NonNull<Process>);

// SAFETY: a process is used by shared references on any thread, and what frees it runs on any.
unsafe impl Send for ProcessRef {}
// SAFETY: `&ProcessRef` gives `&Process`, which is `Sync`, and clones, which are counted by an
// atomic.
unsafe impl Sync for ProcessRef {}

impl ProcessRef {
    /// One more reference to a process that is live.
    pub(super) fn to(process: &Process) -> Self {
        process.references.add_elsewhere();
        Self(process.whole())
    }
}

impl Deref for ProcessRef {
    type Target = Process;

    #[inline]
    fn deref(&self) -> &Process {
        // SAFETY: this reference is counted, so the process is live.
        unsafe { self.0.as_ref() }
    }
}

impl Clone for ProcessRef {
    #[inline]
    fn clone(&self) -> Self {
        self.references.add_elsewhere();
        Self(self.0)
    }
}

impl Drop for ProcessRef {
    #[inline]
    fn drop(&mut self) {
        if self.references.remove_elsewhere() {
            // SAFETY: it was the last reference to a process that has ended; the pointer may be
            // used for all of its memory.
            unsafe { Process::free(self.0) };
        }
    }
}

/// A process that is alone on its thread, and is woken by its waker. Its memory stays while there
/// are references to it.
///
/// Made and dropped on the executor's thread, between two polls. Allocates.
///
/// # Invariants
///
/// The pointer is to a live process until this is dropped.
pub struct Alone(
    NonNull<Process>,
    #[expect(dead_code, reason = "the process is polled with it")] Waker,
);

impl Alone {
    /// As [`Process::new`] for the executor that this thread has entered, with its waker.
    ///
    /// # Panics
    ///
    /// If this thread has entered no executor.
    pub fn new(id: ProcessId, thread_priority: u8, level: u8, waker: Waker) -> Self {
        let executor_id = current::executor_id().expect("this thread is an executor's");
        let process = Process::new(id, executor_id, thread_priority, level).boxed(Kind::Alone);
        // SAFETY: no other code knows the process yet. The waker is kept here as long as it is
        // polled.
        unsafe { process.as_ref().set_waker(ptr::read(&waker)) };
        Self(process, waker)
    }
}

impl Deref for Alone {
    type Target = Process;
    fn deref(&self) -> &Process {
        // SAFETY: by the type's invariant the process is live until this is dropped.
        unsafe { self.0.as_ref() }
    }
}

impl Drop for Alone {
    fn drop(&mut self) {
        // SAFETY: the type is not `Send`, so this is the thread that made it: that of its executor,
        // which does not poll it now or again, as the type demands. This is the only call.
        unsafe { Process::end(self.0) };
    }
}

luna_platform::debug_fields!(Alone, |alone| id: alone.id());

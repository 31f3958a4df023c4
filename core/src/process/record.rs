//! The part of a process that others see: its name, how it ended, and what is done around its
//! polls.

use super::end::Shown;
use super::handle::ProcessSpec;
use super::monitor::Timing;
use super::references::References;
use super::{Kind, Methods, Name, Notice, Process, ProcessId, state};
use crate::biased_lock::BiasedLock;
use crate::current;
use crate::deferred_free::{self, Retired};
use crate::executor::Shared;
use crate::remote_wakes::WakeSlot;
use alloc::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use alloc::boxed::Box;
use alloc::sync::Arc;
use core::cell::UnsafeCell;
use core::mem::offset_of;
use core::ops::Deref;
use core::ptr::{self, NonNull};
use core::task::Waker;
use luna_platform::on_drop::OnDrop;
use luna_platform::sync::plain::{AtomicPtr, Ordering};

/// What others see of a process.
///
/// # Invariants
///
/// The executor's thread writes `slot`, once, under the lock `shown`, as the process is built. It
/// is read on that thread, or by code that has a waker or has seen under the lock that it is there.
pub(super) struct Record {
    /// Frees the memory that the process lies in.
    pub(super) retired: Retired,
    /// How far the process lies behind the beginning of that memory, in bytes.
    shift: u32,
    /// The next of the list of processes that have ended.
    pub(super) next: AtomicPtr<Process>,
    pub(super) name: Name,
    /// If something is done around each of its polls.
    pub(super) timing: Option<Box<Timing>>,
    /// The executor that runs it; none of one that is alone, and of what is left of one.
    pub(super) executor: Option<Arc<Shared>>,
    /// Where it is woken from other threads.
    slot: UnsafeCell<Option<WakeSlot>>,
    /// Its end is [listed](ProcessSpec::listed).
    pub(super) is_listed: bool,
    /// See [`ProcessSpec::unhurried`].
    pub(super) is_unhurried: bool,
    /// The process' own thread takes it without atomics, unless others look at the process too.
    pub(super) shown: BiasedLock<Shown>,
}

impl Record {
    /// That of a process which nobody sees but by its name.
    pub(super) fn named(name: Name) -> Self {
        Self {
            retired: Retired::new(|_| {}),
            shift: 0,
            next: AtomicPtr::new(ptr::null_mut()),
            name,
            timing: None,
            executor: None,
            slot: UnsafeCell::new(None),
            is_listed: false,
            is_unhurried: false,
            shown: BiasedLock::new(Shown::new()),
        }
    }
}

/// The memory of a `W` at any address of the alignment that allocators give by themselves: for a
/// greater one they take several times as long.
const fn layout<W>() -> Layout {
    const COMMON: usize = 2 * size_of::<usize>();
    const { assert!(Process::ALIGN >= COMMON) };
    let size = size_of::<W>() + align_of::<W>() - COMMON;
    match Layout::from_size_align(size, COMMON) {
        Ok(layout) => layout,
        Err(_) => panic!("no process is as large as the address space"),
    }
}

/// Frees a process that was [placed](Process::placed).
///
/// # Safety
///
/// `head` is the field of a process at the beginning of a placed `W`, and is a pointer to all of
/// its memory. No reference to the process remains.
unsafe fn free<W>(head: NonNull<Retired>) {
    // SAFETY: the caller promises that this alone has the process, by a pointer to all of its
    // memory. `placed` has allocated that, and stated how far the process lies behind its start.
    unsafe {
        let process = head.byte_sub(offset_of!(Process, record.retired));
        let shift = process.cast::<Process>().as_ref().record.shift as usize;
        let _memory = OnDrop::new(|| {
            dealloc(process.byte_sub(shift).cast().as_ptr(), layout::<W>());
        });
        process.cast::<W>().drop_in_place();
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
    pub(super) fn of_executor(spec: ProcessSpec, executor: Arc<Shared>) -> Self {
        let (executor_id, priority) = (executor.executor_id, executor.thread_priority());
        let is_here = current::executor_id() == Some(executor_id);
        let record = Record {
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
        let mut process = Self::with_record(spec.id, executor_id, priority, spec.level, record);
        process.references = References::with_one();
        process
    }

    /// Puts it into memory of its own, as the first part of a `W`, the rest of which is not written
    /// yet. Its record then frees that.
    ///
    /// # Safety
    ///
    /// A `W` begins with a process.
    #[inline(always)]
    pub(super) unsafe fn placed<W>(mut self) -> NonNull<W> {
        // SAFETY: it has the size of a process at least.
        let Some(start) = NonNull::new(unsafe { alloc(layout::<W>()) }) else {
            handle_alloc_error(layout::<W>());
        };
        let shift = start.align_offset(align_of::<W>());
        self.record.retired = Retired::new(free::<W>);
        self.record.shift = shift as u32;
        // SAFETY: behind the shift, which is less than the alignment, there is room for a `W`, that
        // by the caller's promise begins with a process.
        unsafe {
            let whole = start.add(shift).cast::<W>();
            whole.cast::<Process>().write(self);
            whole
        }
    }

    /// Puts it into memory of its own.
    fn alone(self, kind: Kind) -> NonNull<Process> {
        // SAFETY: a process begins with itself. No other code knows it. What has its only reference
        // ends it once, or it has ended.
        unsafe {
            let process = self.placed::<Process>();
            Process::set_methods(process, &WITHOUT_BODY);
            process.as_ref().kind.set(kind);
            process
        }
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
        let mut rest = Self::with_record(self.id, self.executor_id, 0, self.own_level, record);
        rest.polls.store(self.polls(), Ordering::Relaxed);
        rest.references = References::with_one();
        let rest = rest.alone(Kind::Alone);
        // SAFETY: it was never built, and this is the only call. The reference keeps it.
        unsafe {
            rest.as_ref().set_ended(how);
            Process::end(rest);
        }
        Some(ProcessRef(rest))
    }

    /// Where it is woken from other threads, once it is built.
    ///
    /// # Safety
    ///
    /// This is its executor's thread, or the caller holds the lock `shown`, or knows from there or
    /// from a poll that it is built.
    #[inline]
    pub(super) unsafe fn slot(&self) -> Option<&WakeSlot> {
        // SAFETY: by the caller's promise it is not being written, and by the record's invariant it
        // does not change once it is there.
        unsafe { (*self.record.slot.get()).as_ref() }
    }

    /// Sets where it is woken from other threads.
    ///
    /// # Safety
    ///
    /// This is its executor's thread, which has just built it, and the only call.
    pub(super) unsafe fn set_slot(&self, slot: WakeSlot) {
        let _shown = self.record.shown.lock();
        // SAFETY: other threads read it under the lock alone until it is there, and the caller
        // promises that this thread has no borrow of it.
        unsafe { *self.record.slot.get() = Some(slot) };
    }

    /// Requests its end, from any thread.
    pub(crate) fn cancel(&self) {
        self.notify(Notice::CANCELLED);
        let is_built = {
            // In one order with the thread that builds it: that finds the notice, or is found here.
            let _shown = self.record.shown.lock();
            // SAFETY: it is written under this lock.
            unsafe { self.slot() }.is_some()
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
        let process = Process::new(id, executor_id, thread_priority, level).alone(Kind::Alone);
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

//! A process that is alone on its thread.

use super::process::{Methods, Process, ProcessId};
use crate::deferred_free::{self, Retired};
use alloc::boxed::Box;
use core::fmt;
use core::mem::offset_of;
use core::ops::{Deref, Range};
use core::ptr::NonNull;
use core::task::Waker;

/// A process that is alone on its thread, and is woken by its waker. Its memory stays while there
/// are references to it.
///
/// Made and dropped on the executor's thread, between two polls. Allocates.
///
/// # Invariants
///
/// The pointer is to a live allocation until this is dropped.
pub struct Lone(NonNull<Memory>);

#[repr(C, align(32))]
struct Memory {
    /// First, so that a pointer to it leads back to this.
    process: Process,
    retired: Retired,
    /// Where the body lies.
    body: Range<usize>,
}

const _: () = assert!(align_of::<Memory>() == Process::ALIGN);

/// Such a process is readied by its waker alone.
pub(super) static METHODS: Methods = Methods {
    ready_elsewhere: |_, _| {},
    free,
    // Its thread polls it.
    poll: |_, _| {},
    poll_attentively: |_, _| {},
    body,
    seldom: None,
};

impl Lone {
    /// As [`Process::new`] for the executor that this thread has entered, with its waker, and the
    /// addresses at which its body lies.
    ///
    /// # Panics
    ///
    /// If this thread has entered no executor.
    pub fn new(
        id: ProcessId,
        thread_priority: u8,
        level: u8,
        waker: Waker,
        body: Range<usize>,
    ) -> Self {
        let executor_id = super::executor_id().expect("this thread is an executor's");
        let memory = NonNull::from(Box::leak(Box::new(Memory {
            process: Process::new(id, executor_id, thread_priority, level),
            retired: Retired::new(free_retired),
            body,
        })));
        // SAFETY: no other code knows the process yet. It stays where it is until `free` was
        // called, and is ended once, by the drop.
        unsafe {
            memory.as_ref().process.set_waker(waker);
            memory.as_ref().process.set_owner(memory.cast(), &METHODS);
        }
        Self(memory)
    }
}

impl Deref for Lone {
    type Target = Process;
    fn deref(&self) -> &Process {
        // SAFETY: by the type's invariant the allocation is live until this is dropped.
        unsafe { &self.0.as_ref().process }
    }
}

impl Drop for Lone {
    fn drop(&mut self) {
        // SAFETY: the type is not `Send`, so this is the thread that made it: that of its executor,
        // which does not poll it now or again, as the type demands. This is the only call.
        unsafe { Process::end(self.0.cast()) };
    }
}

impl fmt::Debug for Lone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// # Safety
///
/// `owner` is memory that is live.
unsafe fn body(owner: NonNull<()>) -> Range<usize> {
    // SAFETY: the caller promises that the memory is live; the field does not change.
    unsafe { owner.cast::<Memory>().as_ref() }.body.clone()
}

/// # Safety
///
/// As [`Methods::free`] says: the process has ended, and there is no reference to it. `owner` is
/// the memory.
unsafe fn free(owner: NonNull<()>) {
    // SAFETY: `owner` is the pointer to the whole memory, and the caller promises that the process
    // has ended and that there is no reference to it: nothing uses the memory any more.
    unsafe {
        let memory = owner.cast::<Memory>().as_ptr();
        deferred_free::retire(NonNull::new_unchecked(&raw mut (*memory).retired));
    }
}

/// # Safety
///
/// `head` is the field of memory that is no longer used.
unsafe fn free_retired(head: NonNull<Retired>) {
    // SAFETY: the caller promises that the memory is no longer used; `new` made it from a box.
    unsafe {
        let memory = head.byte_sub(offset_of!(Memory, retired)).cast::<Memory>();
        drop(Box::from_raw(memory.as_ptr()));
    }
}

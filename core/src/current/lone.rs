//! A process that is alone on its thread.

use super::process::{Home, Methods, Process, ProcessId};
use crate::reclaim::{self, Retired};
use std::fmt;
use std::mem::offset_of;
use std::ops::{Deref, Range};
use std::ptr::NonNull;
use std::task::Waker;

/// A process that is alone on its thread, and is woken by its waker. Its memory stays for as long as somebody refers to it.
///
/// Made and dropped on the home's thread, between two polls. Allocates.
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

/// Such a process is never readied but by its waker.
pub(super) static METHODS: Methods = Methods {
    ready_elsewhere: |_, _| {},
    free,
    // Its thread polls it.
    poll: |_, _| false,
    body,
    seldom: None,
};

impl Lone {
    /// As [`Process::new`], with its waker, and the addresses at which its body lies.
    pub fn new(
        id: ProcessId,
        home: Home,
        thread_priority: u8,
        level: u8,
        waker: Waker,
        body: Range<usize>,
    ) -> Self {
        let memory = NonNull::from(Box::leak(Box::new(Memory {
            process: Process::new(id, home, thread_priority, level),
            retired: Retired::new(free_retired),
            body,
        })));
        // SAFETY: nobody else knows the process yet. It stays where it is until `free` was called, and is ended once, by the drop.
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
        // SAFETY: the type's invariant.
        unsafe { &self.0.as_ref().process }
    }
}

impl Drop for Lone {
    fn drop(&mut self) {
        // SAFETY: this is the home's thread by the type's contract, the process is not polled again, and this is the only call.
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
    // SAFETY: the contract; it does not change.
    unsafe { owner.cast::<Memory>().as_ref() }.body.clone()
}

/// # Safety
///
/// As [`Methods::free`] says; `owner` is the memory.
unsafe fn free(owner: NonNull<()>) {
    // SAFETY: the contract; the pointer is made of that to the whole.
    unsafe {
        let memory = owner.cast::<Memory>().as_ptr();
        reclaim::retire(NonNull::new_unchecked(&raw mut (*memory).retired));
    }
}

/// # Safety
///
/// `head` is the field of memory that nobody uses any more.
unsafe fn free_retired(head: NonNull<Retired>) {
    // SAFETY: the contract; `new` made it of a box.
    unsafe {
        let memory = head.byte_sub(offset_of!(Memory, retired)).cast::<Memory>();
        drop(Box::from_raw(memory.as_ptr()));
    }
}

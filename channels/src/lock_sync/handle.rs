//! The handles of a mutex or a semaphore.

use super::core::Core;
use crate::inspect::WaitPointKind;
use luna_core::deferred_free::Retired;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicUsize, Ordering};
use std::fmt;
use std::marker::PhantomData;
use std::mem::ManuallyDrop;
use std::ptr::NonNull;

/// What the handles share.
///
/// # Invariants
///
/// `value` is accessed by the holder of the mutex, and dropped with the last handle. The memory
/// goes with the core's last reference.
#[repr(C)]
struct Shared<T> {
    /// First, so that it leads back to this.
    core: Core,
    handles: AtomicUsize,
    value: UnsafeCell<ManuallyDrop<T>>,
}

/// One of the owners of a core, and of the value that it guards.
pub(super) struct Handle<T> {
    shared: NonNull<Shared<T>>,
    _owns: PhantomData<Shared<T>>,
}

// SAFETY: handles share a value that one at a time accesses, on whichever thread; all else is
// guarded by a lock, or atomic.
unsafe impl<T: Send> Send for Handle<T> {}
// SAFETY: as above.
unsafe impl<T: Send> Sync for Handle<T> {}
// What a panic leaves half done is marked.
impl<T> std::panic::UnwindSafe for Handle<T> {}
impl<T> std::panic::RefUnwindSafe for Handle<T> {}

impl<T> Handle<T> {
    #[track_caller]
    pub(super) fn new(kind: WaitPointKind, permits: u32, value: T) -> Self {
        let shared = NonNull::from(Box::leak(Box::new(Shared {
            // SAFETY: it is registered next.
            core: unsafe { Core::new(kind, permits, Shared::<T>::free) },
            handles: AtomicUsize::new(1),
            value: UnsafeCell::new(ManuallyDrop::new(value)),
        })));
        // SAFETY: it is new, and stays in its box.
        unsafe { shared.as_ref().core.wait_point.register() };
        Handle {
            shared,
            _owns: PhantomData,
        }
    }

    fn shared(&self) -> &Shared<T> {
        // SAFETY: this handle keeps it alive.
        unsafe { self.shared.as_ref() }
    }

    #[inline]
    pub(super) fn core(&self) -> &Core {
        &self.shared().core
    }

    /// The core, by a pointer to the whole.
    #[inline]
    pub(super) fn core_pointer(&self) -> NonNull<Core> {
        self.shared.cast()
    }

    pub(super) fn value(&self) -> &UnsafeCell<ManuallyDrop<T>> {
        &self.shared().value
    }
}

impl<T> Shared<T> {
    /// # Safety
    ///
    /// `head` begins a whole that is not used any more; its value is dropped.
    unsafe fn free(head: NonNull<Retired>) {
        // SAFETY: `Handle::new` made it of a box, and the head is its first field's first.
        drop(unsafe { Box::from_raw(head.cast::<Shared<T>>().as_ptr()) });
    }
}

impl<T> Clone for Handle<T> {
    fn clone(&self) -> Self {
        self.shared().handles.fetch_add(1, Ordering::Relaxed);
        Handle {
            shared: self.shared,
            _owns: PhantomData,
        }
    }
}

impl<T> Drop for Handle<T> {
    fn drop(&mut self) {
        if self.shared().handles.fetch_sub(1, Ordering::AcqRel) != 1 {
            return;
        }
        struct LetGo(NonNull<Core>);
        impl Drop for LetGo {
            fn drop(&mut self) {
                // SAFETY: the last handle's, and operations borrow theirs.
                unsafe { Core::let_go(self.0) };
            }
        }
        let _let_go = LetGo(self.core_pointer());
        // SAFETY: this was the last handle, so the mutex is free, and can never be locked again:
        // the value is dropped once.
        self.value()
            .with_mut(|value| unsafe { ManuallyDrop::drop(&mut *value) });
    }
}

impl<T> fmt::Debug for Handle<T> {
    /// Without locking it: debug output never waits, and must not make others wait.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.shared.fmt(f)
    }
}

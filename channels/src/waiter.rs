//! The node of a waiting operation, and what it comes to.

use luna_platform::current::{Ready, Wakeup};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU8, Ordering};
use luna_platform::wait_list::WaitNode;
use std::mem::MaybeUninit;
use std::ptr::NonNull;

/// What a waiting operation came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Outcome {
    Waiting,
    Done,
    Closed,
    Poisoned,
}

/// The node of a waiting operation, inside its future.
///
/// # Invariants
///
/// While `outcome` is `Waiting` and the node is listed, the channel's lock guards all of it. A settled node belongs to its future.
/// `value` holds a value if it is a sender's that is not done, or a receiver's that is.
#[repr(C)]
pub(crate) struct Waiter<T> {
    /// First, so that the list's node leads back to this.
    pub(crate) wait: WaitNode,
    pub(crate) outcome: AtomicU8,
    value: UnsafeCell<MaybeUninit<T>>,
}

impl<T> Waiter<T> {
    /// A sender's node.
    pub(crate) fn with_value(value: T) -> Self {
        Self {
            wait: WaitNode::new(),
            outcome: AtomicU8::new(Outcome::Waiting as u8),
            value: UnsafeCell::new(MaybeUninit::new(value)),
        }
    }

    /// A receiver's node.
    pub(crate) fn empty() -> Self {
        Self {
            wait: WaitNode::new(),
            outcome: AtomicU8::new(Outcome::Waiting as u8),
            value: UnsafeCell::new(MaybeUninit::uninit()),
        }
    }

    /// What the operation has come to. Acquire: who sees an outcome sees the value that came with it.
    ///
    /// Takes a pointer, since without the lock there must be no reference to the parts of a listed node that others change.
    ///
    /// # Safety
    ///
    /// `node` is live.
    #[inline]
    pub(crate) unsafe fn outcome(node: NonNull<Waiter<T>>) -> Outcome {
        // SAFETY: the contract; this borrows the one field, which is atomic.
        match unsafe { (*node.as_ptr()).outcome.load(Ordering::Acquire) } {
            0 => Outcome::Waiting,
            1 => Outcome::Done,
            2 => Outcome::Closed,
            _ => Outcome::Poisoned,
        }
    }

    /// Moves the value out.
    ///
    /// # Safety
    ///
    /// There is one, and nobody else accesses the node.
    #[inline]
    pub(crate) unsafe fn take_value(&self) -> T {
        // SAFETY: the contract.
        self.value
            .with(|value| unsafe { (*value).assume_init_read() })
    }

    /// Puts a value in.
    ///
    /// # Safety
    ///
    /// There is none, and nobody else accesses the node.
    #[inline]
    pub(crate) unsafe fn put_value(&self, new: T) {
        // SAFETY: the contract.
        self.value.with_mut(|value| unsafe { (*value).write(new) });
    }

    /// Takes out whom to wake.
    ///
    /// # Safety
    ///
    /// `node` is live, and the lock is held that guards it.
    #[inline]
    unsafe fn take_wakeup(node: NonNull<Waiter<T>>) -> Ready {
        // SAFETY: the contract.
        unsafe {
            // loom does not watch the wakeup: to it, this is an access to the value beside it, which must be over when the outcome is set.
            #[cfg(loom)]
            (*node.as_ptr()).value.with_mut(|_| ());
            (*node.as_ptr())
                .wait
                .wakeup_mut()
                .take()
                .map_or(Ready::NOBODY, Wakeup::take)
        }
    }

    /// Settles a waiting operation that was just unlisted, and says whom to ready. The node is not to be touched after this.
    ///
    /// # Safety
    ///
    /// `node` is a waiter's, was taken off its list under the lock that is still held, and what it says it holds is true of
    /// `outcome`.
    #[inline]
    pub(crate) unsafe fn settle(node: NonNull<Waiter<T>>, outcome: Outcome) -> Ready {
        // SAFETY: the future is pending until the store, and cannot go while the lock is held.
        unsafe {
            let ready = Self::take_wakeup(node);
            // Release: the value and all that came before is visible to who sees the outcome.
            (*node.as_ptr())
                .outcome
                .store(outcome as u8, Ordering::Release);
            ready
        }
    }
}

//! Source of a send's value: the send itself, a slot to which it goes back if it is not sent, or a
//! closure that makes it when it is taken.

use crate::operation::{Node, Sending};
use crate::waiter::{Make, Waiter};
use core::fmt;
use core::ptr::NonNull;
use luna_platform::panics::catch_unwind;

/// A send's node with its source.
pub(crate) type Offered<T, S> = Node<T, Sending<S>>;

/// Source of a value. Sealed: its module is private.
///
/// # Safety
///
/// With `MAKE`, it uses nothing that it borrows: it runs on another thread, perhaps after the
/// future that it lies in was leaked.
pub unsafe trait Source<T>: Sized {
    /// Result of a failed send, given back to the caller.
    type Unsent;

    /// Makes the value, if it is not in the node.
    #[doc(hidden)]
    const MAKE: Option<Make<T>> = None;

    /// Whether there is, or will be, a value.
    #[inline]
    fn is_open(&self) -> bool {
        true
    }

    /// Gives back the unsent value.
    ///
    /// # Safety
    ///
    /// The value was not taken, no other thread accesses the node, and this is called once.
    unsafe fn unsent(node: &mut Node<T, Sending<Self>>) -> Self::Unsent;
}

/// The value lies in the node: [`Sender::send`](crate::Sender::send).
#[derive(Debug)]
pub struct InNode;

// SAFETY: nothing is made.
unsafe impl<T> Source<T> for InNode {
    type Unsent = T;

    #[inline]
    unsafe fn unsent(node: &mut Offered<T, Self>) -> T {
        // SAFETY: the value was not taken, and this is called once, as is demanded here: so it is
        // there.
        unsafe { Waiter::take_value_of(NonNull::from(&mut node.waiter)) }
    }
}

/// The value lies in the node, and goes back to its slot if it is not sent:
/// [`Sender::send_from`](crate::Sender::send_from).
///
/// Not in the slot: partners would then access memory that the send borrows, also after the end of
/// the borrow if the send was leaked.
pub struct FromSlot<'a, T> {
    slot: &'a mut Option<T>,
    was_full: bool,
}

impl<T> fmt::Debug for FromSlot<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("FromSlot")
    }
}

// SAFETY: nothing is made.
unsafe impl<T> Source<T> for FromSlot<'_, T> {
    type Unsent = ();

    fn is_open(&self) -> bool {
        self.was_full
    }

    unsafe fn unsent(node: &mut Offered<T, Self>) {
        let source = &mut node.direction.source;
        if source.was_full {
            // SAFETY: the slot was full, so the value came into the node; it was not taken, and
            // this is called once, as is demanded here.
            *source.slot = Some(unsafe { Waiter::take_value_of(NonNull::from(&mut node.waiter)) });
        }
    }
}

impl<'a, T> FromSlot<'a, T> {
    /// The waiter with the value of the slot, if there is one, and the source.
    pub(crate) fn take_from(slot: &'a mut Option<T>) -> (Waiter<T>, Self) {
        let value = slot.take();
        let was_full = value.is_some();
        let waiter = value.map_or_else(Waiter::empty, Waiter::with_value);
        (waiter, FromSlot { slot, was_full })
    }
}

/// The value is made when it is taken: [`Sender::send_with`](crate::Sender::send_with).
pub struct Made<F>(Option<F>);

impl<F> fmt::Debug for Made<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Made")
    }
}

// SAFETY: the closure borrows nothing that ends.
unsafe impl<T, F: FnOnce() -> T + Send + 'static> Source<T> for Made<F> {
    type Unsent = ();
    const MAKE: Option<Make<T>> = Some(make_by_closure::<T, F>);

    unsafe fn unsent(_: &mut Offered<T, Self>) {}
}

impl<F> Made<F> {
    pub(crate) fn new(make: F) -> Self {
        Self(Some(make))
    }
}

/// # Safety
///
/// As [`Make`]: the node is that of an `Offered<T, Made<F>>`, and no other thread accesses it.
unsafe fn make_by_closure<T, F: FnOnce() -> T + Send>(node: NonNull<Waiter<T>>) -> Option<T> {
    // SAFETY: by `# Safety` the node is the first field of such an `Offered`, and no other thread
    // accesses it: the closure can be taken out.
    let make = unsafe {
        let offered = node.cast::<Offered<T, Made<F>>>().as_ptr();
        (*offered).direction.source.0.take()
    }?;
    match catch_unwind(make) {
        Ok(value) => Some(value),
        Err(payload) => {
            // Its drop is the user's code, and this is under the lock. The panic hook has reported
            // it.
            core::mem::forget(payload);
            None
        }
    }
}

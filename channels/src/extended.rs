//! Extended rendezvous: the sender is held until the receiver is done with the value.

use crate::end::End;
use crate::finally::Finally;
use luna_core::current::Priority;
use std::fmt;
use std::ops::{Deref, DerefMut};

/// State that a mode's receive keeps beside its node, whatever the type of the value. Sealed: its
/// module is private.
pub trait Noted {
    /// The state.
    type Note: Default + Send;
}

/// Whether a receive holds its sender. Sealed: its module is private.
pub trait Mode<T>: Noted {
    /// Result of a receive.
    type Received<'a>
    where
        T: 'a;
    /// Whether the sender is held.
    const HOLDS: bool;
    /// Whether the note is an inheritor, boosted by the held sender.
    const INHERITS: bool = false;

    /// The receive is about to wait, in the current process.
    #[inline]
    fn waits(_note: &mut Self::Note) {}

    /// A sender of this priority is held from now on, by the current process.
    #[inline]
    fn holds(_note: &mut Self::Note, _sender: Priority) {}

    /// Makes the result of a receive of a value, and of the number of the rendezvous with a held
    /// sender; 0 for none.
    fn received<'a>(end: &'a End<T>, value: T, ticket: u32, note: Self::Note)
    -> Self::Received<'a>;

    /// Returns to its channel the value of a receive that was dropped before it could hand it on.
    #[inline]
    fn return_value(end: &End<T>, value: T, ticket: u32) {
        // Also if the waker of the next receiver panics.
        let _release = Finally::new(|| end.channel().release_held(ticket));
        end.channel().return_value(value);
    }
}

/// The sender is released when the value is taken.
#[derive(Debug)]
pub struct Releasing;

impl Noted for Releasing {
    type Note = ();
}

impl<T> Mode<T> for Releasing {
    type Received<'a>
        = T
    where
        T: 'a;
    const HOLDS: bool = false;

    #[inline]
    fn received(_: &End<T>, value: T, _: u32, (): ()) -> T {
        value
    }
}

/// The sender is released when the receiver is done.
#[derive(Debug)]
pub struct Extending;

impl Noted for Extending {
    type Note = ();
}

impl<T> Mode<T> for Extending {
    type Received<'a>
        = Extended<'a, T>
    where
        T: 'a;
    const HOLDS: bool = true;

    fn received<'a>(end: &'a End<T>, value: T, ticket: u32, (): ()) -> Extended<'a, T> {
        Extended {
            value,
            _held: Held { end, ticket },
        }
    }
}

/// A value that holds its sender until it is dropped: see [`Receiver::recv_extended`](crate::Receiver::recv_extended).
///
/// Dropping it is for the real-time path: O(senders that are held on this channel), which are as
/// many as there are extended rendezvous under way. A forgotten one holds its sender until the
/// channel is poisoned.
#[must_use = "the sender goes on when this is dropped"]
pub struct Extended<'a, T> {
    /// Dropped before the sender is released.
    value: T,
    _held: Held<'a, T>,
}

impl<T> Extended<'_, T> {
    /// Releases the sender, and returns the value.
    pub fn finish(self) -> T {
        self.value
    }
}

impl<T> Deref for Extended<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> DerefMut for Extended<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.value
    }
}

impl<T: fmt::Debug> fmt::Debug for Extended<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Extended").field(&self.value).finish()
    }
}

/// Releases the sender when dropped.
struct Held<'a, T> {
    end: &'a End<T>,
    ticket: u32,
}

impl<T> Drop for Held<'_, T> {
    fn drop(&mut self) {
        self.end.channel().release_held(self.ticket);
    }
}

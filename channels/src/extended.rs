//! Extended rendezvous: the sender is held until the receiver is done with the value.

use crate::end::End;
use crate::ended::ChannelEnd;
use crate::finally::Finally;
use crate::waiter::{Outcome, Waiter};
use core::fmt;
use core::ops::{Deref, DerefMut};
use luna_core::current::Priority;

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
            held: Held { end, ticket },
        }
    }
}

/// A value that holds its sender until it is dropped: see
/// [`Receiver::recv_extended`](crate::Receiver::recv_extended).
///
/// Dropping it is for the real-time path: O(senders that are held on this channel), which are as
/// many as there are extended rendezvous under way. A forgotten one holds its sender until the
/// channel is poisoned.
#[must_use = "the sender goes on when this is dropped"]
pub struct Extended<'a, T> {
    /// Dropped before the sender is released.
    value: T,
    held: Held<'a, T>,
}

impl<'a, T> Extended<'a, T> {
    /// Releases the sender, and returns the value.
    pub fn finish(self) -> T {
        self.value
    }

    /// The value, and what holds the sender until it is dropped. For a receiver that passes the
    /// value itself on, and lets the sender go on when that is done.
    ///
    /// Real-time path: yes, O(1). No allocation.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// # block_on(async {
    /// let (sender, receiver) = luna_channels::channel::<&str>();
    /// let (onward, end) = luna_channels::channel();
    /// let relay = async {
    ///     let (value, held) = receiver.recv_extended().await?.hold();
    ///     onward.send(value).await.unwrap();
    ///     drop(held); // only now does the sender go on
    ///     Ok::<(), luna_channels::RecvError>(())
    /// };
    /// let (sent, (relayed, received)) = zip(sender.send("value"), zip(relay, end.recv())).await;
    /// assert_eq!((sent, relayed, received), (Ok(()), Ok(()), Ok("value")));
    /// # })
    /// ```
    pub fn hold(self) -> (T, Held<'a, T>) {
        (self.value, self.held)
    }

    /// Refuses the value: the sender gets it back, with the error of a channel with this `end`. For
    /// a receiver that passes values on, and could not pass on this one. The channel stays as it
    /// is: poison or drop the receiver afterwards if no other value can be passed on either.
    ///
    /// A sender that has gone on already (at its deadline, or since it was cancelled) cannot get
    /// the value back: it is returned here. A value that was made by
    /// [`send_with`](crate::Sender::send_with) is dropped. Real-time path: yes, O(senders that are
    /// held on this channel). No allocation.
    ///
    /// ```
    /// # use futures_lite::future::{block_on, zip};
    /// # use luna_channels::ChannelEnd;
    /// # block_on(async {
    /// let (sender, receiver) = luna_channels::channel::<u32>();
    /// let relay = async { receiver.recv_extended().await.unwrap().refuse(ChannelEnd::Closed) };
    /// let (sent, rest) = zip(sender.send(5), relay).await;
    /// let error = sent.unwrap_err();
    /// assert!(error.is_closed());
    /// assert_eq!((error.into_inner(), rest), (5, None));
    /// # })
    /// ```
    pub fn refuse(self, end: ChannelEnd) -> Option<T> {
        let Self { value, held } = self;
        let Held { end: of, ticket } = &held;
        let mut value = Some(value);
        let mut is_back = true;
        of.channel().finish_held(*ticket, |sender| {
            // SAFETY: a held sender's node was begun and holds no value, and the lock is held.
            unsafe {
                if Waiter::make(sender).is_some() {
                    is_back = false;
                } else if let Some(value) = value.take() {
                    Waiter::put_value_of(sender, value);
                }
            }
            match end {
                ChannelEnd::Closed => Outcome::Closed,
                ChannelEnd::Poisoned => Outcome::Poisoned,
            }
        });
        // The ticket is used up: what drops `held` finds no sender.
        value.filter(|_| is_back)
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

/// Holds the sender of a value until it is dropped: see [`Extended::hold`]. The drop is
/// O(senders that are held), allocates nothing, and may be on the real-time path.
#[must_use = "the sender goes on when this is dropped"]
pub struct Held<'a, T> {
    end: &'a End<T>,
    ticket: u32,
}

impl<T> Drop for Held<'_, T> {
    fn drop(&mut self) {
        self.end.channel().release_held(self.ticket);
    }
}

luna_platform::debug_fields!(impl[T] Held<'_, T>);

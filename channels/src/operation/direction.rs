//! In what a send and a receive differ.

use super::{Node, Operation};
use crate::core::{Attempted, ChannelGuard};
use crate::error::Ended;
use crate::wait_point::WaitQueues;
use crate::waiter::{Begun, Make, Outcome};
use core::ops::DerefMut;
use core::ptr::NonNull;
use core::task::Context;

/// The direction of an [`Operation`]: [`Sending`](super::Sending) a value of some source, or
/// [`Receiving`](super::Receiving) one in some mode. Sealed: its module is private.
pub trait Direction<T>: Sized {
    /// What a successful operation returns.
    type Success<'a>
    where
        T: 'a;
    /// Why the channel let it fail.
    type Failure: Ended;
    /// What a new operation is made of: as small as can be, since it is moved until an alternative
    /// is polled.
    type Seed<'a>
    where
        T: 'a;

    /// The operation's name in messages.
    const NAME: &'static str;
    /// Whether it sends: all that the channel needs of a direction.
    const SEND: bool;
    /// Whether the fast path and hand-off slots can be used: the value moves from node to node, and
    /// no more is to be done.
    const PLAIN: bool;
    /// Whether an operation that has waited, and is done, has its result at once.
    const PLAIN_WHEN_MET: bool = Self::PLAIN;
    /// Whether it waits for an answer while it is held. An alternative in a failed branch does not
    /// fail by it, and it does not stay held in one.
    const ANSWERED: bool = false;
    /// Whether an operation that is over has anything to drop.
    const DROPS: bool = true;
    /// What makes a send's value when it is taken, if that does not lie in the node.
    const MAKE: Option<Make<T>> = None;
    /// How its node is begun to be listed.
    const BEGUN: Begun = Begun::InFull;

    /// Whether it can ever happen. Asked while it is new.
    #[inline(always)]
    fn is_open(&self) -> bool {
        true
    }

    /// It is about to wait, in the current process.
    #[inline(always)]
    fn waits(&mut self) {}

    /// Makes it happen at once, if possible: here a send. O(1).
    ///
    /// # Safety
    ///
    /// `node` is a new operation's, of the locked channel. With `cx`, it stays where it is until it
    /// is settled or withdrawn.
    #[inline]
    unsafe fn attempt<L: DerefMut<Target = WaitQueues>>(
        node: NonNull<Node<T, Self>>,
        locked: &mut ChannelGuard<'_, T, L>,
        cx: Option<&Context<'_>>,
    ) -> Attempted {
        // SAFETY: the node is a new operation's, as is demanded here: it is in no queue, only its
        // future knows it, and by the operation's invariants it holds its value, or can make it. It
        // begins with its waiter. With `cx` it stays.
        unsafe { locked.send_now(node.cast(), Self::MAKE, cx) }
    }

    /// Takes the result of an operation that has communicated, so. Only one that is
    /// [answered](Self::ANSWERED) can have failed all the same.
    fn succeeded<'a>(
        operation: &mut Operation<'a, T, Self>,
        outcome: Outcome,
    ) -> Result<Self::Success<'a>, Self::Failure>;

    /// Takes the failure of an operation that has failed.
    fn failed(operation: &mut Operation<'_, T, Self>, poisoned: bool) -> Self::Failure;

    /// What an operation returns in a replay that has met no partner before its channel closed,
    /// although the recorded one had. `None`: it fails.
    fn closed_later<'a>() -> Option<Result<Self::Success<'a>, Self::Failure>>
    where
        T: 'a;

    /// Drops what an operation with this outcome has left.
    fn dropped(operation: &mut Operation<'_, T, Self>, outcome: Outcome);

    /// Takes a new operation for its seed.
    fn into_seed<'a>(operation: Operation<'a, T, Self>) -> Self::Seed<'a>;

    /// Makes the operation that the seed was.
    fn from_seed<'a>(seed: Self::Seed<'a>) -> Operation<'a, T, Self>
    where
        T: 'a;
}

/// The direction of an operation that may give up.
pub trait GivesUp<T>: Direction<T> {
    /// Why it fails, if it may give up.
    type TimeoutFailure: Ended + From<Self::Failure>;

    /// Takes the failure of an operation that gives up.
    fn timed_out(operation: &mut Operation<'_, T, Self>) -> Self::TimeoutFailure;
}

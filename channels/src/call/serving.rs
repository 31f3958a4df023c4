//! The mode of a server's receive: it holds its client, inherits its priority, and gives a call
//! back that was not handed on.

use super::{Call, Message};
use crate::core::Channel;
use crate::end::End;
use crate::extended::{Mode, Noted};
use crate::operation::Node;
use crate::wait_point::Ending;
use crate::waiter::{Begun, Outcome, Waiter};
use core::ptr::NonNull;
use luna_core::current::{Inheritor, Priority};

/// The client is held until it is answered, and its priority is inherited.
#[derive(Debug)]
pub struct Serving;

impl Noted for Serving {
    type Note = Option<Inheritor>;
}

impl<Q, A> Mode<Message<Q, A>> for Serving {
    type Received<'a>
        = Call<'a, Q, A>
    where
        Q: 'a,
        A: 'a;
    const HOLDS: bool = true;
    const INHERITS: bool = true;

    fn waits(note: &mut Option<Inheritor>) {
        *note = Inheritor::current();
    }

    fn holds(note: &mut Option<Inheritor>, sender: Priority) {
        *note = Inheritor::current();
        if let Some(inheritor) = note {
            inheritor.inherit(sender);
        }
    }

    fn received<'a>(
        end: &'a End<Message<Q, A>>,
        message: Message<Q, A>,
        ticket: u32,
        inheritor: Option<Inheritor>,
    ) -> Call<'a, Q, A> {
        Call::accepted(end, message, ticket, inheritor)
    }

    fn return_value(end: &End<Message<Q, A>>, message: Message<Q, A>, ticket: u32) {
        end.channel().wait_again(message, ticket);
    }
}

/// The receiver inherits the priority of the sender that it holds, if it is an inheritor.
///
/// # Safety
///
/// `receiver` was listed in this channel, and was committed under the lock that is still held.
#[inline]
pub(crate) unsafe fn boost_to_receiver<T>(receiver: NonNull<Waiter<T>>, sender: Priority) {
    // SAFETY: the receiver is not settled and the lock is held that guards it: so it is live, and
    // this thread's. One that inherits was begun as a receive of such a mode: its waiter is
    // followed by its direction, which is the note alone.
    unsafe {
        if Waiter::begun(receiver) == Begun::Serving {
            let node = receiver.cast::<Node<T, Option<Inheritor>>>().as_ptr();
            if let Some(inheritor) = &mut (*node).direction {
                inheritor.inherit(sender);
            }
        }
    }
}

impl<T> Channel<T> {
    /// Takes a value back from a receiver that holds its sender, if it still does: the most urgent
    /// waiting receiver gets it, or the sender waits again, before those of its priority. Otherwise
    /// the value is dropped. O(held senders), and O(waiting senders of higher priority).
    fn wait_again(&self, value: T, ticket: u32) {
        let mut locked = self.lock();
        let is_poisoned = locked.lists.ending == Ending::Poisoned;
        // Else the sender is gone. Poisoning the channel releases it too.
        let Some(sender) = locked.held(ticket).filter(|_| !is_poisoned) else {
            drop(locked);
            return drop(value);
        };
        // SAFETY: the sender was found, and the receiver is committed here; a held sender holds no
        // value, nor does a receiver before it is done.
        unsafe {
            if let Some(receiver) = locked.commit_receiver(true) {
                Waiter::put_value_of(receiver, value);
                (*Waiter::link(receiver)).ticket = ticket;
                boost_to_receiver(receiver, (*Waiter::link(sender)).wait.priority());
                let ready = Waiter::settle(receiver, Outcome::Done);
                drop(locked);
                ready.wake();
                return;
            }
            locked.lists.held.remove(sender.cast());
            Waiter::put_value_of(sender, value);
            // Its alternative has chosen it for good: no partner may commit that again.
            Waiter::leave_select_state(sender);
            Waiter::set_outcome(sender, Outcome::Waiting);
            locked.lists.senders.insert_again_first(sender.cast());
            locked.boost_while_they_wait();
        }
    }
}

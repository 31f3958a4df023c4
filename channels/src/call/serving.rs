//! The mode of a server's receive: it holds its client, inherits its priority, and gives a call
//! back that was not handed on.

use crate::core::Channel;
use crate::extended::{Mode, Noted};
use crate::recv::Receiver;
use crate::wait_point::Ending;
use crate::waiter::{Outcome, Waiter};
use luna_core::current::{Inheritor, Priority};
use luna_platform::sync::atomic::Ordering;
use std::ptr::NonNull;

/// The client is held until it is answered, and its priority is inherited.
#[derive(Debug)]
pub(super) struct Serving;

/// A value with its sender held by ticket, and the server's boost for it.
#[derive(Debug)]
pub(super) struct Accepted<'a, T> {
    pub(super) receiver: &'a Receiver<T>,
    pub(super) value: T,
    pub(super) ticket: u32,
    pub(super) inheritor: Option<Inheritor>,
}

impl Mode for Serving {
    type Received<'a, T: 'a> = Accepted<'a, T>;
    type Note = Option<Inheritor>;
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

    fn received<'a, T>(
        receiver: &'a Receiver<T>,
        value: T,
        ticket: u32,
        inheritor: Option<Inheritor>,
    ) -> Accepted<'a, T> {
        Accepted {
            receiver,
            value,
            ticket,
            inheritor,
        }
    }

    fn give_back<T>(receiver: &Receiver<T>, value: T, ticket: u32) {
        receiver.channel().wait_again(value, ticket);
    }
}

/// The receiver inherits the priority of the sender that it holds, if it is an inheritor.
///
/// # Safety
///
/// `receiver` was listed in this channel, and was committed under the lock that is still held.
#[inline]
pub(crate) unsafe fn boost_to_receiver<T>(receiver: NonNull<Waiter<T>>, sender: Priority) {
    // SAFETY: the contract: under the lock a node that is not settled is not its future's. One that
    // inherits is noted with an inheritor.
    unsafe {
        if (*Waiter::link(receiver)).inherits {
            let noted = receiver.cast::<Noted<T, Option<Inheritor>>>().as_ptr();
            if let Some(inheritor) = &mut (*noted).note {
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
        let mut next = locked.lists.held.first();
        let sender = loop {
            let Some(node) = next else {
                // The sender is gone, or the channel was poisoned.
                drop(locked);
                return drop(value);
            };
            // SAFETY: a node in the list is a live waiter that the lock guards.
            unsafe {
                if (*Waiter::<T>::link(node.cast())).ticket == ticket {
                    break node;
                }
                next = locked.lists.held.after(node);
            }
        };
        debug_assert!(locked.lists.ending != Ending::Poisoned);
        // SAFETY: the sender was found, and the receiver is committed here; a held sender holds no
        // value, nor does a receiver before it is done.
        unsafe {
            if let Some(receiver) = locked.commit_receiver(true) {
                receiver.as_ref().put_value(value);
                (*Waiter::link(receiver)).ticket = ticket;
                boost_to_receiver(receiver, sender.as_ref().priority());
                let ready = Waiter::settle(receiver, Outcome::Done);
                drop(locked);
                ready.wake();
                return;
            }
            locked.lists.held.remove(sender);
            let waiter = sender.cast::<Waiter<T>>();
            let link = Waiter::link(waiter);
            waiter.as_ref().put_value(value);
            // Its alternative has chosen it for good: no partner may commit that again.
            Waiter::leave_select_state(waiter);
            (*link)
                .outcome
                .store(Outcome::Waiting as u8, Ordering::Release);
            locked.lists.senders.insert_again_first(sender);
            locked.boost_while_they_wait();
        }
    }
}

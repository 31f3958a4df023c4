//! Calls: request and reply in one, built on the extended rendezvous.
//!
//! A call is a send that holds its sender until the reply. The reply comes back in the sender's own
//! node:
//!
//! ```text
//!   client's node:  WAITING(request) --accept--> HELD() --reply------> ANSWERED(answer)
//!                          ^                       | |---no reply----> ANSWERED(nothing)
//!                          '--accept was dropped---' '---poison------> DONE()
//! ```
//!
//! Each step happens under the channel's lock, and the reply looks for the client there: a client
//! with a dropped future is not found, and never written to. There is no second channel, and no
//! allocation.

mod accepted;
mod client;
mod server;

pub use accepted::{Call, CallError, Reply};
pub use client::{CallOp, Client};
pub use server::{AcceptOp, Server};

use crate::buffer::Buffer;
use crate::core::Channel;
use crate::end::End;
use crate::extended::{Mode, Noted};
use crate::operation::Node;
use crate::wait_point::Ending;
use crate::waiter::{Begun, Outcome, Waiter};
use core::ptr::NonNull;
use luna_core::current::{Inheritor, Priority};

/// What lies in a call's node, and what is received.
#[derive(Debug)]
pub enum Message<Q, A> {
    /// Until it is taken.
    Request(Q),
    Answer(A),
    /// The server has dropped the call.
    NoAnswer,
}

/// Makes a channel for calls: a request and its reply are one operation of the [`Client`].
/// Allocates the channel; not for the real-time path.
///
/// While a client waits for a server that has accepted here before, and from when its request is
/// taken to the reply, the server *inherits* the client's priority, if that is higher than its own:
/// what is between them does not delay the client (see [`Server`]).
///
/// ```
/// # use futures_lite::future::{block_on, zip};
/// let (client, server) = luna_channels::call_channel::<u32, String>();
/// let serve = async {
///     let call = server.accept().await?;
///     let answer = format!("{} apples", *call);
///     call.reply(answer).expect("the client waits");
///     Ok::<(), luna_channels::RecvError>(())
/// };
/// let (answer, served) = block_on(zip(client.call(3), serve));
/// assert_eq!(answer.unwrap(), "3 apples");
/// served.unwrap();
/// ```
#[track_caller]
pub fn call_channel<Q: Send, A: Send>() -> (Client<Q, A>, Server<Q, A>) {
    let (sender, receiver) = crate::ends(Buffer::RENDEZVOUS);
    (Client::new(sender), Server::new(receiver))
}

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

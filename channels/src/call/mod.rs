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
mod error;
mod server;
mod serving;

pub use accepted::{Call, Reply};
pub use client::{CallOp, Client};
pub use error::CallError;
pub use server::{AcceptOp, Server};
pub(crate) use serving::boost_to_receiver;

use crate::buffer::Buffer;

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

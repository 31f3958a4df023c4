//! Channels: their ends, operations and errors; call channels.
//!
//! [`channel()`] makes a rendezvous, [`buffered`] a channel with a [`Buffer`], and [`call_channel`]
//! one for requests with replies. The ends and the errors of send and receive are at the crate's
//! root too; here are also the futures that the operations return.
//!
//! ```
//! use luna::channel::{Client, Server, call_channel};
//! use luna::prelude::*;
//!
//! async fn serve(server: Server<u32, String>) -> luna::Result<()> {
//!     while let Ok(call) = server.accept().await {
//!         let answer = format!("{} apples", *call);
//!         call.reply(answer).ok();
//!     }
//!     Ok(())
//! }
//!
//! async fn ask(client: Client<u32, String>) -> luna::Result<String> {
//!     Ok(client.call(3).await?)
//! }
//!
//! let (client, server) = call_channel();
//! let (_, answer) = luna::run(async { par!(serve(server), ask(client)).await })?;
//! assert_eq!(answer, "3 apples");
//! # Ok::<(), luna::Error>(())
//! ```

pub use luna_channels::{AcceptOp, Call, CallError, CallOp, Client, Reply, Server, call_channel};
pub use luna_channels::{
    Buffer, BufferError, ChannelEnd, Ended, Extended, Held, Incoming, Operation, Receiver,
    RecvError, RecvOp, RecvTimeout, RecvTimeoutError, SendError, SendOp, SendTimeout,
    SendTimeoutError, Sender, Timed, TryRecvError, TrySendError, buffered, channel, try_buffered,
};

//! Channels between programs on different computers, over zenoh.
//!
//! A channel has a name, one program that sends and one that receives. Each program opens its side
//! on a [`Network`] and gets LUNA's ordinary [`Sender`](luna::Sender) or
//! [`Receiver`](luna::Receiver), and a *link*: a process that carries the values. The send goes on
//! when a process of the other program has taken the value; if that process receives by
//! [`recv_extended`](luna::Receiver::recv_extended), when it is done with the value. With a
//! [buffer](Endpoint::buffered_sender) it is a stream, and each value can say
//! [how old](Endpoint::stamped_receiver) it is. Values are types of serde.
//!
//! ```
//! use luna::prelude::*;
//! use luna_net::{Config, Network};
//!
//! # let port = std::net::TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).unwrap().port();
//! # let address = format!("tcp/127.0.0.1:{port}");
//! # let (address, other) = (address.as_str(), address.clone());
//! // On the one computer, with an address such as "tcp/192.168.7.2:7447" of `Config::network()`:
//! let network = Network::open(&Config::loopback().listen(address))?;
//! let (ready, link) = network.sender::<u32>("cell/feeder/ready")?;
//! let mut system = System::new("feeder");
//! let main = system.executor("main").build()?;
//! main.process("link").spawn(link)?;
//! main.process("feeder").spawn(async move {
//!     ready.send(7).await?; // the other program has taken it
//!     Ok(())
//! })?;
//! // On the other one; here a thread plays it.
//! let door = std::thread::spawn(move || -> luna::Result<()> {
//!     let network = Network::open(&Config::loopback().connect(&other))?;
//!     let (ready, link) = network.receiver::<u32>("cell/feeder/ready")?;
//!     let mut system = System::new("door");
//!     let main = system.executor("main").build()?;
//!     main.process("link").spawn(link)?;
//!     main.process("door").spawn(async move {
//!         assert_eq!(ready.recv().await?, 7);
//!         assert!(ready.recv().await.is_err_and(|error| error.is_closed()));
//!         Ok(())
//!     })?;
//!     system.run().map(drop)
//! });
//! system.run()?;
//! door.join().unwrap()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! # Threads
//!
//! A link is a process on an executor, and a thread of its own without priority. The process takes
//! values, encodes them into buffers that were allocated at the opening, and hands them to the
//! thread; it shares no lock with zenoh. The thread makes all calls of zenoh: those may block and
//! allocate. Values that arrive are decoded by zenoh's threads and wait in the link's inbox, which
//! is bounded by the [window](Endpoint::window).
//!
//! A stream goes in batches. What is in its buffer goes together, at once if the thread is idle;
//! what comes while the thread sends goes into the next batch. So no value waits for others, and
//! the hand-over to the thread, the message and the wake of the receiving link are paid for each
//! batch. One acknowledgement is for all values up to a number.
//!
//! # Guards, deadlines
//!
//! As for `luna-ipc`. A receiver is an input guard as any other: the value is acknowledged only if
//! its guard is chosen. A sender is an output guard with one decision, that of its own program: it
//! is chosen when the other program has joined and no other value is under way. A send with a
//! deadline is exact until the link has taken the value; afterwards it returns as sent, without the
//! acknowledgement: [`Status::in_doubt`] counts those.
//!
//! # The protocol
//!
//! Each opening of a side draws a random number. The sender's messages go to the key
//! `luna/NAME/from-sender`, the receiver's to `luna/NAME/from-receiver`, and every message names
//! both openings. A side shows that it lives by a token of zenoh's liveliness,
//! `luna/NAME/alive/ROLE/NUMBER`, and by a beat four times in [`Config::lost_after`].
//!
//! **Joining.** A side without a partner says hello, with the type, the last number and the last
//! session it knows: at the opening, when the other side's token appears, and from time to time. A
//! side that hears a hello binds itself to that opening, and names it in its own hello; a side that
//! is named by the opening it is bound to has joined. The session's number is one more than the
//! larger of both, and its values go on after the larger of both last numbers. A side that is bound
//! ignores all other openings. A second opening of a role is refused as soon as the first one was
//! heard for longer than `lost_after` beside it; so one that takes the place of a killed program is
//! not refused.
//!
//! **Values** have numbers that go on by one. The sender keeps each until it is acknowledged. The
//! receiver takes only the next number, so a value that comes twice, or after a gap, is passed
//! over. Its beats name the last number that has arrived and the last that was taken: the latter is
//! the acknowledgement. It is also sent at once when the inbox is empty, and each quarter of a
//! window. A sender that does not see its values arrive for two beats sends them again. So messages
//! that are lost or doubled on their way lose no value and double none.
//!
//! **The end.** A side that closes or poisons its channel says so until the other says the same. A
//! partner is lost when its token is gone, which zenoh reports as soon as the connection ends, or
//! when nothing was heard of it for `lost_after`. Then the session is over: no value of it comes
//! any more, and the next opening joins the next session. So a send that has returned `Ok` without
//! a deadline was taken once, and a failed one was taken once or not at all.

#![cfg(target_os = "linux")]
#![cfg_attr(not(test), warn(clippy::unwrap_used, clippy::expect_used))]

mod age;
mod batch;
mod carrier;
mod config;
mod dues;
mod endpoint;
mod error;
mod facts;
mod inbox;
mod link;
mod message;
mod network;
mod outbox;
mod peering;
mod receive_link;
mod send_link;
mod side;
mod status;

pub use age::{Age, Stamped};
pub use config::Config;
pub use endpoint::Endpoint;
pub use error::{NetError, Peer, Role, Sign, TypeInfo};
pub use link::Link;
pub use network::Network;
pub use receive_link::{ReceiveLink, StampedLink};
pub use send_link::SendLink;
pub use status::Status;

//! Recordings to another computer.
//!
//! ```text
//!   recorder ── blocks ──> TcpSink ── hello, blocks ──> Receiver ──> a Sink a sender
//!                          (4 MiB)  <── answer, acknowledgements ──
//!   recorder ── blocks ──> UdpSink ── datagrams ──>
//! ```
//!
//! `wire` defines the protocol, `tcp` and `udp` are the sending side, `receive` is the receiving
//! side with `connection` (TCP) and `datagrams` (UDP), `office` its senders. `search` resolves host
//! names.

mod connection;
mod datagrams;
mod office;
mod receive;
mod search;
mod tcp;
mod timed;
mod udp;
mod wire;

pub use receive::{Departure, Handler, Peer, Receiver, Receiving};
pub use tcp::TcpSink;
pub use udp::UdpSink;
pub use wire::PeerError;

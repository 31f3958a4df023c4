//! Recordings to another computer.
//!
//! ```text
//!   recorder ── blocks ──> TcpSink ── hello, blocks ──> Receiver ──> a Sink for each sender
//!                          (4 MiB)  <── answer, acknowledgements ──
//!   recorder ── blocks ──> UdpSink ── datagrams ──>
//! ```
//!
//! `wire` is what both sides say, `tcp` and `udp` the sending side, `receive` the other, with `connection` and `datagrams` for the two ways; `search` finds a host by its name.

mod connection;
mod datagrams;
mod receive;
mod search;
mod tcp;
mod udp;
mod wire;

pub use receive::{Departure, Handler, Peer, Receiver, Receiving};
pub use tcp::TcpSink;
pub use udp::UdpSink;
pub use wire::PeerError;

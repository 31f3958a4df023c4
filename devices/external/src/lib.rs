//! External channels: a device, pipe, socket or terminal that is read and written as a channel.
//!
//! A *link* is a process between a file and a channel: [`input`](input()) reads records and sends
//! them, [`output`](output()) receives values and writes them. The other side is an ordinary
//! [`Receiver`](luna_channels::Receiver) or [`Sender`](luna_channels::Sender), with all that these
//! can. A [`Framing`] defines how records lie in the bytes; [`FromBytes`] and [`ToBytes`] define
//! what they mean, and a [`Frame`] has both for bytes as they are.
//!
//! A program that reads and writes one device makes two links of it, the one with a clone of the
//! file.
//!
//! [`stdin`] makes a link of standard input. [`readable`] and [`writable`] wait for a file without
//! a link.
//!
//! Links to serial ports, buses, joysticks, pins and sockets, through the device
//! manager, are the crate `luna-links`; [`Splitter`] and [`Packer`] are what such
//! a link is made with.

mod device;
mod error;
mod frame;
mod framing;
mod input;
mod output;
mod packer;
mod record;
mod splitter;
mod wire;

pub use error::{LinkError, OsError};
pub use frame::Frame;
pub use framing::{Framing, Prefix};
pub use input::{Input, input, stdin};
pub use luna_core::{FileError, FileReady, prepare_files, readable, writable};
pub use output::{Output, output};
pub use packer::Packer;
pub use record::{BadRecord, Fault, FromBytes, Malformed, ToBytes};
pub use splitter::Splitter;
#[doc(hidden)]
pub use wire::{Wire, WireStop};

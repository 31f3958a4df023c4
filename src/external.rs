//! External channels: a device, pipe, socket or terminal that is read and written as a channel.
//!
//! A *link* is a process between a file and a channel: [`input`](input()) reads records and sends
//! them, [`output`](output()) receives values and writes them. The other side is an ordinary
//! [`Receiver`](crate::Receiver) or [`Sender`](crate::Sender), with all that these can. A
//! [`Framing`] defines how records lie in the bytes; [`FromBytes`] and [`ToBytes`] define what they
//! mean, and a [`Frame`] has both for bytes as they are.
//!
//! A program that reads and writes one device makes two links of it, the one with a clone of the
//! file.
//!
//! [`stdin`] makes a link of standard input. [`readable`] and [`writable`] wait for a file without
//! a link.
//!
//! ```
//! use luna::external::{self, Frame, Framing};
//! use luna::prelude::*;
//! use std::io::Write;
//!
//! let (near, mut far) = std::io::pipe()?;
//! let (sender, lines) = luna::channel::<Frame<80>>();
//! let mut system = System::new("console");
//! let main = system.executor("main").build()?;
//! main.process("console").spawn(external::input(near, sender, Framing::lines(80)))?;
//! main.process("reader").spawn(async move {
//!     assert_eq!(lines.recv().await?.text(), Ok("hello"));
//!     Ok(())
//! })?;
//! far.write_all(b"hello\n")?;
//! drop(far);
//! # if !cfg!(luna_portable) {
//! system.run()?;
//! # }
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! Links to serial ports, buses, joysticks, pins and sockets, through the [device
//! manager](crate::devices), are the crate `luna-links`; [`Splitter`] and [`Packer`] are what such
//! a link is made with.

pub use luna_external::*;

use crate::error::Result;
use crate::process::Process;
use std::future::Future;

impl<T: FromBytes + Send> Process for Input<T> {
    fn pre_run(&mut self) -> Result<()> {
        Ok(self.prepare()?)
    }

    fn run(&mut self) -> impl Future<Output = Result<()>> {
        let carried = self.carry();
        async { Ok(carried.await?) }
    }

    fn post_run(&mut self) {
        self.close();
    }
}

impl<T: ToBytes + Send> Process for Output<T> {
    fn pre_run(&mut self) -> Result<()> {
        Ok(self.prepare()?)
    }

    fn run(&mut self) -> impl Future<Output = Result<()>> {
        let carried = self.carry();
        async { Ok(carried.await?) }
    }

    fn post_run(&mut self) {
        self.close();
    }
}

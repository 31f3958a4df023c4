//! From a channel to a file.

use super::device::Device;
use super::error::LinkError;
use super::framing::Framing;
use super::input::unless_closed;
use super::packer::Packer;
use super::record::ToBytes;
use super::wire::{Wire, WireStop};
use luna_channels::{ChannelEnd, Receiver, RecvError};
use std::future::Future;
use std::os::fd::OwnedFd;
use std::pin::pin;

/// Makes a process that receives values from `receiver`'s channel and writes them to `file` as
/// records.
///
/// Each record is written whole, with as many calls as that takes, before the next value is
/// received: on a rendezvous a sender is at most one record ahead of the file. The process ends
/// when the last sender is gone and all that it sent is written; with
/// `luna::Error::Poisoned` when the channel is poisoned; and with an error when
/// the reading end of the file is closed, writing fails, or a value cannot be written in this
/// framing. Senders then find the channel closed. The file is closed when the process has ended.
///
/// What it does to the file, and what it costs, is as for [`input`](super::input).
///
/// ```
/// use luna::external::{Framing, Frame};
/// use luna::prelude::*;
/// use std::io::Read;
///
/// let (mut far, near) = std::io::pipe()?;
/// let (lines, receiver) = luna::channel();
/// let mut system = System::new("console");
/// let executor = system.executor("main").build()?;
/// executor.process("console").spawn(luna::external::output(receiver, near, Framing::lines(80)))?;
/// executor.process("writer").spawn(async move {
///     lines.send(Frame::<80>::new(b"hello").unwrap()).await?;
///     Ok(())
/// })?;
/// system.run()?;
/// let mut text = String::new();
/// far.read_to_string(&mut text)?;
/// assert_eq!(text, "hello\n");
/// # Ok::<(), luna::Error>(())
/// ```
pub fn output<T: ToBytes + Send>(
    receiver: Receiver<T>,
    file: impl Into<OwnedFd>,
    framing: Framing,
) -> Output<T> {
    Output {
        device: Some(Device(Wire::unprepared(file.into(), false))),
        receiver: Some(receiver.external()),
        framing,
        packer: None,
    }
}

/// A link from a channel to a file, to be spawned: see [`output`].
///
/// As every `luna::Process` it can also be run by hand, once: `link.pre_run()?` and
/// `link.run().await?`.
#[must_use = "a link is a process: spawn it"]
pub struct Output<T> {
    /// Until the end.
    device: Option<Device>,
    receiver: Option<Receiver<T>>,
    framing: Framing,
    /// From `pre_run` on.
    packer: Option<Packer>,
}

/// The three phases of its process.
#[doc(hidden)]
impl<T: ToBytes + Send> Output<T> {
    /// Checks the framing, makes room for a record, and puts the file in non-blocking mode.
    ///
    /// # Errors
    ///
    /// The one that failed.
    pub fn prepare(&mut self) -> Result<(), LinkError> {
        let packer = Packer::new(self.framing)?;
        if let Some(device) = &mut self.device {
            device.0.prepare()?;
        }
        self.packer = Some(packer);
        Ok(())
    }

    /// Carries records until an end.
    pub fn carry(&mut self) -> impl Future<Output = Result<(), WireStop>> {
        // As for an input.
        let _ = luna_core::prepare_files();
        async {
            let receiver = self.receiver.take();
            let (Some(device), Some(packer), Some(receiver)) =
                (&mut self.device, &mut self.packer, receiver)
            else {
                return Err(LinkError::NotPrepared.into());
            };
            unless_closed(pump(device, packer, &receiver).await)
        }
    }

    /// Closes the file.
    pub fn close(&mut self) {
        self.device = None;
    }
}

async fn pump<T: ToBytes + Send>(
    device: &mut Device,
    packer: &mut Packer,
    receiver: &Receiver<T>,
) -> Result<(), WireStop> {
    let mut poisoned = pin!(receiver.poisoned());
    let mut number = 0;
    loop {
        let value = receiver.recv().await.map_err(ended)?;
        number += 1;
        let bytes = packer.pack(&value).map_err(LinkError::Record)?;
        device.write(bytes, number, poisoned.as_mut()).await?;
    }
}

/// Why no value came.
fn ended(error: RecvError) -> WireStop {
    WireStop::Ended(match error {
        RecvError::Poisoned => ChannelEnd::Poisoned,
        RecvError::Closed => ChannelEnd::Closed,
    })
}

luna_platform::debug_fields!(
    impl[T] Output<T>, |output|
    device: output.device,
    framing: output.framing
);

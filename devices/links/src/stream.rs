//! Links to files.

use crate::Counts;
use crate::end::Lose;
use crate::pump::{Kind, OnBad, pump_in, pump_out};
use luna::devices::Device;
use luna::external::{Framing, FromBytes, LinkError, Packer, Splitter, ToBytes, Wire};
use luna::{Process, Receiver, Sender};
use std::future::Future;
use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

/// A device with a file that can be polled, for [`reader`] and [`writer`].
///
/// Implement it for a device of your own: a character device with `poll` support in its driver, a
/// socket.
pub trait Transport: Send + Sync + 'static {
    /// A descriptor to read and write it: a duplicate of the same open file. It is put in
    /// non-blocking mode.
    ///
    /// # Errors
    ///
    /// The system has no more descriptors.
    fn file(&self) -> io::Result<OwnedFd>;

    /// Whether it keeps packets apart, as UDP does: then an empty read is a broken packet, not the
    /// end.
    fn keeps_packets(&self) -> bool {
        false
    }
}

fn kind(transport: &impl Transport) -> Kind {
    match transport.keeps_packets() {
        true => Kind::Packets,
        false => Kind::Stream,
    }
}

/// Creates a process that reads records from a device and sends them to `sender`'s channel.
///
/// Spawn it on an executor or on a thread; it waits for the device without blocking either. It
/// reads ahead at most 4 KiB or one record; further data waits in the kernel until the channel
/// takes the records. So memory is bounded, and a buffer that overwrites keeps values new.
///
/// It ends without an error when the last receiver is gone. The device is [lost](Device::lost) when
/// reading fails, or the other side hangs up. A broken record is [counted](Reader::counts) and,
/// unless [`on_bad`](Reader::on_bad) sets another reaction, ends it with an error.
///
/// Real-time path: from its `run` on; a system call a read, no allocation. Cancel-safe: data that
/// was read and not sent is lost only with the process.
///
/// # Errors
///
/// [`LinkError`]: the framing is invalid, or the system has no more descriptors.
///
/// ```
/// use luna::devices::Sharing;
/// use luna::external::{Frame, Framing};
/// use luna::prelude::*;
/// use luna_links::{Transport, reader};
/// use std::io::{PipeReader, Write};
/// use std::os::fd::OwnedFd;
///
/// struct Sensor(PipeReader);
/// impl Transport for Sensor {
///     fn file(&self) -> std::io::Result<OwnedFd> {
///         Ok(self.0.try_clone()?.into())
///     }
/// }
///
/// let mut system = System::new("machine");
/// let (near, mut far) = std::io::pipe()?;
/// let sensor = system
///     .devices()
///     .open("sensor", "sensor", Sharing::Exclusive, || Ok(Sensor(near)))?;
/// let (sender, lines) = luna::channel::<Frame<80>>();
/// let main = system.executor("main").build()?;
/// main.process("sensor").spawn(reader(&sensor, sender, Framing::lines(80))?)?;
/// main.process("user").spawn(async move {
///     assert_eq!(lines.recv().await?.text(), Ok("12 mm"));
///     Ok(())
/// })?;
/// far.write_all(b"12 mm\n")?;
/// # match system.run() {
/// #     Err(error) if error.to_string().contains("needs Linux") => return Ok(()),
/// #     ran => ran,
/// # }?;
/// # #[cfg(any())]
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn reader<D: Transport, T: FromBytes + Send>(
    device: &Device<D>,
    sender: Sender<T>,
    framing: Framing,
) -> Result<Reader<T>, LinkError> {
    Ok(Reader {
        kind: kind(&**device),
        splitter: Splitter::new(framing)?,
        wire: Some(open(device)?),
        device: Some(Box::new(device.clone())),
        sender: Some(sender.external()),
        on_bad: OnBad::default(),
        counts: Counts::default(),
    })
}

/// Creates a process that receives values from `receiver`'s channel and writes them to a device as
/// records.
///
/// Each record is written completely before the next value is received. It ends without an error
/// when the last sender is gone and all is written. The device is [lost](Device::lost) when writing
/// fails, or nothing could be written for the time of [`patience`](Writer::patience); without that
/// it waits for ever, while the senders wait for it.
///
/// Real-time path and cancellation are as for [`reader`]; a record in progress is cut off when the
/// process is cancelled.
///
/// # Errors
///
/// As for [`reader`].
///
/// ```
/// use luna::devices::Sharing;
/// use luna::external::{Frame, Framing};
/// use luna::prelude::*;
/// use luna_links::{Transport, writer};
/// use std::io::{PipeWriter, Read};
/// use std::os::fd::OwnedFd;
///
/// struct Lamp(PipeWriter);
/// impl Transport for Lamp {
///     fn file(&self) -> std::io::Result<OwnedFd> {
///         Ok(self.0.try_clone()?.into())
///     }
/// }
///
/// let mut system = System::new("machine");
/// let (mut far, near) = std::io::pipe()?;
/// let lamp = system.devices().open("lamp", "lamp", Sharing::Exclusive, || Ok(Lamp(near)))?;
/// let (commands, receiver) = luna::channel::<Frame<8>>();
/// let main = system.executor("main").build()?;
/// main.process("lamp").spawn(writer(&lamp, receiver, Framing::lines(8))?)?;
/// main.process("user").spawn(async move {
///     commands.send(Frame::new(b"on").unwrap()).await?;
///     Ok(())
/// })?;
/// drop(lamp);
/// system.run()?;
/// let mut text = String::new();
/// far.read_to_string(&mut text)?; // to its end: the device is closed
/// assert_eq!(text, "on\n");
/// # Ok::<(), luna::Error>(())
/// ```
pub fn writer<D: Transport, T: ToBytes + Send>(
    device: &Device<D>,
    receiver: Receiver<T>,
    framing: Framing,
) -> Result<Writer<T>, LinkError> {
    Ok(Writer {
        kind: kind(&**device),
        packer: Packer::new(framing)?,
        wire: Some(open(device)?),
        device: Some(Box::new(device.clone())),
        receiver: Some(receiver.external()),
        patience: None,
        counts: Counts::default(),
    })
}

fn open<D: Transport>(device: &Device<D>) -> Result<Wire, LinkError> {
    Wire::new(
        device
            .file()
            .map_err(|error| LinkError::SetUp(error.into()))?,
    )
}

/// A link from a device to a channel, to be spawned: see [`reader`].
#[must_use = "a link is a process: spawn it"]
pub struct Reader<T> {
    kind: Kind,
    splitter: Splitter,
    /// Before the device, which is closed after it.
    wire: Option<Wire>,
    device: Option<Box<dyn Lose>>,
    sender: Option<Sender<T>>,
    on_bad: OnBad,
    counts: Counts,
}

impl<T> Reader<T> {
    /// What becomes of broken records; without this they end the link.
    pub fn on_bad(mut self, policy: OnBad) -> Self {
        self.on_bad = policy;
        self
    }

    /// What it counts.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

impl<T: FromBytes + Send> Process for Reader<T> {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // Here, off the real-time path. If it fails, the first wait fails too, and reports it.
        let _ = luna::external::prepare_files();
        async {
            // The channel ends with the body, without waiting for the clean-up.
            let sender = self.sender.take();
            let (Some(wire), Some(device), Some(sender)) = (&mut self.wire, &self.device, sender)
            else {
                return Err(LinkError::NotPrepared.into());
            };
            let Self {
                splitter,
                kind,
                on_bad,
                counts,
                ..
            } = self;
            let Err(stop) = pump_in(wire, splitter, &sender, *kind, *on_bad, counts).await;
            stop.end(&**device)
        }
    }

    /// Lets go of the device.
    fn post_run(&mut self) {
        self.wire = None;
        self.device = None;
    }
}

luna_platform::debug_fields!(
    impl[T] Reader<T>, |reader|
    wire: reader.wire,
    on_bad: reader.on_bad,
    counts: reader.counts
);

/// A link from a channel to a device, to be spawned: see [`writer`].
#[must_use = "a link is a process: spawn it"]
pub struct Writer<T> {
    kind: Kind,
    packer: Packer,
    /// Before the device, which is closed after it.
    wire: Option<Wire>,
    device: Option<Box<dyn Lose>>,
    receiver: Option<Receiver<T>>,
    patience: Option<Duration>,
    counts: Counts,
}

impl<T> Writer<T> {
    /// For how long nothing may get out before the device counts as lost.
    pub fn patience(mut self, patience: Duration) -> Self {
        self.patience = Some(patience);
        self
    }

    /// What it counts.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

impl<T: ToBytes + Send> Process for Writer<T> {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // As for a reader.
        let _ = luna::external::prepare_files();
        async {
            let receiver = self.receiver.take();
            let (Some(wire), Some(device), Some(receiver)) =
                (&mut self.wire, &self.device, receiver)
            else {
                return Err(LinkError::NotPrepared.into());
            };
            let Self {
                packer,
                kind,
                patience,
                counts,
                ..
            } = self;
            let mut is_unsent = false;
            let Err(stop) = pump_out(
                wire,
                packer,
                &mut is_unsent,
                &receiver,
                *kind,
                *patience,
                counts,
            )
            .await;
            stop.end(&**device)
        }
    }

    /// Lets go of the device.
    fn post_run(&mut self) {
        self.wire = None;
        self.device = None;
    }
}

luna_platform::debug_fields!(
    impl[T] Writer<T>, |writer|
    wire: writer.wire,
    patience: writer.patience,
    counts: writer.counts
);

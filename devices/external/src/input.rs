//! From a file to a channel.

use super::device::Device;
use super::error::LinkError;
use super::framing::Framing;
use super::record::{Fault, FromBytes};
use super::splitter::Splitter;
use super::wire::{Wire, WireStop};
use luna_channels::{ChannelEnd, SendError, Sender};
use std::future::Future;
use std::os::fd::{AsFd, OwnedFd};
use std::pin::pin;

/// Makes a process that reads records from `file` and sends them to `sender`'s channel.
///
/// Spawn it where it is to run, on an executor or as an OS-thread process; the receivers may run
/// elsewhere. It reads ahead at most 4 KiB or one record; what it has read waits in the link until
/// the channel takes it. The end of the file, or a terminal that has hung up, ends the process, and
/// with its sender the channel. So does a broken record (a line too long, a record that the end of
/// the file cuts off, bytes that do not decode), with an error: unless the channel carries
/// `Result<T, BadRecord>`, which then gets that in its place. It also ends, without an error, when
/// the last receiver is gone; and with `luna::Error::Poisoned` when the channel
/// is poisoned. The file is closed when the process has ended.
///
/// The file is put in non-blocking mode, for good and for all duplicates of its descriptor: give a
/// terminal that a shell uses too as one opened anew (`/dev/tty`), and standard input by [`stdin`].
/// One on a disk can be read, but the system holds up the whole thread for it. Nothing is allocated
/// after `pre_run`.
///
/// ```
/// use luna::external::{Framing, Frame};
/// use luna::prelude::*;
/// use std::io::Write;
///
/// let (near, mut far) = std::io::pipe()?;
/// let (sender, lines) = luna::channel::<Frame<80>>();
/// let mut system = System::new("console");
/// let executor = system.executor("main").build()?;
/// executor.process("console").spawn(luna::external::input(near, sender, Framing::lines(80)))?;
/// executor.process("reader").spawn(async move {
///     assert_eq!(lines.recv().await?.text(), Ok("hello"));
///     assert!(lines.recv().await.is_err_and(|error| error.is_closed()));
///     Ok(())
/// })?;
/// far.write_all(b"hello\n")?;
/// drop(far);
/// # match system.run() {
/// #     Err(luna::Error::Process { source, .. }) if matches!(&*source, luna::Error::External(luna::external::LinkError::Wait(e)) if e.is_unsupported()) => return Ok(()),
/// #     ran => ran,
/// # }?;
/// # #[cfg(any())]
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn input<T: FromBytes + Send>(
    file: impl Into<OwnedFd>,
    sender: Sender<T>,
    framing: Framing,
) -> Input<T> {
    Input::of(Wire::unprepared(file.into(), false), sender, framing)
}

/// Makes a process that reads records from standard input, as [`input`] does from another file. The
/// end of standard input ends it, and so does the end of its last receiver: a run that ends does
/// not wait for another line.
///
/// The mode of standard input stays as it is, since the shell and other programs have the same open
/// file. It is asked before each read whether there is anything. If another program takes that
/// first, the read waits, and with it all processes of the thread: spawn it as an OS-thread
/// process. What [`std::io::stdin`] has taken into its buffer is not seen here, so read it in one
/// of both ways.
///
/// # Errors
///
/// [`LinkError::Read`]: the program has no standard input, or no descriptors left.
///
/// ```no_run
/// use luna::external::{self, Frame, Framing};
/// use luna::prelude::*;
///
/// let mut system = System::new("console");
/// let (sender, lines) = luna::channel::<Frame<80>>();
/// let console = system.thread("console").process("standard input");
/// console.spawn(external::stdin(sender, Framing::lines(80).or_end_of_file())?)?;
/// let main = system.executor("main").build()?;
/// main.process("operator").spawn(async move {
///     while let Ok(line) = lines.recv().await {
///         match line.text() {
///             Ok("quit") => break,
///             text => println!("unknown: {text:?}"),
///         }
///     }
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn stdin<T: FromBytes + Send>(
    sender: Sender<T>,
    framing: Framing,
) -> Result<Input<T>, LinkError> {
    let file = std::io::stdin().as_fd().try_clone_to_owned();
    let file = file.map_err(|error| LinkError::Read(error.into()))?;
    Ok(Input::of(Wire::unprepared(file, true), sender, framing))
}

/// A link from a file to a channel, to be spawned: see [`input`] and [`stdin`].
///
/// As every `luna::Process` it can also be run by hand, once: `link.pre_run()?` and
/// `link.run().await?`.
#[must_use = "a link is a process: spawn it"]
pub struct Input<T> {
    /// Until the end.
    device: Option<Device>,
    sender: Option<Sender<T>>,
    framing: Framing,
    /// From `pre_run` on.
    splitter: Option<Splitter>,
}

impl<T> Input<T> {
    fn of(wire: Wire, sender: Sender<T>, framing: Framing) -> Self {
        Self {
            device: Some(Device(wire)),
            sender: Some(sender.external()),
            framing,
            splitter: None,
        }
    }
}

/// The three phases of its process.
#[doc(hidden)]
impl<T: FromBytes + Send> Input<T> {
    /// Checks the framing, makes room for records, and puts the file in non-blocking mode, unless
    /// it is standard input.
    ///
    /// # Errors
    ///
    /// The one that failed.
    pub fn prepare(&mut self) -> Result<(), LinkError> {
        let splitter = Splitter::new(self.framing)?;
        if let Some(device) = &mut self.device {
            device.0.prepare()?;
        }
        self.splitter = Some(splitter);
        Ok(())
    }

    /// Carries records until an end.
    pub fn carry(&mut self) -> impl Future<Output = Result<(), WireStop>> {
        // Prepared when the body is made: off the real-time path, on its thread. If it fails, the
        // first wait fails too and reports it; a file that is never waited for does not need it.
        let _ = luna_core::prepare_files();
        async {
            // The channel ends with the body, without waiting for the clean-up.
            let sender = self.sender.take();
            let (Some(device), Some(splitter), Some(sender)) =
                (&mut self.device, &mut self.splitter, sender)
            else {
                return Err(LinkError::NotPrepared.into());
            };
            unless_closed(pump(device, splitter, &sender).await)
        }
    }

    /// Closes the file.
    pub fn close(&mut self) {
        self.device = None;
    }
}

/// A link ends well when no other end of its channel is left.
pub(super) fn unless_closed(pumped: Result<(), WireStop>) -> Result<(), WireStop> {
    match pumped {
        Err(WireStop::Ended(ChannelEnd::Closed)) => Ok(()),
        pumped => pumped,
    }
}

async fn pump<T: FromBytes + Send>(
    device: &mut Device,
    splitter: &mut Splitter,
    sender: &Sender<T>,
) -> Result<(), WireStop> {
    let mut ended = pin!(sender.ended());
    let mut is_at_end = false;
    loop {
        let record = if is_at_end {
            splitter.finish()
        } else {
            splitter.next_record()
        };
        let decoded = match record {
            Some(Ok(bytes)) => T::from_bytes(bytes).map_err(Fault::Malformed),
            Some(Err(bad)) => Err(bad.fault),
            None if is_at_end => return Ok(()),
            None => {
                match device.read(splitter.room(), ended.as_mut()).await? {
                    0 => is_at_end = true,
                    count => splitter.filled(count),
                }
                continue;
            }
        };
        let value = match decoded {
            Ok(value) => value,
            Err(fault) => T::from_bad(splitter.bad(fault)).map_err(LinkError::Record)?,
        };
        sender.send(value).await.map_err(refused)?;
    }
}

/// Why a value was not sent.
fn refused<T>(error: SendError<T>) -> WireStop {
    WireStop::Ended(match error.poisoned {
        true => ChannelEnd::Poisoned,
        false => ChannelEnd::Closed,
    })
}

luna_platform::debug_fields!(
    impl[T] Input<T>, |input|
    device: input.device,
    framing: input.framing
);

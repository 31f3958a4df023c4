//! From a channel to outputs.

use super::{Levels, Pins};
use crate::Counts;
use luna::devices::Device;
use luna::external::LinkError;
use luna::{Process, Receiver};
use luna_core::path::{self, Call};
use std::io;

/// Creates a process that sets outputs to the values from `receiver`'s channel, each at once.
///
/// It ends without an error when the last sender is gone; the outputs then keep their levels until
/// the device is closed, which sets them to the safe ones. If setting them fails the device is
/// [lost](Device::lost). A level for a line that is not an output ends the process with an error.
///
/// Real-time path: one system call a value, which does not block on a chip of the processor's own;
/// no allocation. Cancel-safe.
///
/// ```
/// use luna::devices::DeviceError;
/// use luna::prelude::*;
/// use luna_links::gpio::{self, Chip, Levels, Lines};
/// use std::os::fd::OwnedFd;
/// use std::sync::{Arc, Mutex};
///
/// /// A simulated chip.
/// struct Simulated(Arc<Mutex<Vec<Levels>>>);
/// impl Chip for Simulated {
///     fn set(&self, levels: Levels) -> std::io::Result<()> {
///         self.0.lock().unwrap().push(levels);
///         Ok(())
///     }
///     fn get(&self, _: usize) -> std::io::Result<bool> { Ok(false) }
///     fn edges(&self) -> std::io::Result<OwnedFd> { Ok(std::io::pipe()?.0.into()) }
/// }
///
/// let mut system = System::new("press");
/// let set = Arc::new(Mutex::new(Vec::new()));
/// let chip = Simulated(set.clone());
/// let pins = gpio::open_chip(
///     &system.devices(),
///     "valves",
///     &Lines::new("press").output(17, false),
///     || Ok(chip),
/// )?;
/// let (levels, receiver) = luna::channel();
/// let main = system.executor("main").build()?;
/// main.process("valves").spawn(gpio::writer(&pins, receiver))?;
/// main.process("control")
///     .spawn(async move { Ok(levels.send(Levels::NONE.with(0, true)).await?) })?;
/// drop(pins);
/// system.run()?;
/// // And the safe level when it was closed.
/// assert_eq!(*set.lock().unwrap(), [Levels::NONE.with(0, true), Levels::NONE.with(0, false)]);
/// # Ok::<(), luna::Error>(())
/// ```
pub fn writer(pins: &Device<Pins>, receiver: Receiver<Levels>) -> Writer {
    Writer {
        pins: Some(pins.clone()),
        receiver: Some(receiver.external()),
        counts: Counts::default(),
    }
}

/// A link from a channel to outputs, to be spawned: see [`writer`].
#[derive(Debug)]
#[must_use = "a link is a process: spawn it"]
pub struct Writer {
    pins: Option<Device<Pins>>,
    receiver: Option<Receiver<Levels>>,
    counts: Counts,
}

impl Writer {
    /// What it counts.
    pub fn counts(&self) -> Counts {
        self.counts.clone()
    }
}

impl Process for Writer {
    async fn run(&mut self) -> luna::Result<()> {
        let (Some(pins), Some(receiver)) = (&self.pins, self.receiver.take()) else {
            return Err(LinkError::NotPrepared.into());
        };
        loop {
            let levels = match receiver.recv().await {
                Ok(levels) => levels,
                Err(error) if error.is_closed() => return Ok(()),
                Err(error) => return Err(error.into()),
            };
            match path::expected(Call::File, || pins.set(levels)) {
                Ok(()) => self.counts.record(),
                // Wrong levels, or an emergency: the chip itself works.
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::InvalidInput | io::ErrorKind::PermissionDenied
                    ) =>
                {
                    return Err(luna::Error::other(error));
                }
                Err(error) => {
                    return Err(pins.lost(LinkError::Write {
                        record: self.counts.records() + 1,
                        written: 0,
                        error: error.into(),
                    }));
                }
            }
        }
    }

    /// Lets go of the device.
    fn post_run(&mut self) {
        self.pins = None;
    }
}

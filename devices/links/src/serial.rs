//! Serial ports: UARTs, USB adapters, pseudo-terminals.
//!
//! [`open`] opens and configures one; [`reader`](crate::reader) and [`writer`](crate::writer) are
//! the links to it.
//!
//! ```no_run
//! use luna::external::{Frame, Framing};
//! use luna::prelude::*;
//! use luna_links::serial::{self, Settings};
//! use luna_links::{OnBad, reader, writer};
//!
//! let mut system = System::new("motors");
//! let port = serial::open(&system.devices(), "/dev/ttyUSB0", &Settings::new(115_200))?;
//! port.on_emergency("stop", |port| drop(port.write_at_once(b"STOP\n")))?;
//! let (answers, replies) = luna::channel::<Frame<32>>();
//! let (commands, orders) = luna::channel::<Frame<32>>();
//! let main = system.executor("main").build()?;
//! main.process("from motors")
//!     .spawn(reader(&port, answers, Framing::lines(32))?.on_bad(OnBad::Drop))?;
//! main.process("to motors").spawn(writer(&port, orders, Framing::lines(32))?)?;
//! # drop((replies, commands, port));
//! // and the processes that use them
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

use crate::Transport;
use luna::devices::{Device, DeviceError, DeviceManager, Node, Sharing};
use luna_machine::file;
pub use serial2::{CharSize, FlowControl, Parity, StopBits};
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::path::Path;

/// No subsystem is compared: a pseudo-terminal has none. The configuration fails for a device that
/// is not a terminal.
const NODE: Node = Node::new("serial port").group("dialout");

/// Settings of a serial port: raw (the system changes no byte), with 8 bits, no parity, one stop
/// bit and no flow control by default.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    baud: u32,
    char_size: CharSize,
    parity: Parity,
    stop_bits: StopBits,
    flow_control: FlowControl,
}

impl Settings {
    /// At `baud` bits a second.
    ///
    /// ```
    /// use luna_links::serial::{Parity, Settings};
    /// let settings = Settings::new(19_200).parity(Parity::Even);
    /// # let _ = settings;
    /// ```
    pub fn new(baud: u32) -> Self {
        Self {
            baud,
            char_size: CharSize::Bits8,
            parity: Parity::None,
            stop_bits: StopBits::One,
            flow_control: FlowControl::None,
        }
    }

    /// The number of bits a character.
    #[must_use]
    pub fn char_size(mut self, char_size: CharSize) -> Self {
        self.char_size = char_size;
        self
    }

    /// This parity.
    #[must_use]
    pub fn parity(mut self, parity: Parity) -> Self {
        self.parity = parity;
        self
    }

    /// The number of stop bits.
    #[must_use]
    pub fn stop_bits(mut self, stop_bits: StopBits) -> Self {
        self.stop_bits = stop_bits;
        self
    }

    /// Sets the flow control. With it, a peer that does not read blocks the writer: give that a
    /// [patience](crate::Writer::patience).
    #[must_use]
    pub fn flow_control(mut self, flow_control: FlowControl) -> Self {
        self.flow_control = flow_control;
        self
    }

    fn apply(&self, mut to: serial2::Settings) -> io::Result<serial2::Settings> {
        to.set_raw();
        to.set_baud_rate(self.baud)?;
        to.set_char_size(self.char_size);
        to.set_parity(self.parity);
        to.set_stop_bits(self.stop_bits);
        to.set_flow_control(self.flow_control);
        Ok(to)
    }
}

/// An open serial port: see [`open`].
#[derive(Debug)]
pub struct SerialPort {
    port: serial2::SerialPort,
    /// The same, for calls that do not wait.
    file: File,
}

/// Opens the serial port at `path` and configures it. No other program may open it meanwhile
/// (`TIOCEXCL`, except for privileged ones, and `flock` for those that check it). Opening does not
/// wait for a carrier.
///
/// # Errors
///
/// A [`DeviceError`]: missing, busy, no permission, no terminal; settings that the port does not
/// support are [`DeviceError::Settings`].
///
/// ```
/// use luna::devices::DeviceError;
/// use luna_links::serial::{self, Settings};
///
/// let system = luna::System::new("machine");
/// let opened = serial::open(&system.devices(), "/dev/null", &Settings::new(9600));
/// assert!(matches!(opened, Err(DeviceError::WrongKind { expected: "serial port", .. })));
/// ```
pub fn open(
    devices: &DeviceManager,
    path: &str,
    settings: &Settings,
) -> Result<Device<SerialPort>, DeviceError> {
    devices.open(path, NODE.kind(), Sharing::Exclusive, || {
        let file = Path::new(path);
        NODE.check(file)?;
        let refused = |error: io::Error| match error.kind() {
            io::ErrorKind::InvalidInput | io::ErrorKind::Other
                if error.raw_os_error().is_none() =>
            {
                DeviceError::Settings {
                    device: path.to_owned(),
                    reason: error.to_string(),
                }
            }
            _ => NODE.explain(file, error),
        };
        let port = serial2::SerialPort::open(file, |now| settings.apply(now)).map_err(refused)?;
        let own = File::from(port.as_fd().try_clone_to_owned().map_err(refused)?);
        NODE.lock(file, &own)?;
        // SAFETY: the call takes no argument but the descriptor, which is open.
        unsafe { claim(own.as_raw_fd()) }.map_err(|error| refused(error.into()))?;
        Ok(SerialPort { port, file: own })
    })
}

nix::ioctl_none_bad!(
    /// Prevents other opens of the terminal.
    claim,
    nix::libc::TIOCEXCL
);

impl SerialPort {
    /// Drops what was written and not sent yet, and then writes as much of `bytes` as there is room
    /// for, without blocking: for an emergency. Returns how many bytes that were.
    ///
    /// This cuts off the record that a link is writing; so `bytes` should begin with the end of a
    /// record.
    ///
    /// # Errors
    ///
    /// The system's error; `WouldBlock` if there is no room at all.
    pub fn write_at_once(&self, bytes: &[u8]) -> io::Result<usize> {
        // What cannot be dropped must not keep the rest from being tried.
        let _ = self.port.discard_output_buffer();
        file::write(&self.file, bytes)
    }

    /// Sets the line RTS, at once: some adapters switch an output by it.
    ///
    /// # Errors
    ///
    /// The port has no such line.
    pub fn set_rts(&self, active: bool) -> io::Result<()> {
        self.port.set_rts(active)
    }

    /// Sets the line DTR, at once.
    ///
    /// # Errors
    ///
    /// The port has no such line.
    pub fn set_dtr(&self, active: bool) -> io::Result<()> {
        self.port.set_dtr(active)
    }
}

impl Drop for SerialPort {
    fn drop(&mut self) {
        // The flag belongs to the terminal: with an inherited descriptor it would outlive this one.
        // SAFETY: the call takes no argument but the descriptor, which is open as long as `file`
        // is.
        let _ = unsafe { release(self.file.as_raw_fd()) };
    }
}

nix::ioctl_none_bad!(
    /// Lets others open the terminal again.
    release,
    nix::libc::TIOCNXCL
);

impl Transport for SerialPort {
    fn file(&self) -> io::Result<OwnedFd> {
        self.port.as_fd().try_clone_to_owned()
    }
}

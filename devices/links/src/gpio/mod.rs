//! Pins (GPIO), through the kernel's character devices.
//!
//! [`open`] requests some lines of a chip, with a safe level for each output. [`writer`] sets
//! outputs to values from a channel; the edges of inputs come over a channel by
//! [`reader`](crate::reader), with [`FRAMING`] and [`Edge`]; [`Pin`] is one line by the traits of
//! `embedded-hal`, for other drivers. In an emergency all outputs go to their safe levels, and stay
//! there.
//!
//! Setting a pin of the processor's own chip takes a system call that does not block. Chips behind
//! a bus (an I2C expander) block for their bus: spawn their [`writer`] on a thread of its own.
//!
//! ```no_run
//! use luna::prelude::*;
//! use luna_links::gpio::{self, Edge, Lines};
//!
//! let mut system = System::new("press");
//! let lines = Lines::new("press").output(17, false).output(27, false).input(22);
//! let pins = gpio::open(&system.devices(), "/dev/gpiochip0", &lines)?;
//! let (edges, pressed) = luna::buffered::<Edge>(Buffer::overwrite_oldest(16));
//! let (levels, valves) = luna::channel();
//! let main = system.executor("main").build()?;
//! main.process("buttons").spawn(luna_links::reader(&pins, edges, gpio::FRAMING)?)?;
//! main.process("valves").spawn(gpio::writer(&pins, valves))?;
//! main.process("control").spawn(async move {
//!     while let Ok(edge) = pressed.recv().await {
//!         levels.send(gpio::Levels::NONE.with(0, edge.rising)).await?; // the first of the lines
//!     }
//!     Ok(())
//! })?;
//! # drop(pins);
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

mod chip;
mod edge;
mod pin;
mod writer;

pub use edge::{Edge, FRAMING};
pub use pin::{Pin, PinError};
pub use writer::{Writer, writer};

use crate::Transport;
use luna::devices::{Device, DeviceError, DeviceManager, Node, Sharing};
use luna_platform::lock::PiLock;
use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;

pub(crate) const NODE: Node = Node::new("GPIO chip").subsystem("gpio").group("gpio");

/// The most lines of one request, as of the kernel's.
pub const MAX_LINES: usize = 64;

/// The lines of a chip to request, by their offsets on it. Afterwards they are numbered from 0 in
/// this order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lines {
    pub(crate) consumer: String,
    pub(crate) lines: Vec<Line>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Line {
    pub(crate) offset: u32,
    pub(crate) use_: Use,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Use {
    Input,
    /// With the level that is safe.
    Output(bool),
}

impl Lines {
    /// None yet, for a user that the kernel's tools name so.
    ///
    /// ```
    /// let lines = luna_links::gpio::Lines::new("press").output(17, false).input(22);
    /// # let _ = lines;
    /// ```
    pub fn new(consumer: &str) -> Self {
        Self {
            consumer: consumer.to_owned(),
            lines: Vec::new(),
        }
    }

    /// Adds an output at the level `safe`, which it has from the opening on and in an emergency;
    /// true is high.
    #[must_use]
    pub fn output(mut self, offset: u32, safe: bool) -> Self {
        self.lines.push(Line {
            offset,
            use_: Use::Output(safe),
        });
        self
    }

    /// Adds an input; both of its edges are reported.
    #[must_use]
    pub fn input(mut self, offset: u32) -> Self {
        self.lines.push(Line {
            offset,
            use_: Use::Input,
        });
        self
    }

    /// The outputs, with the levels that are safe.
    pub(crate) fn safe(&self) -> Levels {
        let mut levels = Levels::NONE;
        for (number, line) in self.lines.iter().enumerate() {
            if let Use::Output(level) = line.use_ {
                levels = levels.with(number, level);
            }
        }
        levels
    }
}

/// Levels for some of the lines: of one value, all change together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Levels {
    mask: u64,
    bits: u64,
}

impl Levels {
    /// Of no line.
    pub const NONE: Levels = Levels { mask: 0, bits: 0 };

    /// And this line, by its number from 0.
    ///
    /// # Panics
    ///
    /// The number is 64 or more.
    ///
    /// ```
    /// use luna_links::gpio::Levels;
    /// let levels = Levels::NONE.with(3, true).with(4, false);
    /// assert_eq!((levels.get(3), levels.get(4), levels.get(5)), (Some(true), Some(false), None));
    /// ```
    #[must_use]
    pub const fn with(mut self, number: usize, level: bool) -> Self {
        assert!(number < MAX_LINES);
        self.mask |= 1 << number;
        if level {
            self.bits |= 1 << number;
        } else {
            self.bits &= !(1 << number);
        }
        self
    }

    /// The level of this line, if there is one for it.
    pub const fn get(self, number: usize) -> Option<bool> {
        if number < MAX_LINES && self.mask >> number & 1 == 1 {
            Some(self.bits >> number & 1 == 1)
        } else {
            None
        }
    }
}

/// What lines of a chip can do: the kernel's, or a simulated chip's.
pub trait Chip: Send + Sync + 'static {
    /// Sets outputs, by their numbers. `levels` contains only outputs.
    ///
    /// # Errors
    ///
    /// The system's error.
    fn set(&self, levels: Levels) -> io::Result<()>;

    /// The level of the line of this number.
    ///
    /// # Errors
    ///
    /// The system's error.
    fn get(&self, number: usize) -> io::Result<bool>;

    /// The descriptor for edges, in the kernel's format.
    ///
    /// # Errors
    ///
    /// The system's error.
    fn edges(&self) -> io::Result<OwnedFd>;
}

/// Lines that are open: see [`open`].
pub struct Pins {
    lines: Lines,
    outputs: PiLock<Outputs>,
    chip: Box<dyn Chip>,
}

/// What guards the outputs.
struct Outputs {
    /// An emergency has set them: they do not change any more.
    are_safe: bool,
}

/// Opens lines of the chip at `path`, such as `/dev/gpiochip0`: one device of this chip and these
/// lines. Registers an emergency function that sets outputs to their safe levels; if the system
/// refuses to set them, the report marks it as [panicked](luna::report::FunctionOutcome::Panicked).
///
/// # Errors
///
/// A [`DeviceError`]: missing, no permission, no GPIO chip; busy, with the kernel's name for the
/// holder of a line; invalid lines. And those of [`Device::on_emergency`].
///
/// ```
/// use luna::devices::DeviceError;
/// use luna_links::gpio::{self, Lines};
///
/// let system = luna::System::new("machine");
/// let opened = gpio::open(&system.devices(), "/dev/null", &Lines::new("press").output(17, false));
/// let Err(luna::Error::Device(error)) = opened else { panic!("it is opened") };
/// assert!(matches!(*error, DeviceError::WrongKind { expected: "GPIO chip", .. }));
/// ```
pub fn open(devices: &DeviceManager, path: &str, lines: &Lines) -> luna::Result<Device<Pins>> {
    let offsets: Vec<String> = lines.lines.iter().map(|l| l.offset.to_string()).collect();
    let name = format!("{path}:{}", offsets.join(","));
    open_chip(devices, &name, lines, || {
        NODE.check(Path::new(path))?;
        chip::request(path, &name, lines)
    })
}

/// As [`open`], with a chip of your own, such as a simulated one.
///
/// # Errors
///
/// A [`DeviceError`]: invalid lines, busy, or the error of `chip`.
pub fn open_chip<C: Chip>(
    devices: &DeviceManager,
    name: &str,
    lines: &Lines,
    chip: impl FnOnce() -> Result<C, DeviceError>,
) -> luna::Result<Device<Pins>> {
    let refused = |reason: &str| {
        Err(luna::Error::from(DeviceError::Settings {
            device: name.to_owned(),
            reason: reason.to_owned(),
        }))
    };
    if lines.lines.is_empty() || lines.lines.len() > MAX_LINES {
        return refused("request 1 to 64 lines");
    }
    let mut offsets: Vec<u32> = lines.lines.iter().map(|line| line.offset).collect();
    offsets.sort_unstable();
    if offsets.windows(2).any(|pair| pair[0] == pair[1]) {
        return refused("a line is requested twice");
    }
    let pins = devices.open(name, NODE.kind(), Sharing::Exclusive, || {
        let chip = chip()?;
        Ok(Pins {
            lines: lines.clone(),
            outputs: PiLock::new(Outputs { are_safe: false }),
            chip: Box::new(chip),
        })
    })?;
    if lines.safe() != Levels::NONE {
        pins.on_emergency("outputs to their safe levels", Pins::make_safe)?;
    }
    Ok(pins)
}

impl Pins {
    /// Sets outputs, at once. After an emergency it fails without effect.
    ///
    /// # Errors
    ///
    /// A line is not an output; there was an emergency; the system's error.
    pub fn set(&self, levels: Levels) -> io::Result<()> {
        if levels.mask & !self.lines.safe().mask != 0 {
            let text = "a level is for a line that is no output";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
        }
        let outputs = self.outputs.lock();
        if outputs.are_safe {
            let text = "an emergency has set the outputs to their safe levels";
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, text));
        }
        self.chip.set(levels)
    }

    /// The level of the line of this number, at once.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn get(&self, number: usize) -> io::Result<bool> {
        self.chip.get(number)
    }

    /// How many lines there are.
    pub fn count(&self) -> usize {
        self.lines.lines.len()
    }

    /// Panics if the system fails: the report of the emergency functions then shows it, and a
    /// guardian acts.
    fn make_safe(&self) {
        let mut outputs = self.outputs.lock();
        outputs.are_safe = true;
        let set = self.chip.set(self.lines.safe());
        drop(outputs);
        if let Err(error) = set {
            panic!(
                "the outputs of `{}` cannot be set: {error}",
                self.lines.consumer
            );
        }
    }
}

impl Transport for Pins {
    fn file(&self) -> io::Result<OwnedFd> {
        self.chip.edges()
    }
}

impl Drop for Pins {
    /// Outputs stay at their safe levels until the lines are released; then the kernel's driver
    /// determines the levels.
    fn drop(&mut self) {
        if self.lines.safe() != Levels::NONE {
            let _ = self.chip.set(self.lines.safe());
        }
    }
}

luna_platform::debug_fields!(Pins, |pins| lines: pins.lines);

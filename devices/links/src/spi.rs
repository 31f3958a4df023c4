//! SPI devices.
//!
//! [`Spi`] is a handle to an open one for a driver, by the trait of `embedded-hal`. Each call
//! blocks in the system until the transfer is over, so it belongs on the thread of a
//! [`driver`](mod@crate::driver).
//!
//! ```no_run
//! use embedded_hal::spi::SpiDevice as _;
//! use luna::prelude::*;
//! use luna_links::driver::driver;
//! use luna_links::spi::{self, Settings, Spi};
//!
//! let mut system = System::new("robot");
//! let device = spi::open(&system.devices(), "/dev/spidev0.0", &Settings::new(1_000_000))?;
//! let (encoder, calls) = luna::channel::call_channel::<(), u16>();
//! let link = driver(&device, Spi::new(&device), calls, |spi, ()| {
//!     let mut angle = [0; 2];
//!     spi.transfer_in_place(&mut angle).map_err(luna::Error::other)?;
//!     Ok(u16::from_be_bytes(angle))
//! });
//! system.executor("links").build()?.process("encoder").spawn(link)?;
//! # drop((encoder, device));
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

use embedded_hal::spi::{ErrorType, MODE_0, Mode, Operation, Phase, Polarity, SpiDevice};
pub use linux_embedded_hal::SPIError;
use linux_embedded_hal::SpidevDevice;
use linux_embedded_hal::spidev::{SpiModeFlags, Spidev, SpidevOptions};
use luna::devices::{Device, DeviceError, DeviceManager, Node, Sharing};
use luna_platform::lock::PiLock;
use std::path::Path;

const NODE: Node = Node::new("SPI device").subsystem("spidev").group("spi");

/// Settings of an SPI device: mode 0 and 8 bits a word by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    max_hertz: u32,
    mode: Mode,
    bits_per_word: u8,
}

impl Settings {
    /// The limit of the clock, in hertz.
    ///
    /// ```
    /// let settings = luna_links::spi::Settings::new(500_000).mode(embedded_hal::spi::MODE_3);
    /// # let _ = settings;
    /// ```
    pub fn new(max_hertz: u32) -> Self {
        Self {
            max_hertz,
            mode: MODE_0,
            bits_per_word: 8,
        }
    }

    /// The clock's polarity and phase.
    #[must_use]
    pub fn mode(mut self, mode: Mode) -> Self {
        self.mode = mode;
        self
    }

    /// The number of bits a word.
    #[must_use]
    pub fn bits_per_word(mut self, bits: u8) -> Self {
        self.bits_per_word = bits;
        self
    }

    fn options(self) -> SpidevOptions {
        let mut flags = SpiModeFlags::empty();
        if self.mode.phase == Phase::CaptureOnSecondTransition {
            flags |= SpiModeFlags::SPI_CPHA;
        }
        if self.mode.polarity == Polarity::IdleHigh {
            flags |= SpiModeFlags::SPI_CPOL;
        }
        SpidevOptions::new()
            .max_speed_hz(self.max_hertz)
            .bits_per_word(self.bits_per_word)
            .mode(flags)
            .build()
    }
}

/// An open SPI device: see [`open`].
pub struct SpiPort {
    device: PiLock<SpidevDevice>,
}

/// Opens the SPI device at `path`, such as `/dev/spidev0.0`, and configures it. It is not shared;
/// other devices of its bus are devices of their own.
///
/// # Errors
///
/// A [`DeviceError`]: missing, busy, no permission, no SPI device, settings that it does not
/// support.
///
/// ```
/// use luna::devices::DeviceError;
/// use luna_links::spi::{self, Settings};
///
/// let system = luna::System::new("machine");
/// let opened = spi::open(&system.devices(), "/dev/spidev99.0", &Settings::new(1_000_000));
/// assert!(matches!(opened, Err(DeviceError::Missing { kind: "SPI device", .. })));
/// ```
pub fn open(
    devices: &DeviceManager,
    path: &str,
    settings: &Settings,
) -> Result<Device<SpiPort>, DeviceError> {
    devices.open(path, NODE.kind(), Sharing::Exclusive, || {
        let mut port = Spidev::new(NODE.open(Path::new(path), true)?);
        port.configure(&settings.options())
            .map_err(|error| NODE.explain(Path::new(path), error))?;
        Ok(SpiPort {
            device: PiLock::new(SpidevDevice(port)),
        })
    })
}

/// A handle to an SPI device for a driver, by the trait of `embedded-hal`.
#[derive(Debug, Clone)]
pub struct Spi {
    port: Device<SpiPort>,
}

impl Spi {
    /// A user of this device.
    pub fn new(port: &Device<SpiPort>) -> Self {
        Self { port: port.clone() }
    }
}

impl ErrorType for Spi {
    type Error = SPIError;
}

impl SpiDevice for Spi {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), SPIError> {
        self.port.device.lock().transaction(operations)
    }
}

luna_platform::debug_fields!(SpiPort);

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal::spi::{MODE_1, MODE_2, MODE_3};

    #[test]
    fn a_mode_is_that_of_the_kernel() {
        let flags = |mode| Settings::new(1000).mode(mode).options().spi_mode.unwrap();
        assert_eq!(flags(MODE_0), SpiModeFlags::SPI_MODE_0);
        assert_eq!(flags(MODE_1), SpiModeFlags::SPI_MODE_1);
        assert_eq!(flags(MODE_2), SpiModeFlags::SPI_MODE_2);
        assert_eq!(flags(MODE_3), SpiModeFlags::SPI_MODE_3);
    }
}

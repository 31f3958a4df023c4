//! I2C buses.
//!
//! A bus is one device, which can be opened several times; [`I2c`] is a handle to it for a driver,
//! by the traits of `embedded-hal`. Each call blocks in the system until the transaction is over,
//! so it belongs on the thread of a [`driver`](mod@crate::driver).
//!
//! ```no_run
//! use embedded_hal::i2c::I2c as _;
//! use luna::prelude::*;
//! use luna_links::driver::driver;
//! use luna_links::i2c::{self, I2c, Settings};
//!
//! let mut system = System::new("robot");
//! let bus = i2c::open(&system.devices(), "/dev/i2c-1", &Settings::default())?;
//! let (sensor, calls) = luna::channel::call_channel::<u8, u8>(); // a register, its value
//! let link = driver(&bus, I2c::new(&bus), calls, |bus, register| {
//!     let mut value = [0];
//!     bus.write_read(0x68_u8, &[register], &mut value).map_err(luna::Error::other)?;
//!     Ok(value[0])
//! });
//! system.executor("links").build()?.process("gyroscope").spawn(link)?;
//! # drop((sensor, bus));
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

use embedded_hal::i2c::{
    ErrorKind, ErrorType, I2c as HalI2c, NoAcknowledgeSource, Operation, SevenBitAddress,
    TenBitAddress,
};
use i2cdev::core::I2CTransfer;
use i2cdev::linux::{I2CMessageFlags, LinuxI2CBus, LinuxI2CError, LinuxI2CMessage};
use luna::devices::{Device, DeviceError, DeviceManager, Node, Sharing};
use luna_platform::lock::PiLock;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::time::Duration;

const NODE: Node = Node::new("I2C bus").subsystem("i2c-dev").group("i2c");

/// Settings of a bus. They belong to the adapter: they also hold for other programs that use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    timeout: Duration,
    retries: u32,
}

impl Default for Settings {
    /// 50 ms, and no retries.
    fn default() -> Self {
        Self {
            timeout: Duration::from_millis(50),
            retries: 0,
        }
    }
}

impl Settings {
    /// How long the adapter waits for a transaction, in steps of 10 ms, at least one. Adapters keep
    /// to it only approximately.
    ///
    /// ```
    /// use luna_links::i2c::Settings;
    /// use std::time::Duration;
    /// let settings = Settings::default().timeout(Duration::from_millis(20)).retries(1);
    /// # let _ = settings;
    /// ```
    #[must_use]
    pub fn timeout(mut self, timeout: Duration) -> Self {
        self.timeout = timeout;
        self
    }

    /// How often the adapter tries again when it has lost arbitration.
    #[must_use]
    pub fn retries(mut self, retries: u32) -> Self {
        self.retries = retries;
        self
    }
}

/// An open bus: see [`open`].
pub struct Bus {
    bus: PiLock<LinuxI2CBus>,
}

/// Opens the bus at `path`, as `/dev/i2c-1`, or shares it.
///
/// # Errors
///
/// A [`DeviceError`]: missing, no permission, no I2C bus.
///
/// ```
/// use luna::devices::DeviceError;
/// use luna_links::i2c::{self, Settings};
///
/// let system = luna::System::new("machine");
/// let opened = i2c::open(&system.devices(), "/dev/i2c-99", &Settings::default());
/// assert!(matches!(opened, Err(DeviceError::Missing { kind: "I2C bus", .. })));
/// ```
pub fn open(
    devices: &DeviceManager,
    path: &str,
    settings: &Settings,
) -> Result<Device<Bus>, DeviceError> {
    devices.open(path, NODE.kind(), Sharing::Shared, || {
        let file = Path::new(path);
        NODE.check(file)?;
        let refused = |error: io::Error| NODE.explain(file, error);
        let bus = LinuxI2CBus::new(file).map_err(|error| refused(system_error(error)))?;
        let ticks = settings.timeout.as_millis().div_ceil(10).max(1);
        let ticks = libc_int(ticks as u64);
        // SAFETY: these calls take a number and the descriptor, which is open.
        unsafe {
            set_timeout(bus.as_raw_fd(), ticks).map_err(|error| refused(error.into()))?;
            set_retries(bus.as_raw_fd(), libc_int(settings.retries.into()))
                .map_err(|error| refused(error.into()))?;
        }
        Ok(Bus {
            bus: PiLock::new(bus),
        })
    })
}

fn libc_int(value: u64) -> i32 {
    i32::try_from(value).unwrap_or(i32::MAX)
}

nix::ioctl_write_int_bad!(
    /// In steps of 10 ms.
    set_timeout,
    0x0702
);
nix::ioctl_write_int_bad!(
    /// After lost arbitration.
    set_retries,
    0x0701
);

fn system_error(error: LinuxI2CError) -> io::Error {
    match error {
        LinuxI2CError::Errno(number) => io::Error::from_raw_os_error(number),
        LinuxI2CError::Io(error) => error,
    }
}

/// A handle to a bus for a driver, by the traits of `embedded-hal`. A transaction is not
/// interrupted by other users of the bus.
#[derive(Debug, Clone)]
pub struct I2c {
    bus: Device<Bus>,
}

impl I2c {
    /// A user of this bus.
    pub fn new(bus: &Device<Bus>) -> Self {
        Self { bus: bus.clone() }
    }

    fn transact(
        &self,
        address: u16,
        is_ten_bit: bool,
        operations: &mut [Operation<'_>],
    ) -> Result<(), I2cError> {
        use i2cdev::core::I2CMessage;
        let mut messages: Vec<_> = operations
            .iter_mut()
            .map(|operation| {
                let (message, mut flags) = match operation {
                    Operation::Write(bytes) => {
                        (LinuxI2CMessage::write(bytes), I2CMessageFlags::empty())
                    }
                    Operation::Read(bytes) => (LinuxI2CMessage::read(bytes), I2CMessageFlags::READ),
                };
                if is_ten_bit {
                    flags |= I2CMessageFlags::TEN_BIT_ADDRESS;
                }
                message.with_address(address).with_flags(flags)
            })
            .collect();
        let done = self.bus.bus.lock().transfer(&mut messages);
        done.map(drop).map_err(|error| I2cError {
            error: system_error(error),
        })
    }
}

/// A transaction that failed.
#[derive(Debug, thiserror::Error)]
#[error("an I2C transaction failed: {error}")]
pub struct I2cError {
    #[source]
    error: io::Error,
}

impl embedded_hal::i2c::Error for I2cError {
    fn kind(&self) -> ErrorKind {
        use nix::errno::Errno;
        // By the kernel's list of fault codes for I2C.
        match self.error.raw_os_error().map(Errno::from_raw) {
            Some(Errno::EBUSY | Errno::EIO | Errno::ETIMEDOUT) => ErrorKind::Bus,
            Some(Errno::EAGAIN) => ErrorKind::ArbitrationLoss,
            Some(Errno::ENXIO) => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
            Some(Errno::EREMOTEIO | Errno::ENODEV) => {
                ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown)
            }
            Some(Errno::EOVERFLOW) => ErrorKind::Overrun,
            _ => ErrorKind::Other,
        }
    }
}

impl ErrorType for I2c {
    type Error = I2cError;
}

impl HalI2c<SevenBitAddress> for I2c {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), I2cError> {
        self.transact(address.into(), false, operations)
    }
}

impl HalI2c<TenBitAddress> for I2c {
    fn transaction(
        &mut self,
        address: u16,
        operations: &mut [Operation<'_>],
    ) -> Result<(), I2cError> {
        self.transact(address, true, operations)
    }
}

luna_platform::debug_fields!(Bus);

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal::i2c::Error as _;

    #[test]
    fn the_kernels_faults_are_those_of_the_traits() {
        let kind = |number| {
            I2cError {
                error: io::Error::from_raw_os_error(number),
            }
            .kind()
        };
        assert_eq!(
            kind(6),
            ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)
        );
        assert_eq!(
            kind(121),
            ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown)
        );
        assert_eq!(kind(11), ErrorKind::ArbitrationLoss);
        assert_eq!(kind(110), ErrorKind::Bus);
        assert_eq!(kind(22), ErrorKind::Other);
    }
}

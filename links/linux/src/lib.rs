//! Link drivers: processes of LUNA with channels on one side and a real transport on the other.
//!
//! | transport | module | feature | what waits for it |
//! | --- | --- | --- | --- |
//! | serial ports | `serial` | `serial` | the executor, as for any file |
//! | pins (GPIO) | `gpio` | `gpio` | the executor for edges; setting one does not wait |
//! | joysticks, input devices | `joystick` | `evdev` | the executor |
//! | UDP | `udp` | `net` | the executor |
//! | TCP | `tcp` | `net` | the executor; connecting: a thread |
//! | I2C, and `embedded-hal` drivers on it | `i2c`, [`driver`](mod@driver) | `i2c` | a thread of the driver |
//! | SPI, and `embedded-hal` drivers on it | `spi`, [`driver`](mod@driver) | `spi` | a thread of the driver |
//! | a driver of your own that blocks | [`driver`](mod@driver) | – | a thread of the driver |
//! | a device file of your own | [`reader`], [`writer`] | – | the executor |
//!
//! All are opened through the [device manager](luna::devices) while the system is set up, and none holds up an executor: what can be waited for is waited for as
//! a file, what blocks in a system call does so on a thread of its own. A device that is lost while the system runs raises an emergency, unless
//! [`on_loss`](luna::devices::Device::on_loss) says otherwise. Each link has [`Counts`], which anybody may read at any time.
//!
//! They are for the real clock: a device knows nothing of a virtual one.

#![cfg(target_os = "linux")]

mod counts;
pub mod driver;
mod end;
#[cfg(feature = "gpio")]
pub mod gpio;
#[cfg(feature = "i2c")]
pub mod i2c;
#[cfg(feature = "evdev")]
pub mod joystick;
mod pump;
#[cfg(feature = "serial")]
pub mod serial;
#[cfg(feature = "spi")]
pub mod spi;
mod stream;
#[cfg(feature = "net")]
pub mod tcp;
#[cfg(feature = "net")]
pub mod udp;
mod wire;

pub use counts::Counts;
pub use pump::OnBad;
pub use stream::{Reader, Transport, Writer, reader, writer};

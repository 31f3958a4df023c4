//! Link drivers: processes of LUNA with channels on one side and a real transport on the other.
//!
//! | transport | module | feature | what waits for it |
//! | --- | --- | --- | --- |
//! | serial ports | `serial` | `serial` | the executor, as for any file |
//! | pins (GPIO) | `gpio` | `gpio` | the executor for edges; setting one does not wait |
//! | joysticks, input devices | `joystick` | `evdev` | the executor |
//! | UDP | `udp` | `net` | the executor |
//! | one hop to another computer, a value a cycle | `cycle` | `net` | the executor, or the thread |
//! | TCP | `tcp` | `net` | the executor; connecting: a thread |
//! | I2C, `embedded-hal` drivers on it | `i2c`, [`driver`](mod@driver) | `i2c` | a thread |
//! | SPI, `embedded-hal` drivers on it | `spi`, [`driver`](mod@driver) | `spi` | a thread |
//! | a driver of your own that blocks | [`driver`](mod@driver) | – | a thread |
//! | a device file of your own | [`reader`], [`writer`] | – | the executor |
//!
//! All are opened through the [device manager](luna::devices) while the system is set up, and none
//! blocks an executor: a device that can be polled is awaited as a file, and system calls that
//! block run on a thread of their own. A device that is lost while the system runs raises an
//! emergency, unless [`on_loss`](luna::devices::Device::on_loss) sets another reaction. Each link
//! has [`Counts`], which can be read at any time.
//!
//! They need the real clock: a device does not follow a virtual one.

#![cfg(target_os = "linux")]

mod counts;
#[cfg(feature = "net")]
pub mod cycle;
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

pub use counts::Counts;
pub use pump::OnBad;
pub use stream::{Reader, Transport, Writer, reader, writer};

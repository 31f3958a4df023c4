//! Joysticks and other input devices (evdev).
//!
//! [`controls`] converts a device's events to positions from -1 to 1 and buttons, and recovers when
//! the kernel has dropped some. The events themselves come by [`reader`](crate::reader), with
//! [`FRAMING`] and [`Event`].
//!
//! ```no_run
//! use luna::prelude::*;
//! use luna::devices::OnLoss;
//! use luna_links::joystick::{self, Control};
//!
//! let mut system = System::new("camera");
//! let joystick = joystick::open(
//!     &system.devices(),
//!     "/dev/input/by-id/usb-joystick-event-joystick",
//! )?;
//! joystick.on_loss(OnLoss::Fail); // its user stops the camera when the channel closes
//! let (sender, controls) = luna::channel();
//! let main = system.executor("main").build()?;
//! main.process("joystick").spawn(joystick::controls(&joystick, sender)?)?;
//! main.process("camera").spawn(async move {
//!     while let Ok(control) = controls.recv().await {
//!         if let Control::Axis { axis: joystick::X, position } = control {
//!             println!("pan to {position}");
//!         }
//!     }
//!     Ok(())
//! })?;
//! # drop(joystick);
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

mod controls;
mod device;
mod event;
mod state;

pub use controls::{Controls, controls};
pub use device::{InputDevice, open, open_alone};
pub use event::{Event, FRAMING};
pub use state::{Control, Range, Snapshot};

use crate::Transport;
use std::io;

/// The first axis of most joysticks: from left to right.
pub const X: u16 = 0;
/// The second axis of most joysticks: from away to near.
pub const Y: u16 = 1;
/// How many numbers there are for axes.
pub const MAX_AXES: usize = 64;
/// How many numbers there are for buttons.
pub const MAX_BUTTONS: usize = 768;

/// What [`controls`] needs of an input device: the kernel's, or a simulated one.
pub trait Controller: Transport {
    /// The range of an axis, if there is such an axis.
    fn range(&self, axis: u16) -> Option<Range>;

    /// The present state of all controls. It may be called on the real-time path, so it must not
    /// block or allocate.
    ///
    /// # Errors
    ///
    /// The system's error.
    fn snapshot(&self) -> io::Result<Snapshot>;
}

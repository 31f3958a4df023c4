//! The device manager: a device is opened once, by name, and closed when its last user has
//! finished.
//!
//! A program opens its devices while it is set up (or in a `pre_run`), through
//! `System::devices`. Opening gives a [`Device`], a handle that is cloned
//! for each process that uses it. The manager knows all of them: two parts of a program that name
//! one device share it, or the second gets an error that it is busy. A driver registers what brings
//! its device to safety with [`Device::on_emergency`], and reports with [`Device::lost`] that it is
//! gone, which by default is an emergency.
//!
//! [`Node`] is for drivers: it opens a device file, and turns the system's refusal into an error
//! with a remedy. [`SetPoints`] is the end of a channel that a driver takes its outputs from, with
//! the age of the newest value.

mod device;
mod holder;
mod manager;
mod node;
mod set_points;

pub use device::{Device, DeviceState, DeviceView, OnLoss};
pub use luna_error::{DeviceError, Holder};
pub use manager::{DeviceManager, Devices, Host, Sharing};
pub use node::Node;
pub use set_points::SetPoints;

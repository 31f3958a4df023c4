//! The device manager: a device is opened once, by name, and closed when its last user has
//! finished.
//!
//! A program opens its devices while it is set up (or in a `pre_run`), through
//! [`System::devices`](crate::System::devices). Opening gives a [`Device`], a handle that is cloned
//! for each process that uses it. The manager knows all of them: two parts of a program that name
//! one device share it, or the second gets an error that it is busy. A driver registers what brings
//! its device to safety with [`Device::on_emergency`], and reports with [`Device::lost`] that it is
//! gone, which by default is an emergency.
//!
//! [`Node`] is for drivers: it opens a device file, and turns the system's refusal into an error
//! with a remedy. [`SetPoints`] is the end of a channel that a driver takes its outputs from, with
//! the age of the newest value.
//!
//! ```
//! use luna::devices::{DeviceState, Sharing};
//! use luna::prelude::*;
//!
//! let system = System::new("machine");
//! let devices = system.devices();
//! let lamp = devices.open("lamp", "lamp", Sharing::Shared, || Ok("of the cabin"))?;
//! assert_eq!(*lamp.clone(), "of the cabin");
//! assert_eq!(devices.list()[0].state, DeviceState::Open);
//! drop(lamp); // the last handle closes it
//! assert_eq!(devices.list()[0].state, DeviceState::Closed);
//! # Ok::<(), luna::Error>(())
//! ```

pub use luna_devices::{
    Device, DeviceError, DeviceManager, DeviceState, DeviceView, Holder, Node, OnLoss, SetPoints,
    Sharing,
};

use crate::error::{Error, Result};
use crate::safety::{Cause, Degree, Emergency, LIMIT};
use std::time::Duration;

impl luna_devices::Host for Emergency {
    fn on_emergency(
        &self,
        name: &str,
        limit: Option<Duration>,
        function: Box<dyn FnMut() + Send>,
    ) -> Result<u64> {
        self.add_function(name, limit.unwrap_or(LIMIT), function)
    }

    fn withdraw(&self, function: u64) {
        self.withdraw_function(function);
    }

    fn lost(&self, policy: OnLoss, error: &Error) {
        let cause = || Cause::Raised(error.clone());
        match policy {
            OnLoss::Emergency => self.trigger(cause()),
            OnLoss::SafeState => self.enter_safe_state(cause()),
            OnLoss::Warn => self.journal.note(Degree::Warning, cause(), || true),
            _ => {}
        }
    }

    fn has_emergency(&self) -> bool {
        self.journal.degree() == Degree::Emergency
    }

    fn note_refusal(&self) {
        if let Some(plan) = self.plan.upgrade() {
            plan.note_refusal();
        }
    }
}

//! A line by the traits of `embedded-hal`.

use super::{Levels, Pins};
use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin, StatefulOutputPin};
use luna::devices::Device;
use std::io;

/// One line, by the traits of `embedded-hal`, for a driver that needs a pin beside its bus. Each
/// call is a system call, made at once.
#[derive(Debug, Clone)]
pub struct Pin {
    pins: Device<Pins>,
    number: usize,
}

impl Pin {
    /// The line of this number, from 0, if there is one.
    pub fn new(pins: &Device<Pins>, number: usize) -> Option<Self> {
        (number < pins.count()).then(|| Self {
            pins: pins.clone(),
            number,
        })
    }

    fn set(&self, level: bool) -> Result<(), PinError> {
        let levels = Levels::NONE.with(self.number, level);
        self.pins.set(levels).map_err(PinError)
    }

    fn get(&self) -> Result<bool, PinError> {
        self.pins.get(self.number).map_err(PinError)
    }
}

/// A pin cannot be set or read: the system's error, the pin is not an output, or an emergency has
/// set it.
#[derive(Debug, thiserror::Error)]
#[error("a pin cannot be used: {0}")]
pub struct PinError(#[source] io::Error);

impl Error for PinError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Pin {
    type Error = PinError;
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), PinError> {
        self.set(false)
    }

    fn set_high(&mut self) -> Result<(), PinError> {
        self.set(true)
    }
}

impl StatefulOutputPin for Pin {
    fn is_set_high(&mut self) -> Result<bool, PinError> {
        self.get()
    }

    fn is_set_low(&mut self) -> Result<bool, PinError> {
        Ok(!self.get()?)
    }
}

impl InputPin for Pin {
    fn is_high(&mut self) -> Result<bool, PinError> {
        self.get()
    }

    fn is_low(&mut self) -> Result<bool, PinError> {
        Ok(!self.get()?)
    }
}

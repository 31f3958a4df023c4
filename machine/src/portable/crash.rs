//! The standard library knows no signals.

use crate::signals::SignalError;

pub(crate) fn install() -> Result<(), SignalError> {
    Err(SignalError::Unsupported)
}

pub(crate) fn restore() {}

//! The standard library knows no TAI.

use crate::tai::Synchronization;
use std::io::{ErrorKind, Result};

/// The standard library knows no TAI.
pub fn tai_nanos() -> Result<u64> {
    Err(ErrorKind::Unsupported.into())
}

/// The standard library knows nothing of it.
pub(crate) fn synchronization() -> Result<Synchronization> {
    Err(ErrorKind::Unsupported.into())
}

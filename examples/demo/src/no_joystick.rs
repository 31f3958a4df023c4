//! Where there are no input devices, the file is a recording.

use luna::Executor;
use luna::prelude::*;
use std::path::Path;

/// Whether the file is a device, and not a recording.
pub(crate) fn is_device(_: &Path) -> bool {
    false
}

/// As none is a device, this is not called.
pub(crate) fn follow(_: &mut System, _: &Executor, _: &Path) -> luna::Result<()> {
    Err(luna::Error::other("input devices need Linux"))
}

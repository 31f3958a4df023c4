//! The start of what brings the machine to safety.

use crate::error::Result;
use crate::notice::notice;
use crate::safety::{Emergency, ParentThread};
use std::sync::Arc;

/// Makes the parent's death an emergency, where the machine can report it.
pub(super) fn watch_parent(
    emergency: &Arc<Emergency>,
    real_time: bool,
    is_strict: bool,
) -> Result<Option<ParentThread>> {
    match ParentThread::start(emergency.clone(), real_time)? {
        Ok(thread) => Ok(Some(thread)),
        Err(error) if is_strict => Err(ParentThread::refused(&error)),
        Err(error) => {
            notice!("luna: {}", ParentThread::refused(&error));
            Ok(None)
        }
    }
}

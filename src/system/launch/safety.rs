//! The start of what brings the machine to safety.

use super::machine::Needs;
use crate::error::Result;
use crate::notice::notice;
use crate::safety::{Emergency, EmergencyThread, GuardianWatch, ParentThread};
use crate::system::plan::Settings;
use luna_executors::ProcessRegistry;
use std::sync::Arc;

/// What is there from before anything moves until all has ended. If the start fails it is ended in
/// this order.
pub(super) struct SafetyThreads {
    pub(super) parent: Option<ParentThread>,
    pub(super) emergency: EmergencyThread,
    pub(super) guardian: Option<GuardianWatch>,
}

impl SafetyThreads {
    pub(super) fn start(
        emergency: &Arc<Emergency>,
        registry: &Arc<ProcessRegistry>,
        settings: &Settings,
        needs: &Needs,
    ) -> Result<Self> {
        let strict = settings.strict;
        let guardian = settings.guardian.as_ref();
        let guardian = guardian
            .map(|guardian| GuardianWatch::start(guardian, emergency.clone(), strict))
            .transpose()?;
        let (own, registry) = (emergency.clone(), registry.clone());
        let guard = EmergencyThread::start(own, registry, needs.real_time, &needs.cores)?;
        let parent = match settings.parents_death {
            true => watch_parent(emergency, needs.real_time, strict)?,
            false => None,
        };
        Ok(Self {
            parent,
            emergency: guard,
            guardian,
        })
    }
}

/// Makes the parent's death an emergency, where the machine can report it.
fn watch_parent(
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

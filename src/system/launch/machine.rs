//! What a system asks of the machine.

use super::super::plan::{ExecutorPlan, Place, ProcessPlan, Settings};
use crate::error::{Result, SetupError};
use luna_platform::memory::{self, MemoryLock};
use luna_platform::shortfall::Shortfall;
use luna_platform::thread::Policy;

/// The heap that is fetched before the start when memory is locked: what bodies allocate in spite
/// of it all comes from here first.
const HEAP_IN_ADVANCE: usize = 4 << 20;

pub(super) fn policy_of(process: &ProcessPlan) -> Policy {
    match &process.place {
        Place::Thread { attributes, .. } => attributes.asked_policy(),
        Place::Executor(_) => Policy::Other,
    }
}

/// The cores that real-time threads are pinned to.
pub(super) fn real_time_cores(executors: &[ExecutorPlan], processes: &[ProcessPlan]) -> Vec<usize> {
    let threads = processes.iter().filter_map(|process| match &process.place {
        Place::Thread { attributes, .. } => Some(&**attributes),
        Place::Executor(_) => None,
    });
    let all = executors.iter().map(|executor| &executor.attributes);
    let mut cores = Vec::new();
    for attributes in all.chain(threads) {
        if let Some(core) = attributes.asked_core()
            && attributes.asked_policy().is_real_time()
            && !cores.contains(&core)
        {
            cores.push(core);
        }
    }
    cores
}

pub(super) fn lock_memory(
    settings: &Settings,
    shortfalls: &mut Vec<Shortfall>,
) -> Result<Option<MemoryLock>> {
    if !settings.lock_memory {
        return Ok(None);
    }
    memory::prefault_heap(HEAP_IN_ADVANCE)?;
    let locked = memory::lock_memory();
    if settings.strict {
        return locked.map(Some).map_err(|shortfall| {
            SetupError::Refused {
                of: "system".to_owned(),
                shortfall,
            }
            .into()
        });
    }
    Ok(obtained(locked, shortfalls))
}

pub(super) fn obtained<T>(
    asked: Result<T, Shortfall>,
    shortfalls: &mut Vec<Shortfall>,
) -> Option<T> {
    asked.map_err(|shortfall| shortfalls.push(shortfall)).ok()
}

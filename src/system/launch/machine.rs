//! What a system asks of the machine.

use super::super::plan::{ExecutorPlan, Placement, ProcessPlan, Settings};
use crate::error::{Result, SetupError};
use luna_platform::latency::DmaLatency;
use luna_platform::memory::{self, MemoryLock};
use luna_platform::shortfall::Shortfall;
use luna_platform::thread::{Mode, Policy};

/// The heap that is fetched before the start when memory is locked: what bodies allocate in spite
/// of it all comes from here first.
const HEAP_IN_ADVANCE: usize = 4 << 20;

/// What a system needs of the machine.
pub(super) struct Needs {
    pub(super) mode: Mode,
    /// A thread has a real-time policy.
    pub(super) real_time: bool,
    /// The cores that real-time threads are pinned to.
    pub(super) cores: Vec<usize>,
}

impl Needs {
    pub(super) fn of(
        settings: &Settings,
        is_virtual: bool,
        executors: &[ExecutorPlan],
        processes: &[ProcessPlan],
    ) -> Needs {
        let mut policies = executors
            .iter()
            .map(|executor| executor.attributes.asked_policy())
            .chain(processes.iter().map(policy_of));
        // On a clock of its own nothing has to come in time, so nothing is asked of the machine for
        // that.
        let real_time = !is_virtual && policies.any(Policy::is_real_time);
        Needs {
            mode: match settings.strict {
                true => Mode::Strict,
                false => Mode::BestEffort,
            },
            real_time,
            cores: match real_time {
                true => real_time_cores(executors, processes),
                false => Vec::new(),
            },
        }
    }

    /// Keeps the machine's latency low, as far as it does that. It was not requested, so its lack
    /// is no reason not to start.
    pub(super) fn hold_latency(&self, shortfalls: &mut Vec<Shortfall>) -> Option<DmaLatency> {
        self.real_time
            .then(|| obtained(DmaLatency::hold(), shortfalls))
            .flatten()
    }
}

fn policy_of(process: &ProcessPlan) -> Policy {
    match &process.place {
        Placement::Thread { attributes, .. } => attributes.asked_policy(),
        Placement::Executor(_) => Policy::Other,
    }
}

/// The cores that real-time threads are pinned to.
fn real_time_cores(executors: &[ExecutorPlan], processes: &[ProcessPlan]) -> Vec<usize> {
    let threads = processes.iter().filter_map(|process| match &process.place {
        Placement::Thread { attributes, .. } => Some(&**attributes),
        Placement::Executor(_) => None,
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

fn obtained<T>(asked: Result<T, Shortfall>, shortfalls: &mut Vec<Shortfall>) -> Option<T> {
    asked.map_err(|shortfall| shortfalls.push(shortfall)).ok()
}

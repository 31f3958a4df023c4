//! What a system asks of the machine.

use super::super::plan::{Placement, ProcessPlan, Settings};
use crate::error::{Result, SetupError};
use luna_machine::latency::DmaLatency;
use luna_machine::memory::{self, MemoryLock};
use luna_machine::shortfall::Shortfall;
use luna_platform::thread::{Attributes, Mode, Policy};

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
        executors: &[Attributes],
        processes: &[ProcessPlan],
    ) -> Needs {
        let threads = processes.iter().filter_map(|process| match &process.place {
            Placement::Thread(attributes) => Some(&**attributes),
            Placement::Executor(_) => None,
        });
        // On a clock of its own nothing has to come in time, so nothing is asked of the machine for
        // that.
        let is_real_time = |one: &&Attributes| !is_virtual && one.asked_policy().is_real_time();
        let (mut real_time, mut cores) = (false, Vec::new());
        for attributes in executors.iter().chain(threads).filter(is_real_time) {
            real_time = true;
            cores.extend(attributes.asked_core().filter(|core| !cores.contains(core)));
        }
        Needs {
            mode: match settings.strict {
                true => Mode::Strict,
                false => Mode::BestEffort,
            },
            real_time,
            cores,
        }
    }

    /// The policy of a thread of the framework: with this priority if the system is a real-time
    /// one.
    pub(super) fn policy(&self, priority: u8) -> Policy {
        match self.real_time {
            true => Policy::fifo(priority),
            false => Policy::Other,
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

//! Where processes run, and what is not known of that.

use crate::network::{Executor, Network, Process};

/// The executor or thread of a process.
pub(super) fn executor<'n>(network: &'n Network, process: &Process) -> Option<&'n Executor> {
    let on = process.on.as_ref()?;
    network
        .executors
        .iter()
        .find(|executor| executor.name == *on)
}

/// 0 for a policy that is not real-time; none if no policy is stated, or one that no bound covers.
pub(super) fn rank(executor: &Executor) -> Option<u8> {
    match executor.policy.as_deref()?.split_once(':') {
        None => Some(0),
        Some((_, level)) => level.parse().ok(),
    }
}

/// Whether it may take time of a core besides what is known to run there. What is on no host may be
/// on any.
pub(super) fn may_be_besides(executor: &Executor, host: &str, core: u16) -> bool {
    let rank = rank(executor);
    let is_placed = executor.host == host && executor.core == Some(core) && rank.is_some();
    let is_on_host = executor.host == host || executor.host.is_empty() || host.is_empty();
    let may_be_there = is_on_host && executor.core.is_none_or(|its| its == core);
    rank != Some(0) && may_be_there && !is_placed
}

/// What may run before a process, though the model does not say that it does; and what to state.
pub(super) fn open(network: &Network, process: &Process) -> Option<String> {
    let own = executor(network, process)?;
    let core = own.core?;
    network.processes.iter().find_map(|process| {
        let other = executor(network, process)?;
        let ranks = rank(other).zip(rank(own));
        let is_below = ranks.is_some_and(|(other, own)| other < own);
        if is_below || !may_be_besides(other, &own.host, core) {
            return None;
        }
        let on = &other.name;
        let step = match &other.policy {
            None => format!("state the policy of `{on}`"),
            Some(policy) if rank(other).is_none() => {
                format!("no bound covers `{policy}` of `{on}`: give it another core")
            }
            Some(_) if other.core.is_none() => format!("state the core of `{on}`"),
            Some(_) => {
                let on = if other.host.is_empty() { on } else { &own.name };
                format!("state the program of `{on}`, and the host of that")
            }
        };
        Some(format!("`{}` may run before it: {step}", process.name))
    })
}

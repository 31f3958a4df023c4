//! Facts from `/sys` and `/proc`.

use super::privileges::{self, Capability};
use super::thread::available_cores;
use crate::facts::parse::{
    core_list, number, preemption_asked, preemption_in_effect, preemption_of_version,
};
use crate::facts::{Limit, NumaNode, PreemptionModel, SystemFacts, Throttling};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use std::fs;

pub(crate) fn gather() -> SystemFacts {
    let online_cores = cores("/sys/devices/system/cpu/online");
    let governors = online_cores.iter().flatten().filter_map(|&core| {
        let file = format!("/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor");
        Some((core, word(&file)?))
    });
    SystemFacts {
        governors: governors.collect(),
        online_cores,
        allowed_cores: Some(available_cores()),
        isolated_cores: cores("/sys/devices/system/cpu/isolated"),
        tickless_cores: cores("/sys/devices/system/cpu/nohz_full"),
        numa_nodes: numa_nodes(),
        kernel_release: word("/proc/sys/kernel/osrelease"),
        preemption: preemption(),
        throttling: throttling(),
        clock_source: word("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        may_set_policy: may(Capability::SysNice),
        may_lock_memory: may(Capability::IpcLock),
        priority_limit: limit(Resource::RLIMIT_RTPRIO),
        locked_memory_limit: limit(Resource::RLIMIT_MEMLOCK),
    }
}

fn word(file: &str) -> Option<String> {
    let text = fs::read_to_string(file).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}

fn cores(file: &str) -> Option<Vec<usize>> {
    core_list(&fs::read_to_string(file).ok()?)
}

fn numa_nodes() -> Option<Vec<NumaNode>> {
    let ids = cores("/sys/devices/system/node/online")?;
    let nodes = ids.into_iter().map(|id| {
        let cores = cores(&format!("/sys/devices/system/node/node{id}/cpulist"))?;
        Some(NumaNode { id, cores })
    });
    nodes.collect()
}

fn preemption() -> Option<PreemptionModel> {
    if word("/sys/kernel/realtime").as_deref() == Some("1") {
        return Some(PreemptionModel::RealTime);
    }
    let built = preemption_of_version(&word("/proc/sys/kernel/version")?);
    if built != PreemptionModel::Dynamic {
        return Some(built);
    }
    // Only root sees the one in effect, and only where debugfs is mounted. The command line is nearly as good, where it says one.
    let in_effect = fs::read_to_string("/sys/kernel/debug/sched/preempt")
        .ok()
        .and_then(|text| preemption_in_effect(&text));
    let asked = || preemption_asked(&fs::read_to_string("/proc/cmdline").ok()?);
    in_effect.or_else(asked).or(Some(PreemptionModel::Dynamic))
}

fn throttling() -> Option<Throttling> {
    let value = |name: &str| number(&fs::read_to_string(format!("/proc/sys/kernel/{name}")).ok()?);
    Some(Throttling {
        // -1 says that there is no limit.
        runtime_us: u64::try_from(value("sched_rt_runtime_us")?).ok(),
        period_us: u64::try_from(value("sched_rt_period_us")?).ok()?,
    })
}

fn may(capability: Capability) -> Option<bool> {
    privileges::effective(capability)
        .map(|effective| effective && !privileges::in_a_user_namespace())
}

fn limit(resource: Resource) -> Option<Limit> {
    getrlimit(resource).ok().map(|(soft, _)| match soft {
        RLIM_INFINITY => Limit::Unlimited,
        most => Limit::AtMost(most),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_machine_has_facts() {
        let facts = gather();
        println!("{facts:#?}");
        let online = facts.online_cores.unwrap();
        let allowed = facts.allowed_cores.unwrap();
        assert!(!allowed.is_empty() && allowed.iter().all(|core| online.contains(core)));
        assert!(facts.kernel_release.is_some());
        assert!(facts.priority_limit.is_some() && facts.locked_memory_limit.is_some());
        assert!(facts.may_set_policy.is_some());
    }
}

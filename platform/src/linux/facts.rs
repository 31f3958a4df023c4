//! Facts from `/sys` and `/proc`.

use super::privileges::{self, Capability};
use super::thread::available_cores;
use crate::facts::parse::core_list;
use crate::facts::{
    ClockResolution, Limit, NumaNode, PreemptionModel, Source, SystemFacts, Throttling,
};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit};
use nix::time::{ClockId, clock_getres};
use std::fs;

/// Below which the kernel's files lie.
pub(crate) const ROOT: Option<&str> = Some("/");

/// The coarse clock advances with the tick.
pub(crate) fn clock_resolution() -> Option<ClockResolution> {
    let nanos = |clock| {
        let resolution = clock_getres(clock).ok()?;
        u64::try_from(resolution.tv_sec() * 1_000_000_000 + resolution.tv_nsec()).ok()
    };
    Some(ClockResolution {
        timer_ns: nanos(ClockId::CLOCK_MONOTONIC)?,
        tick_ns: nanos(ClockId::CLOCK_MONOTONIC_COARSE)?,
    })
}

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
        preemption: PreemptionModel::read(&Source::machine()).ok(),
        throttling: Throttling::read(&Source::machine()).ok(),
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

//! What this process may do, and what keeps it from doing more.

use crate::facts::control_group::{file, group_one, group_two, mount_of_one};
use crate::facts::task::{has_capability, is_first_user_namespace};
use crate::shortfall::PolicyRefusal;
use std::fs;

/// Whether the calling thread has the capability of this bit in effect; `None` if `/proc` does not
/// show it.
pub(super) fn effective(capability: u32) -> Option<bool> {
    let status = fs::read_to_string("/proc/thread-self/status").ok()?;
    has_capability(&status, capability)
}

/// Whether this process lives in a user namespace of its own, where capabilities do not reach
/// scheduling and locked memory.
pub(super) fn in_a_user_namespace() -> bool {
    // The first namespace maps every number to itself.
    fs::read_to_string("/proc/self/uid_map").is_ok_and(|map| !is_first_user_namespace(&map))
}

/// The control group without a budget for real-time threads, if one is the reason.
pub(super) fn group_without_budget() -> Option<PolicyRefusal> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    if let Some(path) = group_one(&groups, "cpu") {
        let mounts = fs::read_to_string("/proc/self/mounts").ok()?;
        let file = file(mount_of_one(&mounts, "cpu")?, path, "cpu.rt_runtime_us");
        let budget = fs::read_to_string(&file).ok()?;
        return (budget.trim() == "0").then_some(PolicyRefusal::NoGroupBudget { file });
    }
    let group = group_two(&groups)?;
    (group != "/").then(|| PolicyRefusal::GroupWithoutBudget {
        group: group.to_owned(),
    })
}

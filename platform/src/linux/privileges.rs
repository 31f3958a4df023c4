//! What this process may do, and what keeps it from doing more.

use crate::facts::control_group::{file, group_one, group_two, mount_of_one};
use crate::facts::task::{CAP_IPC_LOCK, CAP_SYS_NICE, has_capability, is_first_user_namespace};
use std::fs;

/// A capability that matters here, by its bit.
#[derive(Debug, Clone, Copy)]
pub(super) enum Capability {
    /// `CAP_IPC_LOCK`: lock any amount of memory.
    IpcLock = CAP_IPC_LOCK as isize,
    /// `CAP_SYS_NICE`: any policy and priority.
    SysNice = CAP_SYS_NICE as isize,
}

/// Whether the calling thread has the capability in effect; `None` if `/proc` does not show it.
pub(super) fn effective(capability: Capability) -> Option<bool> {
    let status = fs::read_to_string("/proc/thread-self/status").ok()?;
    has_capability(&status, capability as u32)
}

/// Whether this process lives in a user namespace of its own, where capabilities do not reach
/// scheduling and locked memory.
pub(super) fn in_a_user_namespace() -> bool {
    // The first namespace maps every number to itself.
    fs::read_to_string("/proc/self/uid_map").is_ok_and(|map| !is_first_user_namespace(&map))
}

/// The control group that governs this process' real-time time.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum CpuGroup {
    /// Version 1, and its budget is 0.
    One {
        /// The file that holds the budget.
        file: String,
    },
    /// Version 2, not the root.
    Two {
        /// Its path.
        group: String,
    },
}

/// Where the budget for real-time threads is missing, if a control group is the reason.
pub(super) fn cpu_group() -> Option<CpuGroup> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    if let Some(path) = group_one(&groups, "cpu") {
        let mounts = fs::read_to_string("/proc/self/mounts").ok()?;
        let file = file(mount_of_one(&mounts, "cpu")?, path, "cpu.rt_runtime_us");
        let budget = fs::read_to_string(&file).ok()?;
        return (budget.trim() == "0").then_some(CpuGroup::One { file });
    }
    let group = group_two(&groups)?;
    (group != "/").then(|| CpuGroup::Two {
        group: group.to_owned(),
    })
}

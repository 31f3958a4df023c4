//! What this process may do, and what keeps it from doing more.

use crate::facts::control_group::{file, group_one, group_two, mount_of_one};
use crate::facts::task::is_first_user_namespace;
use crate::shortfall::PolicyRefusal;
use nix::libc;
use std::fs;

/// Whether the calling thread has the capability of this bit in effect; `None` if the kernel does not
/// tell. One system call, which needs no file: a process that has too many open is no plain user.
pub fn has_capability(capability: u32) -> Option<bool> {
    /// `struct __user_cap_header_struct`.
    #[repr(C)]
    struct Head {
        version: u32,
        process: i32,
    }
    /// `struct __user_cap_data_struct`: 32 capabilities.
    #[repr(C)]
    #[derive(Clone, Copy)]
    struct Half {
        effective: u32,
        permitted: u32,
        inheritable: u32,
    }
    // Version 3, of which there are two halves; process 0 is the calling thread.
    let mut head = Head {
        version: 0x2008_0522,
        process: 0,
    };
    let mut halves = [Half {
        effective: 0,
        permitted: 0,
        inheritable: 0,
    }; 2];
    // SAFETY: both live during the call, and have the layout and size of this version.
    let outcome = unsafe { libc::syscall(libc::SYS_capget, &raw mut head, halves.as_mut_ptr()) };
    let half = halves.get(capability as usize / 32)?;
    (outcome == 0).then_some(half.effective >> (capability % 32) & 1 == 1)
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

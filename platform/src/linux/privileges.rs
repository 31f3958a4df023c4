//! What this process may do, and what keeps it from doing more.

use std::fs;

/// A capability that matters here, by its bit.
#[derive(Debug, Clone, Copy)]
pub(super) enum Capability {
    /// `CAP_IPC_LOCK`: lock any amount of memory.
    IpcLock = 14,
    /// `CAP_SYS_NICE`: any policy and priority.
    SysNice = 23,
}

/// Whether the calling thread has the capability in effect; `None` if `/proc` does not tell.
pub(super) fn effective(capability: Capability) -> Option<bool> {
    let status = fs::read_to_string("/proc/thread-self/status").ok()?;
    effective_in(&status, capability)
}

fn effective_in(status: &str, capability: Capability) -> Option<bool> {
    let bits = status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))?;
    let bits = u64::from_str_radix(bits.trim(), 16).ok()?;
    Some(bits & (1 << capability as u32) != 0)
}

/// Whether this process lives in a user namespace of its own, where capabilities do not reach scheduling and locked memory.
pub(super) fn in_a_user_namespace() -> bool {
    // The first namespace maps every number to itself.
    fs::read_to_string("/proc/self/uid_map").is_ok_and(|map| !maps_all_to_themselves(&map))
}

fn maps_all_to_themselves(map: &str) -> bool {
    map.split_whitespace().eq(["0", "0", "4294967295"])
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
    if let Some(path) = group_one(&groups) {
        let mounts = fs::read_to_string("/proc/self/mounts").ok()?;
        let file = format!(
            "{}{}/cpu.rt_runtime_us",
            mount_of_cpu(&mounts)?,
            path.trim_end_matches('/')
        );
        let budget = fs::read_to_string(&file).ok()?;
        return (budget.trim() == "0").then_some(CpuGroup::One { file });
    }
    let group = group_two(&groups)?;
    (group != "/").then(|| CpuGroup::Two {
        group: group.to_owned(),
    })
}

/// The path of the version 1 group with the cpu controller.
fn group_one(groups: &str) -> Option<&str> {
    groups.lines().find_map(|line| {
        let (_, rest) = line.split_once(':')?;
        let (controllers, path) = rest.split_once(':')?;
        controllers
            .split(',')
            .any(|controller| controller == "cpu")
            .then_some(path)
    })
}

/// The path of the version 2 group.
fn group_two(groups: &str) -> Option<&str> {
    groups.lines().find_map(|line| line.strip_prefix("0::"))
}

/// Where the version 1 hierarchy of the cpu controller is mounted.
fn mount_of_cpu(mounts: &str) -> Option<&str> {
    mounts.lines().find_map(|line| {
        let mut fields = line.split(' ').skip(1);
        let (directory, kind, options) = (fields.next()?, fields.next()?, fields.next()?);
        (kind == "cgroup" && options.split(',').any(|option| option == "cpu")).then_some(directory)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capabilities_are_bits() {
        let status = "Name:\tx\nCapInh:\t0000000000000000\nCapEff:\t0000000000804000\nCapBnd:\t000001ffffffffff\n";
        assert_eq!(effective_in(status, Capability::IpcLock), Some(true));
        assert_eq!(effective_in(status, Capability::SysNice), Some(true));
        assert_eq!(
            effective_in("CapEff:\t0000000000000001", Capability::SysNice),
            Some(false)
        );
        assert_eq!(effective_in("", Capability::SysNice), None);
    }

    #[test]
    fn the_first_user_namespace_is_known_by_its_map() {
        assert!(maps_all_to_themselves("         0          0 4294967295\n"));
        assert!(!maps_all_to_themselves(
            "         0       1000          1\n"
        ));
        assert!(!maps_all_to_themselves(
            "         0     100000      65536\n"
        ));
    }

    #[test]
    fn groups_of_both_versions() {
        let one = "9:name=systemd:/\n4:memory:/x\n2:cpuacct:/\n1:cpu,cpuacct:/user.slice\n0::/\n";
        assert_eq!(group_one(one), Some("/user.slice"));
        let two = "0::/user.slice/user-1000.slice\n";
        assert_eq!(
            (group_one(two), group_two(two)),
            (None, Some("/user.slice/user-1000.slice"))
        );
        let mounts = "proc /proc proc rw 0 0\ncgroup /sys/fs/cgroup/cpuset cgroup rw,cpuset 0 0\n\
                      cgroup /sys/fs/cgroup/cpu,cpuacct cgroup rw,nosuid,cpu,cpuacct 0 0\n";
        assert_eq!(mount_of_cpu(mounts), Some("/sys/fs/cgroup/cpu,cpuacct"));
        assert_eq!(
            mount_of_cpu("cgroup2 /sys/fs/cgroup cgroup2 rw 0 0\n"),
            None
        );
    }
}

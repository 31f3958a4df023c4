//! Why the system refused an attribute: from its error number, and from what the machine's files
//! say.

use super::{CoreRefusal, PolicyRefusal, Shortfall};
use crate::facts::control_group::{file, group_one, group_two, mount_of_one};
use crate::facts::parse::{core_list, write_core_list};
use crate::facts::task::{CAP_SYS_NICE, is_first_user_namespace};
use luna_platform::thread::{Policy, Refusal, Why, available_cores, has_capability};
use std::fs;
use std::io::{Error, ErrorKind};

impl Shortfall {
    /// What a thread was refused, and why, as far as this process can find out. Reads files; not
    /// for the real-time path.
    ///
    /// ```
    /// use luna_machine::shortfall::Shortfall;
    /// use luna_platform::thread::{Attributes, apply_to_current};
    ///
    /// let obtained = apply_to_current(&Attributes::new("me").core(70_000))?;
    /// let shortfalls: Vec<_> = obtained.refusals.iter().map(Shortfall::of).collect();
    /// assert_eq!(shortfalls[0].what(), "core 70000");
    /// # Ok::<(), luna_platform::thread::SpawnError>(())
    /// ```
    pub fn of(refusal: &Refusal) -> Shortfall {
        match refusal.clone() {
            Refusal::Policy { asked, why } => Shortfall::Policy {
                asked,
                why: why_no_policy(asked, why),
            },
            Refusal::Core { asked, why } => Shortfall::Core {
                asked,
                why: why_no_core(asked, why),
            },
            Refusal::Spin { asked, why } => Shortfall::Spin { asked, why },
        }
    }

    /// A priority that a thread was not to inherit, for this error number. As [`of`](Self::of).
    pub fn of_inheritance(asked: u8, number: i32) -> Shortfall {
        let why = why_no_policy(Policy::fifo(asked), Why::Kernel(number));
        Shortfall::Inheritance { asked, why }
    }
}

fn why_no_policy(asked: Policy, why: Why) -> PolicyRefusal {
    let error = match why {
        Why::Kernel(number) => Error::from_raw_os_error(number),
        Why::NotKept(obtained) => return PolicyRefusal::NotKept { obtained },
        Why::Unsupported => return PolicyRefusal::Unsupported,
    };
    let reason = match (asked, error.kind()) {
        (Policy::Deadline { .. }, ErrorKind::PermissionDenied) => Some(no_deadline()),
        (Policy::Deadline { .. }, ErrorKind::ResourceBusy) => {
            Some(PolicyRefusal::NoBandwidth { share: share() })
        }
        (Policy::Deadline { period, .. }, _) => out_of_range(period),
        (_, ErrorKind::PermissionDenied) => no_priority(asked.priority()),
        _ => None,
    };
    reason.unwrap_or_else(|| PolicyRefusal::Kernel {
        message: error.to_string(),
    })
}

fn no_priority(priority: u8) -> Option<PolicyRefusal> {
    let limit = limit_on_priorities();
    let capable = has_capability(CAP_SYS_NICE) == Some(true);
    if capable && in_a_user_namespace() {
        return Some(PolicyRefusal::UserNamespace);
    }
    if !capable && limit.is_none_or(|limit| limit < priority.into()) {
        return Some(PolicyRefusal::NotPermitted { limit });
    }
    // It may: so its group has no budget.
    group_without_budget()
}

/// A limit on priorities does not matter here.
fn no_deadline() -> PolicyRefusal {
    match has_capability(CAP_SYS_NICE) {
        Some(true) if in_a_user_namespace() => PolicyRefusal::UserNamespace,
        // The process is permitted: so its cores are too few.
        Some(true) => PolicyRefusal::NotAllCores {
            allowed: write_core_list(&available_cores()),
        },
        _ => PolicyRefusal::NotPermitted { limit: None },
    }
}

/// The process' RLIMIT_RTPRIO.
fn limit_on_priorities() -> Option<u64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    let name = "Max realtime priority";
    let soft = limits.lines().find_map(|line| line.strip_prefix(name))?;
    match soft.split_whitespace().next()? {
        "unlimited" => Some(u64::MAX),
        number => number.parse().ok(),
    }
}

/// Whether this process lives in a user namespace of its own, where capabilities do not reach
/// scheduling and locked memory.
pub(crate) fn in_a_user_namespace() -> bool {
    // The first namespace maps every number to itself.
    fs::read_to_string("/proc/self/uid_map").is_ok_and(|map| !is_first_user_namespace(&map))
}

/// The control group without a budget for real-time threads, if one is the reason.
fn group_without_budget() -> Option<PolicyRefusal> {
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

/// How much of the processors real-time threads may have, in percent.
fn share() -> Option<u8> {
    let runtime = setting("sched_rt_runtime_us")?;
    let period = setting("sched_rt_period_us")?;
    u8::try_from(runtime.checked_mul(100)?.checked_div(period)?).ok()
}

/// Whether the kernel's limits on the period are the reason.
fn out_of_range(period: u64) -> Option<PolicyRefusal> {
    let least = setting("sched_deadline_period_min_us")?;
    let most = setting("sched_deadline_period_max_us")?;
    let within = least.saturating_mul(1000)..=most.saturating_mul(1000);
    (!within.contains(&period)).then_some(PolicyRefusal::PeriodRange { least, most })
}

/// A number of the scheduler's settings.
fn setting(name: &str) -> Option<u64> {
    let text = fs::read_to_string(format!("/proc/sys/kernel/{name}")).ok()?;
    text.trim().parse().ok()
}

fn why_no_core(core: usize, why: Why) -> CoreRefusal {
    let error = match why {
        Why::Kernel(number) => Error::from_raw_os_error(number),
        Why::NotKept(_) => return CoreRefusal::NotKept,
        Why::Unsupported => return CoreRefusal::Unsupported,
    };
    if error.kind() != ErrorKind::InvalidInput {
        return CoreRefusal::Kernel {
            message: error.to_string(),
        };
    }
    let list = |file: &str| {
        let text = fs::read_to_string(format!("/sys/devices/system/cpu/{file}")).ok();
        text.and_then(|text| core_list(&text))
    };
    let online = list("online");
    // "Possible" counts sockets that could be filled later; "present" is what there is.
    match list("present").or_else(|| online.clone()) {
        Some(present) if !present.contains(&core) => CoreRefusal::NoSuchCore {
            cores: write_core_list(&present),
        },
        _ if online.is_some_and(|online| !online.contains(&core)) => CoreRefusal::Offline,
        _ => CoreRefusal::NotAllowed {
            allowed: write_core_list(&available_cores()),
        },
    }
}

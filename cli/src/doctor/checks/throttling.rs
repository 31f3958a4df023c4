//! How much of a core real-time threads may take.

use super::better_off;
use crate::doctor::facts::{command_line, number};
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::{Machine, missing_is};
use luna_machine::facts::control_group::{file, group_one, group_two, mount_of_one, mount_of_two};
use luna_machine::facts::{Unread, UnreadReason};

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "throttling",
        why: "a core whose real-time threads have used up their part of a period stands still for them until its end",
        otherwise: "run `sysctl kernel.sched_rt_runtime_us kernel.sched_rt_period_us`",
        look: throttling,
    },
    Check {
        name: "fair-server",
        why: "since Linux 6.12 the kernel interrupts real-time threads that leave nothing to others, as throttling did before",
        otherwise: "run `sudo grep . /sys/kernel/debug/sched/fair_server/cpu*/runtime`, after `mount -t debugfs none /sys/kernel/debug`",
        look: fair_server,
    },
    Check {
        name: "real-time-group-budget",
        why: "in a control group without a real-time budget the kernel refuses SCHED_FIFO",
        otherwise: "run `grep RT_GROUP_SCHED /boot/config-$(uname -r)`, or see under `self-test` whether SCHED_FIFO was obtained",
        look: group_budget,
    },
    Check {
        name: "cpu-quota",
        why: "executors without a real-time policy stand still for the rest of a period when their group has used its quota",
        otherwise: "look for cpu.max (or cpu.cfs_quota_us) in the control group of the program",
        look: quota,
    },
    Check {
        name: "autogroup",
        why: "the nice values of ordinary threads count only within their session, so an executor without a policy gets less",
        otherwise: "run `sysctl kernel.sched_autogroup_enabled`",
        look: autogroup,
    },
];

const GROUPS: &str = "/proc/self/cgroup";

fn throttling(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/sys/kernel/sched_rt_runtime_us";
    // -1 says that there is no limit.
    let runtime = machine.source.parse(from, number)?;
    let period = "/proc/sys/kernel/sched_rt_period_us";
    let period_us = machine
        .source
        .parse(period, |text| u64::try_from(number(text)?).ok())?;
    let runtime = u64::try_from(runtime).ok();
    let Some(runtime) = runtime.filter(|runtime| *runtime < period_us) else {
        return Ok(Seen::good(
            "none: real-time threads may take all of a core",
            from,
        ));
    };
    let read = format!("{runtime} of each {period_us} us");
    let is_without_groups = || {
        let option = machine.option("CONFIG_RT_GROUP_SCHED");
        option.is_ok_and(|(value, _)| value != "y")
    };
    if machine.kernel_version().unwrap_or_default() >= (6, 12) && is_without_groups() {
        let read =
            format!("{read}, which since Linux 6.12 limits no such thread: see `fair-server`");
        return Ok(Seen::good(read, from));
    }
    let off = "sysctl -w kernel.sched_rt_runtime_us=-1";
    Ok(match runtime {
        0 => Seen::bad(read, from, format!("`{off}`, or at least 950000")),
        // Nine tenths and more: the usual safety net.
        _ if u128::from(runtime) * 10 >= u128::from(period_us) * 9 => Seen::better(
            read,
            from,
            format!(
                "keep it while developing, as a net below loops that spin; on a finished machine `{off}`"
            ),
        ),
        _ => Seen::bad(read, from, format!("`{off}`, or at least 950000")),
    })
}

fn fair_server(machine: &Machine) -> Result<Seen, Unread> {
    let version = "/proc/sys/kernel/osrelease";
    if machine.kernel_version()? < (6, 12) {
        return Ok(Seen::good("none before Linux 6.12", version));
    }
    let from = format!(
        "/sys/kernel/debug/sched/fair_server/cpu{}/runtime",
        machine.core
    );
    let runtime = machine.source.parse(&from, number)?;
    Ok(match runtime {
        0 => Seen::good("off", from),
        runtime => Seen::better(
            format!("{} ms of each second for others", runtime / 1_000_000),
            from.clone(),
            format!("keep it while developing; on a finished machine `echo 0 > {from}`"),
        ),
    })
}

fn group_budget(machine: &Machine) -> Result<Seen, Unread> {
    let source = &machine.source;
    let groups = source.read(GROUPS)?;
    if let Some(group) = group_one(&groups, "cpu") {
        let mount = source.parse("/proc/self/mounts", |mounts| {
            Some(mount_of_one(mounts, "cpu")?.to_owned())
        })?;
        let budget = file(&mount, group, "cpu.rt_runtime_us");
        return Ok(match source.parse(&budget, number) {
            Ok(0) => Seen::bad(
                "0: none",
                budget.clone(),
                format!("`echo 950000 > {budget}`, after the same for the groups above it"),
            ),
            Ok(runtime) => Seen::good(format!("{runtime} us of each period"), budget),
            Err(Unread {
                reason: UnreadReason::Missing,
                ..
            }) => Seen::good(
                "not needed: the kernel does not group real-time threads",
                budget,
            ),
            Err(unread) => return Err(unread),
        });
    }
    let group = group_two(&groups).ok_or_else(|| Unread::new(GROUPS, UnreadReason::Malformed))?;
    if group == "/" {
        return Ok(Seen::good("not needed in the root group", GROUPS));
    }
    if command_line::value(
        &machine.command_line().unwrap_or_default(),
        "rt_group_sched",
    ) == Some("0")
    {
        return Ok(Seen::good("not needed: rt_group_sched=0", "/proc/cmdline"));
    }
    let (value, from) = machine.option("CONFIG_RT_GROUP_SCHED")?;
    Ok(match value.as_str() {
        "y" => Seen::bad(
            format!("none, and none to be had, in the group {group} (CONFIG_RT_GROUP_SCHED=y)"),
            from,
            "boot with rt_group_sched=0, or start the program in the root group (`echo PID > /sys/fs/cgroup/cgroup.procs`)",
        ),
        _ => Seen::good(
            "not needed: the kernel does not group real-time threads",
            from,
        ),
    })
}

fn quota(machine: &Machine) -> Result<Seen, Unread> {
    let source = &machine.source;
    let groups = source.read(GROUPS)?;
    let mounts = source.read("/proc/self/mounts")?;
    let advice = |quota: &str| {
        format!(
            "take it away (`{quota}`; in a container: start it without --cpus), or give every executor a real-time policy"
        )
    };
    if let (Some(group), Some(mount)) = (group_one(&groups, "cpu"), mount_of_one(&mounts, "cpu")) {
        let from = file(mount, group, "cpu.cfs_quota_us");
        let quota = missing_is(source.parse(&from, number), -1)?;
        return Ok(match quota {
            ..0 => Seen::good("none", from),
            quota => Seen::better(
                format!("{quota} us a period"),
                from.clone(),
                advice(&format!("echo -1 > {from}")),
            ),
        });
    }
    let (Some(group), Some(mount)) = (group_two(&groups), mount_of_two(&mounts)) else {
        return Ok(Seen::good("none: no group with the cpu controller", GROUPS));
    };
    let from = file(mount, group, "cpu.max");
    // The root group has no such file.
    let quota = missing_is(source.word(&from), "max".to_owned())?;
    Ok(match quota.split_whitespace().next() {
        Some("max") => Seen::good("none", from),
        _ => Seen::better(
            format!("{quota} (us of each period)"),
            from.clone(),
            advice(&format!("echo max > {from}")),
        ),
    })
}

fn autogroup(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/sys/kernel/sched_autogroup_enabled";
    better_off(
        machine,
        from,
        "`sysctl -w kernel.sched_autogroup_enabled=0`",
    )
}

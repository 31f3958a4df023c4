//! The cores: which may be used, and what else runs on the real-time one.

use crate::doctor::facts::interrupts::core_mask;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::{Machine, missing_is};
use luna_machine::facts::Unread;
use luna_machine::facts::parse::{core_list, write_core_list};

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "cores",
        why: "real-time executors want a core of their own beside one for everybody else",
        otherwise: "run `nproc` and `taskset -p $$`",
        look: cores,
    },
    Check {
        name: "isolated-cores",
        why: "the scheduler keeps ordinary threads off an isolated core, so its caches and its time are the executors'",
        otherwise: "run `cat /sys/devices/system/cpu/isolated`",
        look: isolated,
    },
    Check {
        name: "tickless-cores",
        why: "a core under nohz_full has no periodic tick while one thread runs there",
        otherwise: "run `cat /sys/devices/system/cpu/nohz_full`",
        look: tickless,
    },
    Check {
        name: "rcu-callbacks",
        why: "the kernel's deferred work (RCU) runs in bursts on the core that made it, unless it is moved away",
        otherwise: "run `grep -o 'rcu_nocbs=[^ ]*' /proc/cmdline`",
        look: rcu_callbacks,
    },
    Check {
        name: "kernel-workers",
        why: "the kernel's unbound work items run on any core that this mask allows",
        otherwise: "run `cat /sys/devices/virtual/workqueue/cpumask`",
        look: workers,
    },
    Check {
        name: "smt",
        why: "a sibling thread shares the core's units and slows it at any moment",
        otherwise: "run `lscpu --extended`",
        look: smt,
    },
];

/// Where kernel parameters go.
const GRUB: &str = "(GRUB_CMDLINE_LINUX in /etc/default/grub, then `update-grub`, then boot)";

fn cores(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/self/status";
    let allowed = machine.allowed()?;
    let core = machine.core;
    let read = format!(
        "{} may be used, {core} for real time",
        write_core_list(&allowed)
    );
    if !allowed.contains(&core) && !machine.isolated().unwrap_or_default().contains(&core) {
        return Ok(Seen::bad(
            format!("{} may be used, not {core}", write_core_list(&allowed)),
            from,
            format!(
                "add {core} to the group's cpuset.cpus (in a container: --cpuset-cpus), or ask for another with --core"
            ),
        ));
    }
    Ok(match allowed.len() {
        1 => Seen::better(
            format!("{core} alone may be used"),
            from,
            "give the machine or the container a second core: everything else then leaves the first to LUNA",
        ),
        _ => Seen::good(read, from),
    })
}

fn isolated(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/sys/devices/system/cpu/isolated";
    let isolated = machine.isolated()?;
    let core = machine.core;
    if isolated.contains(&core) {
        return Ok(Seen::good(write_core_list(&isolated), from));
    }
    let read = match isolated.is_empty() {
        true => "none".to_owned(),
        false => format!("{}, not {core}", write_core_list(&isolated)),
    };
    Ok(Seen::better(
        read,
        from,
        format!(
            "boot with isolcpus=managed_irq,domain,{core} {GRUB}; or without booting: `systemctl set-property --runtime user.slice \
             AllowedCPUs={others}`, and the same for system.slice",
            others = machine.other_cores()
        ),
    ))
}

fn tickless(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/sys/devices/system/cpu/nohz_full";
    let tickless = machine.tickless()?;
    let core = machine.core;
    if tickless.contains(&core) {
        return Ok(Seen::good(write_core_list(&tickless), from));
    }
    // The file is there if the kernel can do it, unless a container hides it.
    let can = match machine.source.has(from) {
        true => Some(true),
        false => {
            let option = machine.option("CONFIG_NO_HZ_FULL").ok();
            option.map(|(value, _)| value == "y")
        }
    };
    let read = match (can, tickless.is_empty()) {
        (Some(false), _) => "none: the kernel has no CONFIG_NO_HZ_FULL".to_owned(),
        (_, true) => "none".to_owned(),
        (_, false) => format!("{}, not {core}", write_core_list(&tickless)),
    };
    let kernel = match can {
        Some(true) => "",
        Some(false) => "a kernel that has CONFIG_NO_HZ_FULL=y ",
        None => "(where the kernel has CONFIG_NO_HZ_FULL) ",
    };
    Ok(Seen::better(
        read,
        from,
        format!("boot {kernel}with nohz_full={core} {GRUB}"),
    ))
}

fn rcu_callbacks(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/cmdline";
    let moved = machine.booted_with("rcu_nocbs")?;
    let core = machine.core;
    // A core under nohz_full has its callbacks moved too.
    if machine.tickless().unwrap_or_default().contains(&core) {
        return Ok(Seen::good(
            format!("moved off core {core}, by nohz_full"),
            "/sys/devices/system/cpu/nohz_full",
        ));
    }
    Ok(match moved.contains(&core) {
        true => Seen::good(format!("moved off {}", write_core_list(&moved)), from),
        false => Seen::better(
            format!("run on core {core} too"),
            from,
            format!("boot with rcu_nocbs={core} {GRUB}"),
        ),
    })
}

fn workers(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/sys/devices/virtual/workqueue/cpumask";
    let cores = machine.source.parse(from, core_mask)?;
    let core = machine.core;
    Ok(match cores.contains(&core) {
        false => Seen::good(format!("on {}", write_core_list(&cores)), from),
        true => Seen::better(
            format!("on {}, so on core {core} too", write_core_list(&cores)),
            from,
            format!(
                "write a mask without core {core}: `echo {} > {from}`",
                mask_without(&cores, core)
            ),
        ),
    })
}

/// The cores without one, as the kernel writes masks; `1` if none is left, since a mask must have a
/// core.
pub(super) fn mask_without(cores: &[usize], without: usize) -> String {
    let last = cores.iter().copied().max().unwrap_or(0);
    let mut groups = vec![0_u32; last / 32 + 1];
    for core in cores.iter().filter(|core| **core != without) {
        groups[core / 32] |= 1 << (core % 32);
    }
    while groups.len() > 1 && groups.last() == Some(&0) {
        groups.pop();
    }
    if groups == [0] {
        return "1".to_owned();
    }
    let mut highest_first = groups.iter().rev();
    let first = highest_first.next().map(|group| format!("{group:x}"));
    let rest = highest_first.map(|group| format!("{group:08x}"));
    first.into_iter().chain(rest).collect::<Vec<_>>().join(",")
}

fn smt(machine: &Machine) -> Result<Seen, Unread> {
    let core = machine.core;
    let from = format!("/sys/devices/system/cpu/cpu{core}/topology/thread_siblings_list");
    // A machine with one thread a core may have no such file, but this file shows it.
    let active = machine.source.word("/sys/devices/system/cpu/smt/active");
    if active.as_deref() == Ok("0") {
        return Ok(Seen::good("off", "/sys/devices/system/cpu/smt/active"));
    }
    let mut siblings = missing_is(machine.source.parse(&from, core_list), vec![core])?;
    siblings.retain(|sibling| *sibling != core);
    if siblings.is_empty() {
        return Ok(Seen::good(format!("core {core} has no sibling"), from));
    }
    let siblings = write_core_list(&siblings);
    Ok(Seen::better(
        format!("on: core {core} shares its units with {siblings}"),
        from,
        format!(
            "`echo off > /sys/devices/system/cpu/smt/control` (or boot with nosmt), or switch the sibling off alone: `echo 0 > \
             /sys/devices/system/cpu/cpu{siblings}/online`"
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_without_a_core() {
        for (cores, without, mask) in [
            (&[0, 1][..], 1, "1"),
            (&[0, 1], 0, "2"),
            (&[0, 1, 2, 3], 2, "b"),
            (&[5], 5, "1"),
            (&[], 5, "1"),
            (&[0, 32, 33], 33, "1,00000001"),
            (&[0, 63], 63, "1"),
        ] {
            assert_eq!(mask_without(cores, without), mask, "{cores:?}");
        }
    }
}

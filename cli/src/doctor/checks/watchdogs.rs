//! The kernel's own watchdogs, which interrupt every core that they watch.

use super::better_off;
use crate::doctor::facts::number;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::{Machine, missing_is};
use luna_machine::facts::Unread;
use luna_machine::facts::parse::core_list;

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "nmi-watchdog",
        why: "it interrupts a core now and then in a way that nothing can hold off",
        otherwise: "run `sysctl kernel.nmi_watchdog`",
        look: nmi,
    },
    Check {
        name: "lockup-watchdog",
        why: "it wakes a thread of the highest priority on each core that it watches, every few seconds",
        otherwise: "run `sysctl kernel.watchdog kernel.watchdog_cpumask`",
        look: lockup,
    },
];

fn nmi(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/sys/kernel/nmi_watchdog";
    let advice = "`sysctl -w kernel.nmi_watchdog=0`, or boot with nmi_watchdog=0";
    better_off(machine, from, advice)
}

fn lockup(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/sys/kernel/watchdog";
    let mask = "/proc/sys/kernel/watchdog_cpumask";
    let core = machine.core;
    if missing_is(machine.source.parse(from, number), 0)? == 0 {
        return Ok(Seen::good("off", from));
    }
    // Without a mask it watches all.
    let watched = machine.source.parse(mask, core_list);
    Ok(match watched.is_ok_and(|cores| !cores.contains(&core)) {
        true => Seen::good(format!("on, but not on core {core}"), mask),
        false => Seen::better(
            format!("on, also on core {core}"),
            from,
            format!(
                "`sysctl -w kernel.watchdog_cpumask={}`, or boot with nowatchdog",
                machine.other_cores()
            ),
        ),
    })
}

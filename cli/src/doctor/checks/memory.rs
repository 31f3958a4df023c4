//! Memory: what could make a thread wait for a page.

use super::better_off;
use super::permissions::can_lock_memory;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna_machine::facts::Unread;

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "swap",
        why: "a page that was swapped out costs milliseconds when it is touched; locked memory never is",
        otherwise: "run `swapon --show`",
        look: swap,
    },
    Check {
        name: "huge-pages",
        why: "with `always` the kernel gathers pages into huge ones behind a program's back, and threads wait meanwhile",
        otherwise: "run `cat /sys/kernel/mm/transparent_hugepage/enabled`",
        look: huge_pages,
    },
    Check {
        name: "numa-balancing",
        why: "the kernel takes pages away for a moment to see which processes use them: page faults in locked memory too",
        otherwise: "run `sysctl kernel.numa_balancing`",
        look: numa_balancing,
    },
];

fn swap(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/swaps";
    let text = machine.source.read(from)?;
    let areas: Vec<_> = text
        .lines()
        .skip(1)
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    if areas.is_empty() {
        return Ok(Seen::good("none", from));
    }
    let read = areas.join(", ");
    Ok(match can_lock_memory(machine)? {
        (true, ..) => Seen::better(
            format!("{read}; this program may lock its memory"),
            from,
            "call `System::lock_memory`; or `swapoff -a`, and take it out of /etc/fstab",
        ),
        (false, ..) => Seen::bad(
            format!("{read}; and this program may not lock its memory"),
            from,
            "`swapoff -a`, or see `locked-memory`",
        ),
    })
}

fn huge_pages(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/sys/kernel/mm/transparent_hugepage/enabled";
    let chosen = machine.source.parse(from, |text| {
        let chosen = text
            .split_whitespace()
            .find_map(|word| word.strip_prefix('[')?.strip_suffix(']'));
        chosen.map(str::to_owned)
    })?;
    Ok(match chosen.as_str() {
        "always" => Seen::better(
            chosen,
            from,
            format!("`echo madvise > {from}`, or boot with transparent_hugepage=madvise"),
        ),
        _ => Seen::good(chosen, from),
    })
}

fn numa_balancing(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/sys/kernel/numa_balancing";
    better_off(machine, from, "`sysctl -w kernel.numa_balancing=0`")
}

//! The clock, and how exactly threads sleep by it.

use crate::doctor::facts::number;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna_machine::counter::Counter;
use luna_machine::facts::Unread;

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "clock-source",
        why: "a loop reads the clock several times a cycle: from the processor in tens of nanoseconds, from a device in microseconds",
        otherwise: "run `cat /sys/devices/system/clocksource/clocksource0/current_clocksource`",
        look: source,
    },
    Check {
        name: "timer-slack",
        why: "Linux adds it to the sleeps of ordinary threads; LUNA sets 1 ns on each thread that it makes",
        otherwise: "run `cat /proc/self/timerslack_ns`",
        look: slack,
    },
];

fn source(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    let clock = machine.source.word(from)?;
    let slow = "boot with clocksource=tsc tsc=reliable if the processor has an invariant TSC (`grep nonstop_tsc /proc/cpuinfo`), on Arm \
                with clocksource=arch_sys_counter; `dmesg | grep -i clocksource` says why the kernel left it";
    Ok(match clock.as_str() {
        "arch_sys_counter" => Seen::good(clock + &frequency(machine), from),
        "tsc" | "riscv_clocksource" | "timebase" | "stp" => Seen::good(clock, from),
        "kvm-clock" | "hyperv_clocksource_tsc_page" | "xen" => Seen::better(
            format!("{clock}: the hypervisor's, scaled with each reading"),
            from,
            "boot with clocksource=tsc if the host offers an invariant TSC (`grep nonstop_tsc /proc/cpuinfo`)",
        ),
        "hpet" | "acpi_pm" | "pit" | "jiffies" | "refined-jiffies" => Seen::bad(
            format!("{clock}: a system call and a device for each reading"),
            from,
            slow,
        ),
        _ => Seen::unknown(
            clock,
            from,
            "see under `clock-read` what reading it costs: more than 100 ns is too much",
        ),
    })
}

/// That of this machine's counter, where it says so: no file has it.
fn frequency(machine: &Machine) -> String {
    let counter = machine.source.is_machine().then(Counter::of_machine);
    let frequency = counter.flatten().and_then(Counter::ticks_per_second);
    frequency.map_or_else(String::new, |frequency| {
        let frequency = frequency as f64;
        let tick = 1e9 / frequency;
        format!(", {:.1} MHz: {tick:.1} ns a tick", frequency / 1e6)
    })
}

fn slack(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/self/timerslack_ns";
    let slack = machine.source.parse(from, number)?;
    Ok(Seen::good(
        format!("{slack} ns for this program, 1 ns for LUNA's threads"),
        from,
    ))
}

//! The kernel: which, how it preempts, how finely it keeps time.

use crate::doctor::facts::{command_line, config};
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna_machine::facts::{PreemptionModel, Unread};

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "kernel-version",
        why: "5.14 has the futex operation that LUNA's lock is made for; 6.12 has PREEMPT_RT without a patch",
        otherwise: "run `uname -r`",
        look: version,
    },
    Check {
        name: "preemption",
        why: "what runs in the kernel holds up a real-time thread until the kernel lets itself be preempted",
        otherwise: "run `uname -v` and look for PREEMPT",
        look: preemption,
    },
    Check {
        name: "timer-resolution",
        why: "without high-resolution timers every wake-up waits for the next tick: milliseconds",
        otherwise: "run `grep HIGH_RES_TIMERS /boot/config-$(uname -r)`",
        look: resolution,
    },
    Check {
        name: "tick",
        why: "each tick takes a core for some microseconds; wake-ups do not depend on it",
        otherwise: "run `zgrep CONFIG_HZ= /proc/config.gz`",
        look: tick,
    },
];

fn version(machine: &Machine) -> Result<Seen, Unread> {
    let version = machine.kernel_version()?;
    let from = "/proc/sys/kernel/osrelease";
    let release = machine.source.word(from)?;
    Ok(match version {
        (5, 14..) | (6.., _) => Seen::good(release, from),
        (4.., _) => Seen::better(
            release,
            from,
            "install a kernel of 5.14 or later, best 6.12 or later",
        ),
        _ => Seen::bad(
            release,
            from,
            "install a kernel of 5.14 or later, best 6.12 or later",
        ),
    })
}

fn preemption(machine: &Machine) -> Result<Seen, Unread> {
    let (model, from) = effective_preemption(machine)?;
    let install = "install a PREEMPT_RT kernel (Debian: `apt install linux-image-rt-amd64`, on Arm `linux-image-rt-arm64`; Ubuntu: `pro enable realtime-kernel`; \
                   your own: CONFIG_PREEMPT_RT=y)";
    let is_of_the_boot = from.contains("config") || from == "/proc/cmdline";
    let since = match is_of_the_boot {
        true => ", by what it booted with; whether root has changed it since cannot be read",
        false => "",
    };
    Ok(match model {
        PreemptionModel::RealTime => Seen::good("PREEMPT_RT", from),
        PreemptionModel::Dynamic => Seen::unknown(
            "chosen at the boot, not PREEMPT_RT; no file that this user may read says which",
            from,
            format!(
                "run `sudo cat /sys/kernel/debug/sched/preempt`; or {install}, or boot with preempt=full"
            ),
        ),
        PreemptionModel::Full => {
            Seen::better(format!("full, not PREEMPT_RT{since}"), from, install)
        }
        PreemptionModel::Lazy => Seen::better(
            format!("{model}, not PREEMPT_RT{since}"),
            from,
            format!("{install}; until then boot with preempt=full"),
        ),
        _ => Seen::bad(
            format!("{model}{since}"),
            from,
            format!(
                "{install}; until then boot with preempt=full, where the kernel has CONFIG_PREEMPT_DYNAMIC"
            ),
        ),
    })
}

/// The model in effect and the file that says so. Where the kernel hides which one it has chosen,
/// that is the one that it was built to boot with.
fn effective_preemption(machine: &Machine) -> Result<(PreemptionModel, String), Unread> {
    let (model, file) = PreemptionModel::read_with_file(&machine.source)?;
    // Without its command line it is not known whether it asked for another one.
    if model == PreemptionModel::Dynamic
        && machine.command_line().is_ok()
        && let Ok((text, file)) = machine.config()
        && let Some(model) = config::preemption(&text)
    {
        return Ok((model, file));
    }
    Ok((model, file.to_owned()))
}

fn resolution(machine: &Machine) -> Result<Seen, Unread> {
    let advice = "boot without highres=off, with a kernel that has CONFIG_HIGH_RES_TIMERS=y; a clock source that is no `tsc` may be the cause too";
    if let Some(clock) = machine.clock {
        let from = "clock_getres(CLOCK_MONOTONIC)";
        let read = format!("{} ns", clock.timer_ns);
        return Ok(match clock.timer_ns {
            1 => Seen::good(read, from),
            _ => Seen::bad(read, from, advice),
        });
    }
    if command_line::value(&machine.command_line().unwrap_or_default(), "highres") == Some("off") {
        return Ok(Seen::bad("highres=off", "/proc/cmdline", advice));
    }
    let (value, from) = machine.option("CONFIG_HIGH_RES_TIMERS")?;
    let read = format!("CONFIG_HIGH_RES_TIMERS={value}");
    Ok(match value.as_str() {
        "y" => Seen::good(read, from),
        _ => Seen::bad(read, from, advice),
    })
}

fn tick(machine: &Machine) -> Result<Seen, Unread> {
    let (hertz, from) = match machine.clock {
        Some(clock) => (
            1_000_000_000 / clock.tick_ns.max(1),
            "clock_getres(CLOCK_MONOTONIC_COARSE)".to_owned(),
        ),
        None => {
            let (value, from) = machine.option("CONFIG_HZ")?;
            let Ok(hertz) = value.parse() else {
                return Ok(Seen::unknown(
                    format!("CONFIG_HZ={value}"),
                    from,
                    "see CONFIG_HZ in the kernel's configuration",
                ));
            };
            (hertz, from)
        }
    };
    let core = machine.core;
    let tickless = machine.tickless().unwrap_or_default().contains(&core);
    Ok(match hertz {
        1000.. if !tickless => Seen::better(
            format!("{hertz} Hz, also on core {core}"),
            from,
            format!("boot with nohz_full={core}, or a kernel with CONFIG_HZ=250 or less"),
        ),
        _ if tickless => Seen::good(
            format!("{hertz} Hz, but not on core {core} while it runs one thread"),
            from,
        ),
        _ => Seen::good(format!("{hertz} Hz"), from),
    })
}

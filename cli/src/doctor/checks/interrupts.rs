//! Interrupts: which go to the real-time core, and which handler they have.

use super::cores::mask_without;
use crate::doctor::facts::command_line;
use crate::doctor::facts::interrupts::{core_mask, interrupts};
use crate::doctor::facts::task::scheduling;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna_machine::facts::parse::{core_list, write_core_list};
use luna_machine::facts::task::field;
use luna_machine::facts::{PreemptionModel, Unread, UnreadReason};

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "default-irq-affinity",
        why: "interrupts of devices that come later go to the cores of this mask",
        otherwise: "run `cat /proc/irq/default_smp_affinity`",
        look: default_affinity,
    },
    Check {
        name: "irqs-on-core",
        why: "the handler of a device's interrupt comes before every thread of its core",
        otherwise: "run `cat /proc/interrupts`",
        look: on_core,
    },
    Check {
        name: "irqbalance",
        why: "it moves interrupts between cores while the machine runs, onto the real-time one too",
        otherwise: "run `pidof irqbalance`",
        look: irqbalance,
    },
    Check {
        name: "irq-threads",
        why: "handlers that are threads (SCHED_FIFO 50) wait for executors above them; others come before everything",
        otherwise: "run `uname -v` and `cat /proc/cmdline`",
        look: threads,
    },
    Check {
        name: "ksoftirqd",
        why: "the core's deferred interrupt work should not come before real-time threads",
        otherwise: "run `ps -eLo rtprio,psr,comm | grep ksoftirqd`, outside of a container",
        look: ksoftirqd,
    },
];

fn default_affinity(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/irq/default_smp_affinity";
    let mut cores = machine.source.parse(from, core_mask)?;
    // The mask may have bits for cores that could be plugged in.
    if let Ok(online) = machine.online() {
        cores.retain(|core| online.contains(core));
    }
    let core = machine.core;
    Ok(match cores.contains(&core) {
        false => Seen::good(format!("to {}", write_core_list(&cores)), from),
        true => Seen::better(
            format!("to {}, so to core {core} too", write_core_list(&cores)),
            from,
            format!(
                "`echo {} > {from}`, or boot with irqaffinity={}",
                mask_without(&cores, core),
                machine.other_cores()
            ),
        ),
    })
}

/// How many interrupts are named; the rest is counted.
const NAMED: usize = 4;

fn on_core(machine: &Machine) -> Result<Seen, Unread> {
    let from = "/proc/interrupts";
    let core = machine.core;
    let all = machine.source.parse(from, interrupts)?;
    let of_devices = all.iter().filter(|interrupt| interrupt.is_of_a_device());
    // Those that came to the core, and may come there again.
    let mut here: Vec<_> = of_devices
        .filter(|interrupt| interrupt.on(core) > 0)
        .filter(|interrupt| {
            let affinity = |file: &str| {
                let file = format!("/proc/irq/{}/{file}", interrupt.id);
                machine.source.parse(&file, core_list)
            };
            let cores = affinity("effective_affinity_list")
                .ok()
                .filter(|cores| !cores.is_empty());
            cores
                .or_else(|| affinity("smp_affinity_list").ok())
                .is_none_or(|cores| cores.contains(&core))
        })
        .collect();
    if here.is_empty() {
        return Ok(Seen::good(
            format!("none of a device comes to core {core}"),
            from,
        ));
    }
    here.sort_by_key(|interrupt| std::cmp::Reverse(interrupt.on(core)));
    let named: Vec<_> = here
        .iter()
        .take(NAMED)
        .map(|interrupt| {
            let device = interrupt.name.split(' ').next_back().unwrap_or_default();
            format!("{} ({device}, {} times)", interrupt.id, interrupt.on(core))
        })
        .collect();
    let more = match here.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let numbers: Vec<_> = here.iter().map(|interrupt| interrupt.id.as_str()).collect();
    Ok(Seen::better(
        format!("on core {core}: {}{more}", named.join(", ")),
        from,
        format!(
            "for n in {}; do echo {} > /proc/irq/$n/smp_affinity_list; done (one that the kernel manages refuses: boot with \
             isolcpus=managed_irq,domain,{core})",
            numbers.join(" "),
            machine.other_cores()
        ),
    ))
}

fn irqbalance(machine: &Machine) -> Result<Seen, Unread> {
    let running = machine.processes_called("irqbalance")?;
    Ok(match running.first() {
        None => Seen::good("not seen", "/proc/*/comm"),
        Some(number) => Seen::better(
            "runs",
            format!("/proc/{number}/comm"),
            format!(
                "`systemctl disable --now irqbalance`, or IRQBALANCE_BANNED_CPULIST={} in /etc/default/irqbalance",
                machine.core
            ),
        ),
    })
}

fn threads(machine: &Machine) -> Result<Seen, Unread> {
    if PreemptionModel::read(&machine.source)? == PreemptionModel::RealTime {
        let here = threads_on_core(machine);
        let read = match here.is_empty() {
            true => "all handlers are threads (PREEMPT_RT)".to_owned(),
            false => format!(
                "all handlers are threads (PREEMPT_RT). On core {}, below executors of a higher priority: {}",
                machine.core,
                here.join(", ")
            ),
        };
        return Ok(Seen::good(read, "/proc/sys/kernel/version"));
    }
    let from = "/proc/cmdline";
    Ok(
        match command_line::has(&machine.command_line()?, "threadirqs") {
            true => Seen::good("handlers are threads (threadirqs)", from),
            false => Seen::better(
                "handlers are no threads",
                from,
                "boot with threadirqs, or with a PREEMPT_RT kernel",
            ),
        },
    )
}

/// The handlers that may run on the real-time core: name, priority and number of each.
fn threads_on_core(machine: &Machine) -> Vec<String> {
    let source = &machine.source;
    let numbers = source.list("/proc").unwrap_or_default();
    let handlers = numbers.iter().filter_map(|number| {
        let name = source.word(&format!("/proc/{number}/comm")).ok()?;
        let name = name.strip_prefix("irq/")?;
        let status = format!("/proc/{number}/status");
        let cores = |text: &str| core_list(field(text, "Cpus_allowed_list")?);
        let cores = source.parse(&status, cores).ok()?;
        let stat = format!("/proc/{number}/stat");
        let priority = source.parse(&stat, scheduling).ok()?;
        let priority = priority.own_real_time_priority;
        let here = cores.contains(&machine.core);
        here.then(|| format!("irq/{name} (SCHED_FIFO {priority}, PID {number})"))
    });
    handlers.take(NAMED).collect()
}

fn ksoftirqd(machine: &Machine) -> Result<Seen, Unread> {
    let name = format!("ksoftirqd/{}", machine.core);
    let Some(number) = machine.processes_called(&name)?.into_iter().next() else {
        return Err(Unread::new(
            &format!("/proc/*/comm with {name}"),
            UnreadReason::Missing,
        ));
    };
    let from = format!("/proc/{number}/stat");
    let scheduling = machine.source.parse(&from, scheduling)?;
    Ok(match scheduling.own_real_time_priority {
        0 => Seen::good(format!("{name} is an ordinary thread"), from),
        priority => Seen::better(
            format!("{name} is a real-time thread of priority {priority}"),
            from,
            format!(
                "`chrt --other --pid 0 {number}`, or give executors priorities above {priority}"
            ),
        ),
    })
}

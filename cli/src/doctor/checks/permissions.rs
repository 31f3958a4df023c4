//! What this process may do: policies, locked memory, time.

use crate::doctor::facts::task::{Limit, soft_limit};
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna::Policy;
use luna::report::Shortfall;
use luna_machine::facts::Unread;
use luna_machine::facts::task::{
    CAP_IPC_LOCK, CAP_SYS_NICE, has_capability, is_first_user_namespace,
};
use luna_machine::shortfall::{Means, MemoryRefusal, PolicyRefusal};

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "real-time-policy",
        why: "without SCHED_FIFO any program can take the core for milliseconds",
        otherwise: "run `ulimit -r` and `capsh --print`",
        look: policy,
    },
    Check {
        name: "locked-memory",
        why: "a page that has to be fetched costs microseconds, or milliseconds from a disk",
        otherwise: "run `ulimit -l` and `capsh --print`",
        look: locked_memory,
    },
    Check {
        name: "real-time-cpu-limit",
        why: "the kernel kills a real-time process that runs longer than this without sleeping",
        otherwise: "run `ulimit -R` (bash 5.1)",
        look: cpu_limit,
    },
];

const LIMITS: &str = "/proc/self/limits";
const STATUS: &str = "/proc/self/status";

/// Whether a capability is in effect where it counts: outside of user namespaces.
fn capable(machine: &Machine, bit: u32) -> Result<bool, Unread> {
    let effective = machine
        .source
        .parse(STATUS, |status| has_capability(status, bit))?;
    // Where the map cannot be read there are no such namespaces.
    let first = machine.source.read("/proc/self/uid_map");
    Ok(effective && first.is_ok_and(|map| is_first_user_namespace(&map)))
}

/// What a program on that machine has to get privileges with.
pub(super) fn means(machine: &Machine) -> Means {
    let status = machine.source.read(STATUS);
    status.map_or(Means::default(), |status| Means::of(&status))
}

fn limit(machine: &Machine, name: &str) -> Result<Limit, Unread> {
    machine.source.parse(LIMITS, |text| soft_limit(text, name))
}

fn policy(machine: &Machine) -> Result<Seen, Unread> {
    let capable = capable(machine, CAP_SYS_NICE);
    if capable == Ok(true) {
        return Ok(Seen::good("any policy and priority (CAP_SYS_NICE)", STATUS));
    }
    let limit = limit(machine, "Max realtime priority")?;
    let read = format!("RLIMIT_RTPRIO {limit}, without CAP_SYS_NICE");
    let remedy = |limit| {
        // The emergency thread's, the highest that LUNA asks for.
        let asked = Policy::Fifo(99);
        let why = PolicyRefusal::NotPermitted { limit };
        Shortfall::Policy { asked, why }.remedy_with(means(machine))
    };
    Ok(match limit {
        Limit::Unlimited | Limit::AtMost(99..) => Seen::good(read, LIMITS),
        Limit::AtMost(0) => Seen::bad(read, LIMITS, remedy(Some(0))),
        Limit::AtMost(most) => Seen::better(
            format!("{read}: the emergency thread wants 99"),
            LIMITS,
            remedy(Some(most)),
        ),
    })
}

/// Whether all memory can be locked, the limit, and the file that has it.
pub(super) fn can_lock_memory(machine: &Machine) -> Result<(bool, String, &'static str), Unread> {
    if capable(machine, CAP_IPC_LOCK) == Ok(true) {
        return Ok((true, "any amount (CAP_IPC_LOCK)".to_owned(), STATUS));
    }
    let limit = limit(machine, "Max locked memory")?;
    let unit = match limit {
        Limit::Unlimited => "",
        Limit::AtMost(_) => " bytes",
    };
    let read = format!("RLIMIT_MEMLOCK {limit}{unit}, without CAP_IPC_LOCK");
    Ok((limit == Limit::Unlimited, read, LIMITS))
}

fn locked_memory(machine: &Machine) -> Result<Seen, Unread> {
    let (can, read, from) = can_lock_memory(machine)?;
    let refused = Shortfall::MemoryLock(MemoryRefusal::Limited { limit: None });
    let remedy = || refused.remedy_with(means(machine));
    Ok(match can {
        true => Seen::good(read, from),
        false => Seen::bad(read, from, remedy()),
    })
}

fn cpu_limit(machine: &Machine) -> Result<Seen, Unread> {
    Ok(match limit(machine, "Max realtime timeout")? {
        Limit::Unlimited => Seen::good("none (RLIMIT_RTTIME)", LIMITS),
        Limit::AtMost(most) => Seen::better(
            format!("{most} µs (RLIMIT_RTTIME)"),
            LIMITS,
            "`ulimit -R unlimited` before the program, or systemd's LimitRTTIME=infinity; keep it if your processes never compute \
             that long at a stretch",
        ),
    })
}

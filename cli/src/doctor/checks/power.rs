//! Power: how fast the core is, and how deeply it sleeps.

use crate::doctor::facts::number;
use crate::doctor::finding::{Check, Seen};
use crate::doctor::machine::Machine;
use luna::report::Shortfall;
use luna_machine::facts::{Source, Unread, UnreadReason};
use luna_machine::shortfall::LatencyRefusal;

pub(super) const CHECKS: &[Check] = &[
    Check {
        name: "governor",
        why: "a core that is clocked down needs time to get up to speed, just when a loop wakes",
        otherwise: "in a virtual machine ask its host; else see whether the firmware fixes the frequency",
        look: governor,
    },
    Check {
        name: "turbo",
        why: "a frequency that depends on temperature and on the neighbours makes run times vary",
        otherwise: "in a virtual machine ask its host; else see the firmware's settings",
        look: turbo,
    },
    Check {
        name: "idle-states",
        why: "a core needs time to come back from a deep idle state: up to some hundred microseconds",
        otherwise: "in a virtual machine ask its host; else run `cpupower idle-info`",
        look: idle_states,
    },
    Check {
        name: "cpu-dma-latency",
        why: "while a real-time system runs, LUNA holds this device at 0, which keeps idle states short",
        otherwise: "run `ls -l /dev/cpu_dma_latency`",
        look: dma_latency,
    },
];

const DEVICE: &str = "/dev/cpu_dma_latency";

/// From which on coming back from an idle state is felt, in microseconds.
const SHORT_US: i64 = 10;

fn governor(machine: &Machine) -> Result<Seen, Unread> {
    let from = format!(
        "/sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor",
        machine.core
    );
    let governor = machine.source.word(&from)?;
    let read = format!("{governor}{}", frequency(machine));
    Ok(match governor.as_str() {
        "performance" => Seen::good(read, from),
        _ => Seen::better(
            read,
            from,
            "`cpupower frequency-set -g performance` (and cpufreq.default_governor=performance when it boots)",
        ),
    })
}

/// The core's frequency, and its highest, where both can be read.
fn frequency(machine: &Machine) -> String {
    let folder = format!("/sys/devices/system/cpu/cpu{}/cpufreq", machine.core);
    let mhz = |file: &str| {
        let khz = machine.source.parse(&format!("{folder}/{file}"), number);
        khz.ok().map(|khz| khz / 1000)
    };
    match (mhz("scaling_cur_freq"), mhz("cpuinfo_max_freq")) {
        (Some(now), Some(highest)) => format!(", at {now} of {highest} MHz"),
        _ => String::new(),
    }
}

fn turbo(machine: &Machine) -> Result<Seen, Unread> {
    let intel = "/sys/devices/system/cpu/intel_pstate/no_turbo";
    let others = "/sys/devices/system/cpu/cpufreq/boost";
    let (from, on, off) = match machine.source.parse(intel, number) {
        Ok(no_turbo) => (intel, no_turbo == 0, 1),
        Err(Unread {
            reason: UnreadReason::Missing,
            ..
        }) => (others, machine.source.parse(others, number)? != 0, 0),
        Err(unread) => return Err(unread),
    };
    Ok(match on {
        false => Seen::good("off", from),
        true => Seen::better(
            "on",
            from,
            format!("`echo {off} > {from}`, if even run times matter more than short ones"),
        ),
    })
}

/// An idle state that is in use.
struct State {
    name: String,
    latency_us: i64,
}

fn deepest(source: &Source, core: usize) -> Result<Option<State>, Unread> {
    let folder = format!("/sys/devices/system/cpu/cpu{core}/cpuidle");
    let names = source.list(&folder)?;
    let states = names.iter().filter(|name| name.starts_with("state"));
    let states = states.filter_map(|state| {
        let value = |name: &str| source.parse(&format!("{folder}/{state}/{name}"), number);
        let name = source.word(&format!("{folder}/{state}/name"));
        let used = value("disable") != Ok(1);
        let state = State {
            latency_us: value("latency").ok()?,
            name: name.unwrap_or_else(|_| state.clone()),
        };
        used.then_some(state)
    });
    Ok(states.max_by_key(|state| state.latency_us))
}

fn idle_states(machine: &Machine) -> Result<Seen, Unread> {
    let core = machine.core;
    let from = format!("/sys/devices/system/cpu/cpu{core}/cpuidle");
    let Some(State { name, latency_us }) = deepest(&machine.source, core)? else {
        return Ok(Seen::good("none in use", from));
    };
    let read = format!("down to {name}, which takes {latency_us} µs to leave");
    if latency_us <= SHORT_US {
        return Ok(Seen::good(read, from));
    }
    // A test of a driver's file, so that this and the finding on the device agree.
    if machine.source.may_write(DEVICE).is_ok() {
        return Ok(Seen::good(
            format!("{read}; LUNA keeps the core above it while it runs"),
            from,
        ));
    }
    Ok(Seen::better(
        read,
        from,
        format!(
            "let LUNA hold {DEVICE} (see there), or `cpupower -c {core} idle-set -D {SHORT_US}`, or boot with \
             processor.max_cstate=1 intel_idle.max_cstate=0"
        ),
    ))
}

fn dma_latency(machine: &Machine) -> Result<Seen, Unread> {
    let unread = match machine.source.may_write(DEVICE) {
        Ok(()) => return Ok(Seen::good("may be held at 0", DEVICE)),
        Err(unread) => unread,
    };
    let why = match unread.reason {
        UnreadReason::Missing => LatencyRefusal::Missing,
        UnreadReason::NotPermitted => LatencyRefusal::NotPermitted,
        _ => return Err(unread),
    };
    let shortfall = Shortfall::DmaLatency(why);
    let means = super::permissions::means(machine);
    Ok(Seen::better(
        shortfall.why(),
        DEVICE,
        shortfall.remedy_with(means),
    ))
}

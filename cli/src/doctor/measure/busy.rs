//! What still comes through while a thread of SCHED_FIFO never sleeps on the real-time core.
//!
//! On PREEMPT_RT the kernel does much in threads of low priority: a POSIX timer, a timerfd and the
//! timeout of an ordinary thread expire in `ktimers/N`, what interrupts leave to do is done in
//! `ksoftirqd/N`. A busy thread of a higher priority starves them.

use super::{AGAIN, MEASUREMENT, threads};
use crate::doctor::finding::{Finding, Part, Seen, Times};
use crate::doctor::machine::Machine;
use std::time::Duration;

#[cfg(all(target_os = "linux", not(luna_portable)))]
mod spell;
#[cfg(not(all(target_os = "linux", not(luna_portable))))]
mod spell {
    pub(super) fn run(_: usize) -> Result<super::Spell, String> {
        Err("it is measured on Linux alone".to_owned())
    }
}

/// How long the thread is busy at a time: far less than what real-time threads may take at once.
const BUSY: Duration = Duration::from_millis(20);
/// From its beginning to what is to come through.
const AFTER: Duration = Duration::from_millis(5);
/// How often it is busy.
const SPELLS: u32 = 3;
/// If others had the core for longer, it was not the thread's alone. A host that takes the core
/// away does not count: it lets nothing through.
const LONGEST_WAIT: Duration = Duration::from_millis(2);
/// How often it is busy at most, if others had the core for longer.
const TRIES: u32 = 10;

/// What came through in one spell, and how late.
#[derive(Debug, Clone, Default)]
pub(super) struct Spell {
    /// Of the busy thread, as obtained.
    how: String,
    has_policy: bool,
    /// How long others had its core, as far as the kernel counts it.
    waited: Duration,
    /// In the order of [`WAYS`].
    late: [Option<Duration>; WAYS.len()],
}

/// Something that may come through.
struct Way {
    name: &'static str,
    what: &'static str,
    why: &'static str,
    /// What to do if it does not.
    advice: fn(&Machine) -> String,
    /// Without it no loop runs on such a core.
    is_needed: bool,
}

/// Indices of [`WAYS`].
const HARD: usize = 0;
const SOFT: usize = 1;
const SIGNAL: usize = 2;
const NETWORK: usize = 3;

const WAYS: [Way; 4] = [
    Way {
        name: "busy-hard-timer",
        what: "the sleep of a thread of a higher priority",
        why: "by such a sleep LUNA notices deadlines while an executor is busy",
        advice: |_| {
            "boot with highres=on, and see the findings above on timer-resolution and clock-source"
                .to_owned()
        },
        is_needed: true,
    },
    Way {
        name: "busy-soft-timer",
        what: "a timerfd armed on the core",
        why: "timerfds, POSIX timers and the timeouts of ordinary threads wait until the executor sleeps; LUNA uses none of them",
        advice: |machine| {
            format!(
                "for libraries that wait by them on this core: {}",
                // Before Linux 6.1 there is no thread for timers.
                raise(machine, &["ktimers", "ksoftirqd"])
            )
        },
        is_needed: false,
    },
    Way {
        name: "busy-signal",
        what: "a signal to the busy thread",
        why: "SIGTERM and crashes are noticed by signals",
        advice: |_| "report it: LUNA relies on it (CONTRIBUTING.md)".to_owned(),
        is_needed: true,
    },
    Way {
        name: "busy-network",
        what: "a packet over loopback, sent on the core",
        why: "a link on this core gets nothing until the executor sleeps",
        advice: |machine| {
            format!(
                "put links and the interrupts of network cards on {}, or {}",
                machine.other_cores(),
                raise(machine, &["ksoftirqd"])
            )
        },
        is_needed: false,
    },
];

/// A finding for each way. Takes 60 ms, and more on a machine whose cores are taken away.
pub(super) fn on(machine: &Machine) -> Vec<Finding> {
    let mut spells = Vec::new();
    let mut problem = None;
    for _ in 0..TRIES {
        if spells.len() == SPELLS as usize {
            break;
        }
        match spell::run(machine.core) {
            Ok(spell) if !spell.has_policy => {
                problem = Some(format!("{}: it needs SCHED_FIFO", spell.how));
                break;
            }
            Ok(spell) if spell.waited > LONGEST_WAIT => {
                problem = Some(format!(
                    "something else had the core for {:.1} ms",
                    spell.waited.as_secs_f64() * 1e3
                ));
            }
            Ok(spell) => spells.push(spell),
            Err(why) => {
                problem = Some(why);
                break;
            }
        }
    }
    let ways = WAYS.iter().enumerate();
    ways.map(|(number, way)| judge(way, number, &spells, problem.as_deref(), machine))
        .collect()
}

fn judge(
    way: &Way,
    number: usize,
    spells: &[Spell],
    problem: Option<&str>,
    machine: &Machine,
) -> Finding {
    let Some(first) = spells.first() else {
        let why = problem.unwrap_or("nothing was measured");
        let seen = Seen::unknown(why, MEASUREMENT, AGAIN);
        return seen.finding(way.name, Part::Measurement, way.why);
    };
    let late = spells.iter().filter_map(|spell| spell.late[number]);
    let late: Vec<_> = late.map(luna_platform::clock::nanos).collect();
    let (came, all) = (late.len(), spells.len());
    let times = super::times_of(late);
    let text = |times: &Times| format!(", after at most {:.1} µs", times.max as f64 / 1e3);
    let read = format!(
        "{} came through {came} of {all} times{}",
        way.what,
        times.as_ref().map(text).unwrap_or_default()
    );
    let how = format!("{}, busy for {} ms", first.how, BUSY.as_millis());
    let seen = match came == all {
        true => Seen::good(read, how),
        false if way.is_needed => Seen::bad(read, how, (way.advice)(machine)),
        false => Seen::better(read, how, (way.advice)(machine)),
    };
    let finding = seen.finding(way.name, Part::Measurement, way.why);
    Finding {
        ns: times,
        ..finding
    }
}

/// How to put the first of the core's kernel threads of these names above the executors.
fn raise(machine: &Machine, names: &[&str]) -> String {
    let priority = threads::PRIORITY + 1;
    let found = names.iter().find_map(|name| {
        let name = format!("{name}/{}", machine.core);
        let number = machine.processes_called(&name).ok()?.into_iter().next()?;
        Some((name, number))
    });
    let (name, number) = found.unwrap_or_else(|| {
        let name = names.first().copied().unwrap_or_default();
        (format!("{name}/{}", machine.core), "ITS_NUMBER".to_owned())
    });
    format!(
        "`chrt --fifo --pid {priority} {number}` ({name}), which then precedes all executors below"
    )
}

#[cfg(test)]
mod tests;

//! What a system reports on standard error while it runs: once what it runs without, and overruns.
//! The path of an overrun only raises a flag, and rings if the flag was not raised before.

use super::plan::{Members, Plan};
use crate::error::Error;
use crate::notice::notice;
use luna_core::Executor;
use luna_core::current::ProcessId;
use luna_machine::shortfall::{LatencyRefusal, Means, MemoryRefusal, PolicyRefusal, Shortfall};
use luna_platform::clock::Instant;
use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::time::Duration;

/// The time between two lines about one process.
const PAUSE: Duration = Duration::from_secs(1);

/// The time of the last warning about each process.
#[derive(Default)]
pub(super) struct Warnings {
    said: HashMap<ProcessId, Instant>,
}

impl Warnings {
    /// The lines to be printed now, and when to look again if no ring comes. A process with a
    /// recent warning keeps its flag, so that it does not ring.
    pub(super) fn collect(&mut self, members: &Members, now: Instant) -> (Vec<String>, Instant) {
        let mut lines = Vec::new();
        let mut next = Instant::NEVER;
        self.said.retain(|_, said| now < *said + PAUSE);
        for (id, member) in members.started.monitored() {
            let Some(ledger) = &member.ledger else {
                continue;
            };
            if !ledger.has_news() {
                continue;
            }
            if let Some(&said) = self.said.get(&id) {
                next = next.min(said + PAUSE);
                continue;
            }
            self.said.insert(id, now);
            lines.extend(take_lines(member.name(), ledger));
        }
        (lines, next)
    }

    /// What has not been reported yet, at the end.
    pub(super) fn rest(members: &Members) -> Vec<String> {
        let with_news = members.started.monitored().filter_map(|(_, member)| {
            let ledger = member.ledger.as_ref()?;
            ledger.has_news().then(|| take_lines(member.name(), ledger))
        });
        with_news.flatten().collect()
    }
}

fn take_lines(name: &str, ledger: &crate::safety::Ledger) -> Vec<String> {
    // Before the reading: an overrun in between is reported twice, and not never.
    ledger.take_news();
    let reports = ledger.reports().into_iter();
    reports
        .filter(|report| report.overruns > 0)
        .map(|report| format!("luna: process `{name}`: {report}"))
        .collect()
}

/// Reports once what the system runs without.
pub(super) fn announce_shortfalls(
    plan: &Plan,
    of_system: &[Shortfall],
    executors: &VecDeque<(String, Executor)>,
) {
    let members = plan.members();
    let of_executors = executors
        .iter()
        .map(|(name, executor)| (name.as_str(), executor.obtained()));
    let of_threads = members
        .threads
        .iter()
        .map(|(name, thread)| (name.as_str(), thread.obtained()));
    let of_all = of_executors.chain(of_threads).flat_map(|(name, obtained)| {
        obtained
            .into_iter()
            .flat_map(|got| &got.refusals)
            .map(move |one| (name, Shortfall::of(one)))
    });
    let of_all: Vec<_> = of_all.collect();
    let of_all = of_all.iter().map(|(name, one)| (*name, one));
    let of_system = of_system.iter().map(|one| ("system", one));
    let all: Vec<_> = of_system.chain(of_all).collect();
    for line in lines_about(&all, Means::here().is_root()) {
        notice!("luna: {line}");
    }
}

/// One line for the privileges that are missing, and one for each other reason.
fn lines_about(all: &[(&str, &Shortfall)], is_root: bool) -> Vec<String> {
    let mut missing: Vec<&str> = Vec::new();
    let mut others: Vec<(Vec<&str>, &Shortfall)> = Vec::new();
    for &(name, one) in all {
        if let Some(what) = without_privilege(one) {
            if !missing.contains(&what) {
                missing.push(what);
            }
        } else if let Some((names, _)) = others.iter_mut().find(|(_, other)| *other == one) {
            names.push(name);
        } else {
            others.push((vec![name], one));
        }
    }
    // The thread, the value and the reason of each are in the report.
    let missing = (!missing.is_empty()).then(|| {
        // What root lacks is taken from it, and the remedy of each, in the report, says how.
        let remedy = match is_root {
            false => "run as root or `sudo setcap cap_sys_nice,cap_ipc_lock+ep PROGRAM`",
            true => "this is root without the capabilities: give them to its container or service",
        };
        format!(
            "best effort, without {}: {remedy}; see docs/realtime.md#permissions",
            missing.join(", ")
        )
    });
    let others = others
        .into_iter()
        .map(|(names, one)| format!("best effort, {}: {one}", names.join(", ")));
    missing.into_iter().chain(others).collect()
}

/// What a privilege of the process would give; `None` if it is not a privilege that is missing.
fn without_privilege(shortfall: &Shortfall) -> Option<&'static str> {
    match shortfall {
        Shortfall::Policy { why, .. } | Shortfall::Inheritance { why, .. } => {
            matches!(why, PolicyRefusal::NotPermitted { .. }).then_some("real-time policies")
        }
        Shortfall::MemoryLock(MemoryRefusal::Limited { .. }) => Some("locked memory"),
        Shortfall::DmaLatency(LatencyRefusal::NotPermitted) => Some("short wake-ups"),
        _ => None,
    }
}

/// How long an error waits for the end of the run.
const PATIENCE: Duration = Duration::from_secs(1);

struct Pending {
    due: Instant,
    error: Error,
    /// Made at once, since the user's code may make it, which may panic. At the end nothing may.
    text: String,
}

/// In the order in which they came. On the thread that runs the system alone.
#[derive(Default)]
pub(super) struct PendingErrors(RefCell<Vec<Pending>>);

impl PendingErrors {
    pub(super) fn add(&self, error: &Error) {
        let pending = Pending {
            due: Instant::now() + PATIENCE,
            error: error.clone(),
            text: error.to_string(),
        };
        self.0.borrow_mut().push(pending);
    }

    /// Reports those for which the run has not ended in time; gives when to come again.
    pub(super) fn report_due(&self) -> Instant {
        if self.0.borrow().is_empty() {
            return Instant::NEVER;
        }
        let now = Instant::now();
        let mut due = self.0.take();
        let later = due.split_off(due.partition_point(|one| one.due <= now));
        let next = later.first().map_or(Instant::NEVER, |next| next.due);
        self.0.replace(later);
        for Pending { text, .. } in due {
            notice!("luna: {text}");
        }
        next
    }

    /// The run has ended: reports all but the error that it returns.
    pub(super) fn settle(&self, returned: Option<&Error>) {
        for Pending { error, text, .. } in self.0.take() {
            if Some(&error) != returned {
                notice!("luna: {text}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_machine::shortfall::{CoreRefusal, SpinRefusal};
    use luna_platform::thread::Policy;

    fn policy(asked: Policy) -> Shortfall {
        let why = PolicyRefusal::NotPermitted { limit: Some(0) };
        Shortfall::Policy { asked, why }
    }

    #[test]
    fn missing_privileges_are_one_line_of_at_most_200_characters() {
        let [fifo, deadline] = [policy(Policy::fifo(80)), policy(Policy::Other)];
        let memory = Shortfall::MemoryLock(MemoryRefusal::Limited { limit: Some(1) });
        let latency = Shortfall::DmaLatency(LatencyRefusal::NotPermitted);
        let all = [
            ("system", &memory),
            ("system", &latency),
            ("control", &fifo),
            ("an executor with a name of many words", &deadline),
        ];
        let lines = lines_about(&all, false);
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!("luna: ".len() + lines[0].len() <= 200, "{lines:?}");
        for part in [
            "without locked memory, short wake-ups, real-time policies:",
            "`sudo setcap cap_sys_nice,cap_ipc_lock+ep PROGRAM`",
            "docs/realtime.md#permissions",
        ] {
            assert!(lines[0].contains(part), "{part} in {lines:?}");
        }
    }

    #[test]
    fn what_no_privilege_gives_has_a_line_with_its_reason_and_remedy() {
        let core = Shortfall::Core {
            asked: 9,
            why: CoreRefusal::Offline,
        };
        let spin = Shortfall::Spin {
            asked: Duration::from_micros(50),
            why: SpinRefusal::NotPinned,
        };
        let lines = lines_about(&[("one", &core), ("two", &spin), ("three", &core)], false);
        let expected = [
            format!("best effort, one, three: {core}"),
            format!("best effort, two: {spin}"),
        ];
        assert_eq!(lines, expected);
        assert_eq!(lines_about(&[], false), [""; 0]);
    }
}

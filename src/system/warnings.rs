//! Reports overruns, on the thread that runs the system: the path only raises a flag, and rings if
//! the flag was not raised before.

use super::plan::Members;
use luna_core::current::ProcessId;
use luna_platform::clock::Instant;
use std::collections::HashMap;
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
            let Some(ledger) = member.ledger() else {
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
            let ledger = member.ledger()?;
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

//! The statistics of each loop since the beginning: its jitter, and its late cycles.

use crate::histogram::Histogram;
use luna_logger::format::Event;
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};

/// The codes of events that a loop is known by.
const SLOT: u16 = 10;
const LATE: u16 = 11;
/// A hypervisor has run something else on a core, in the time before.
const STOLEN: u16 = 17;
/// A hypervisor took time from a core.
const UNKNOWN: u64 = 0;

/// More loops than that are not counted.
const MOST_LOOPS: usize = 1024;
/// How many late cycles are kept: the last ones.
const MOST_LATE: usize = 256;

#[derive(Debug, Default)]
pub(crate) struct Loops {
    of: BTreeMap<u32, Histogram>,
    late: VecDeque<Late>,
    late_in_all: u64,
    /// Changes with each event of a loop.
    version: u64,
}

#[derive(Debug)]
struct Late {
    of: u32,
    time: u64,
    lateness: u64,
    cause: u64,
    /// The core with the most stolen time around then, and the time in ns, if the cause is not
    /// known. It need not be the loop's core.
    stolen: Option<(u32, u64)>,
}

impl Loops {
    pub(crate) fn take(&mut self, event: &Event) {
        match event.code {
            SLOT => {
                let is_full = self.of.len() >= MOST_LOOPS;
                if is_full && !self.of.contains_key(&event.subject) {
                    return;
                }
                let histogram = self.of.entry(event.subject);
                histogram
                    .or_insert_with(Histogram::new)
                    .add(event.arguments[1]);
            }
            LATE => {
                if self.late.len() == MOST_LATE {
                    self.late.pop_front();
                }
                self.late_in_all += 1;
                self.late.push_back(Late {
                    of: event.subject,
                    time: event.time,
                    lateness: event.arguments[0],
                    cause: event.arguments[1],
                    stolen: None,
                });
            }
            STOLEN => {
                let [stolen, within] = event.arguments;
                let from = event.time.saturating_sub(within);
                let is_around = |late: &&mut Late| {
                    let slot = late.time.saturating_sub(late.lateness);
                    late.cause == UNKNOWN && slot < event.time && from < late.time
                };
                for late in self.late.iter_mut().rev().filter(is_around) {
                    if late.stolen.is_none_or(|(_, before)| before < stolen) {
                        late.stolen = Some((event.subject, stolen));
                    }
                }
            }
            _ => return,
        }
        self.version += 1;
    }

    pub(crate) fn version(&self) -> u64 {
        self.version
    }

    /// All statistics, for the page. Times are strings, since they may have more than 53 bits.
    pub(crate) fn json(&self) -> Value {
        let loops = self.of.iter().map(|(number, histogram)| {
            json!({
                "number": number,
                "count": histogram.count(),
                "p50": histogram.quantile(0.5),
                "p99": histogram.quantile(0.99),
                "max": histogram.max(),
                "buckets": histogram.buckets().collect::<Vec<_>>(),
            })
        });
        let late = self.late.iter().map(|late| {
            json!({
                "loop": late.of,
                "time": late.time.to_string(),
                "lateness": late.lateness,
                "cause": late.cause,
                "stolen": late.stolen,
            })
        });
        json!({
            "type": "loops",
            "loops": loops.collect::<Vec<_>>(),
            "late": late.collect::<Vec<_>>(),
            "late_in_all": self.late_in_all,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_late_cycle_shows_the_time_stolen_around_it() {
        let mut loops = Loops::default();
        let mut take = |time, code, subject, arguments| {
            loops.take(&Event {
                thread: 0,
                time,
                code,
                subject,
                arguments,
            });
        };
        take(1_000, LATE, 7, [50, UNKNOWN]);
        take(2_000, LATE, 7, [50, UNKNOWN]);
        take(2_100, LATE, 7, [50, 2]);
        take(2_500, STOLEN, 1, [10, 1_000]);
        take(2_500, STOLEN, 3, [20, 1_000]);
        take(2_500, STOLEN, 0, [15, 1_000]);
        take(2_600, LATE, 7, [50, UNKNOWN]);
        let json = loops.json();
        let stolen = |late: usize| &json["late"][late]["stolen"];
        assert!(stolen(0).is_null(), "before");
        assert_eq!(*stolen(1), json!([3, 20]));
        assert!(stolen(2).is_null(), "its cause is known");
        assert!(stolen(3).is_null(), "after");
    }
}

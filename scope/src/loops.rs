//! What is known of each loop since the beginning: its jitter, and its late cycles.

use crate::histogram::Histogram;
use luna_logger::format::Event;
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};

/// The codes of events that a loop is known by.
const SLOT: u16 = 10;
const LATE: u16 = 11;

/// More loops than that are not counted.
const MOST_LOOPS: usize = 1024;
/// So many late cycles are remembered, the last ones.
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
                });
            }
            _ => return,
        }
        self.version += 1;
    }

    pub(crate) fn version(&self) -> u64 {
        self.version
    }

    /// All of it, for the page. Times are texts, since they may have more than 53 bits.
    pub(crate) fn json(&self) -> Value {
        let loops = self.of.iter().map(|(number, histogram)| {
            json!({
                "number": number,
                "count": histogram.count(),
                "p50": histogram.quantile(0.5),
                "p99": histogram.quantile(0.99),
                "max": histogram.most(),
                "parts": histogram.parts().collect::<Vec<_>>(),
            })
        });
        let late = self.late.iter().map(|late| {
            json!({
                "loop": late.of,
                "time": late.time.to_string(),
                "lateness": late.lateness,
                "cause": late.cause,
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

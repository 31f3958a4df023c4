//! The statistics of each loop since the beginning: its jitter, and its late cycles.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use crate::histogram::Histogram;
use luna_logger::format::Event;
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};

/// The codes of events that a loop is known by.
const SLOT: u16 = 10;
const LATE: u16 = 11;
/// A hypervisor has run something else on a core, in the time before.
const STOLEN: u16 = 17;
/// The least part of the lateness, in per cent, that a cause explains that is named.
const NAMED_FROM: u64 = 50;

/// More loops than that are not counted.
const MAX_LOOPS: usize = 1024;
/// How many late cycles are kept: the last ones.
const MAX_LATE: usize = 256;

#[derive(Debug, Default)]
pub(crate) struct Loops {
    /// How late the cycles began, and how late the last one after the slot of its number.
    of: BTreeMap<u32, (Histogram, u64)>,
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
    /// The cause that explains most, and how many per cent of the lateness; 0 if none explains
    /// half.
    cause: u64,
    percent: u64,
    /// The core that it began on.
    core: Option<u32>,
    /// How many nanoseconds of the lateness a hypervisor had that core, at least.
    stolen: u64,
}

impl Late {
    /// From the event. Its second argument has the cause in bits 0 to 7, its share in bits 8 to 15,
    /// and the core plus one in bits 16 to 47.
    fn of(event: &Event) -> Late {
        let [lateness, argument] = event.arguments;
        let percent = argument >> 8 & 0xff;
        Late {
            of: event.subject,
            time: event.time,
            lateness,
            // A recording that was made before there were shares names no cause.
            cause: if percent == 0 { 0 } else { argument & 0xff },
            percent,
            core: ((argument >> 16) as u32).checked_sub(1),
            stolen: 0,
        }
    }

    /// Adds what was stolen from its core in a window that ended with `event`, as far as it cannot
    /// have been stolen in the rest of the window.
    fn add_stolen(&mut self, event: &Event) {
        let [stolen, within] = event.arguments;
        let slot = self.time.saturating_sub(self.lateness);
        let from = event.time.saturating_sub(within);
        let overlap = event.time.min(self.time).saturating_sub(from.max(slot));
        if self.core == Some(event.subject) && overlap > 0 {
            let certain = stolen.saturating_sub(within.saturating_sub(overlap));
            self.stolen = self.stolen.saturating_add(certain);
        }
    }

    /// How many per cent of the lateness a hypervisor explains, if it is at least half.
    fn stolen_percent(&self) -> Option<u64> {
        // Both are the recording's, and may be any numbers.
        let stolen = u128::from(self.stolen.min(self.lateness)).saturating_mul(100);
        let percent = stolen.checked_div(self.lateness.into())?;
        let percent = u64::try_from(percent).ok()?;
        (percent >= NAMED_FROM).then_some(percent)
    }
}

impl Loops {
    pub(crate) fn take(&mut self, event: &Event) {
        match event.code {
            SLOT => {
                let is_full = self.of.len() >= MAX_LOOPS;
                if is_full && !self.of.contains_key(&event.subject) {
                    return;
                }
                let of = self.of.entry(event.subject);
                let (histogram, last) = of.or_insert_with(|| (Histogram::new(), 0));
                *last = event.arguments[1];
                histogram.add(*last);
            }
            LATE => {
                if self.late.len() == MAX_LATE {
                    self.late.pop_front();
                }
                // It waited for an earlier slot than that of its number, if it has skipped some.
                if let Some((histogram, last)) = self.of.get_mut(&event.subject)
                    && *last < event.arguments[0]
                {
                    histogram.correct(*last, event.arguments[0]);
                    *last = event.arguments[0];
                }
                self.late_in_all = self.late_in_all.saturating_add(1);
                self.late.push_back(Late::of(event));
            }
            STOLEN => {
                for late in &mut self.late {
                    late.add_stolen(event);
                }
            }
            _ => return,
        }
        self.version = self.version.wrapping_add(1);
    }

    pub(crate) fn version(&self) -> u64 {
        self.version
    }

    /// All statistics, for the page. Times are strings, since they may have more than 53 bits.
    pub(crate) fn json(&self) -> Value {
        let loops = self.of.iter().map(|(number, (histogram, _))| {
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
                "percent": late.percent,
                "stolen_percent": late.stolen_percent(),
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

    const UNKNOWN: u64 = 0;

    /// A recording may state any numbers.
    #[test]
    fn the_largest_numbers_are_no_sums_that_overflow() {
        let most = u64::MAX;
        let late = (most, LATE, 7, [most, on_core(3, UNKNOWN, 100)]);
        let stolen = (most, STOLEN, 3, [most, most]);
        let json = json_of(&[(0, SLOT, 7, [1, most]), late, stolen, stolen]);
        assert_eq!(json[0]["stolen_percent"], 100);
    }

    fn on_core(core: u64, cause: u64, percent: u64) -> u64 {
        cause | percent << 8 | (core + 1) << 16
    }

    fn json_of(events: &[(u64, u16, u32, [u64; 2])]) -> Value {
        let mut loops = Loops::default();
        for &(time, code, subject, arguments) in events {
            loops.take(&Event {
                thread: 0,
                time,
                code,
                subject,
                arguments,
            });
        }
        loops.json()["late"].clone()
    }

    #[test]
    fn a_cycle_that_skipped_slots_is_as_late_as_after_the_one_it_waited_for() {
        let mut loops = Loops::default();
        for (code, arguments) in [
            (SLOT, [1, 20]),
            (SLOT, [4, 700]),
            (LATE, [2_700, on_core(0, UNKNOWN, 0)]),
            (SLOT, [5, 30]),
        ] {
            loops.take(&Event {
                thread: 0,
                time: 10_000,
                code,
                subject: 7,
                arguments,
            });
        }
        let found = &loops.json()["loops"][0];
        assert_eq!(found["count"], 3);
        assert_eq!(found["max"], 2_700);
        assert!(found["p50"].as_u64().is_some_and(|p50| p50 < 40), "{found}");
    }

    #[test]
    fn a_hypervisor_is_named_if_it_had_half_of_the_lateness_for_certain() {
        let late = json_of(&[
            (1_000, LATE, 7, [50, on_core(3, UNKNOWN, 0)]),
            (2_000, LATE, 7, [400, on_core(3, UNKNOWN, 0)]),
            (2_400, LATE, 7, [50, on_core(3, UNKNOWN, 0)]),
            (2_450, LATE, 7, [500, on_core(1, UNKNOWN, 0)]),
            (2_500, STOLEN, 1, [700, 1_000]),
            // All but 100 of the window: at least 300 of the 400, and nothing certain of the 50.
            (2_500, STOLEN, 3, [900, 1_000]),
            (2_600, LATE, 7, [50, on_core(3, UNKNOWN, 0)]),
        ]);
        let stolen = |late_cycle: usize| &late[late_cycle]["stolen_percent"];
        assert!(stolen(0).is_null(), "before");
        assert_eq!(*stolen(1), 75);
        assert!(
            stolen(2).is_null(),
            "the window is longer than the lateness"
        );
        assert!(stolen(3).is_null(), "200 of 500 are not half");
        assert!(stolen(4).is_null(), "after");
    }

    #[test]
    fn a_cause_has_its_share_or_is_none() {
        let late = json_of(&[
            (1_000, LATE, 7, [50, on_core(0, 2, 98)]),
            (2_000, LATE, 7, [50, 2]),
        ]);
        assert_eq!(
            (&late[0]["cause"], &late[0]["percent"]),
            (&json!(2), &json!(98))
        );
        assert_eq!(
            (&late[1]["cause"], &late[1]["percent"]),
            (&json!(0), &json!(0))
        );
    }
}

//! What a command found: as one JSON object.

use crate::alloc::Counts;
use serde::Serialize;

/// The head of every measurement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measurement {
    /// As obtained: `fifo:80`, `rr:80` or `other`.
    pub policy: String,
    /// As obtained; nothing if the processes were not bound to a core.
    pub core: Option<usize>,
    /// What was asked for and not obtained.
    pub missing: Vec<Missing>,
    /// Whether every process ran to its end.
    pub complete: bool,
    /// On the real-time path, while the bodies ran.
    #[serde(flatten)]
    pub counts: Counts,
    /// Those that control or measure first.
    pub loops: Vec<Loop>,
    /// What became of the log, if there was one.
    pub logging: Option<Logged>,
}

/// What became of signals, messages and events.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Logged {
    /// Where they went.
    pub to: String,
    /// How many bytes that are.
    pub bytes: u64,
    /// Samples of all signals.
    pub samples: Kept,
    /// As samples.
    pub messages: Kept,
    /// As samples.
    pub events: Kept,
    /// The first reason why something could not be written.
    pub error: Option<String>,
}

/// How many were kept, and how many were not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Kept {
    /// In the recording.
    pub recorded: u64,
    /// Not in it: there was no room in the ring, or where the recording goes.
    pub lost: u64,
}

/// What was asked for and not obtained.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// The thread that asked for it, or `system`.
    pub who: String,
    /// In a few words.
    pub what: String,
    /// The reason.
    pub why: String,
    /// How to get it.
    pub remedy: String,
}

/// How well one periodic process kept time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Loop {
    /// As the program calls it.
    pub name: String,
    /// From one slot to the next.
    pub period_ns: u64,
    /// Slots that have passed: kept and missed.
    pub slots_elapsed: u64,
    /// Slots in which it ran.
    pub slots_kept: u64,
    /// Slots in which it did not.
    pub slots_missed: u64,
    /// From the slot's time to the process running.
    pub wake_latency_ns: Quantiles,
    /// From one cycle's begin to the next.
    pub cycle_time_ns: Spread,
    /// From a cycle's begin to its waiting for the next.
    pub run_time_ns: Quantiles,
    /// A cycle is late that begins later than this.
    pub late_after_ns: u64,
    /// How many were.
    pub late: u64,
    /// The worst of these, the worst first.
    pub late_cycles: Vec<Late>,
}

/// A cycle that began late.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Late {
    /// The number of its slot.
    pub slot: u64,
    /// By how much.
    pub lateness_ns: u64,
    /// What explains half of that or more; empty where the cause is unknown.
    pub causes: Vec<Cause>,
}

/// A cause of a late cycle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Cause {
    /// `own_overrun`, `own_process`, `other_process`, `other_thread` or `hypervisor`.
    pub kind: &'static str,
    /// Of the two kinds that are processes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub process: Option<String>,
    /// How much of the lateness it explains.
    pub explains_ns: u64,
    /// The same in per cent.
    pub percent: u64,
}

/// Where the values of a histogram lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Quantiles {
    /// The smallest.
    pub min: u64,
    /// Half of them are at most this.
    pub p50: u64,
    /// 99 of 100 are.
    pub p99: u64,
    /// 999 of 1000 are.
    pub p99_9: u64,
    /// The largest.
    pub max: u64,
}

/// The same, with mean and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Side by side with the other two.
    #[serde(flatten)]
    pub quantiles: Quantiles,
    /// Their sum by their number.
    pub mean: f64,
    /// The root of their mean squared distance from it.
    pub stddev: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{json, to_value};

    fn quantiles() -> Quantiles {
        Quantiles {
            min: 1,
            p50: 2,
            p99: 3,
            p99_9: 4,
            max: 5,
        }
    }

    #[test]
    fn has_the_form_that_is_promised() {
        let measurement = Measurement {
            policy: "fifo:80".to_owned(),
            core: Some(1),
            missing: Vec::new(),
            complete: true,
            counts: Counts::default(),
            loops: vec![Loop {
                name: "pan".to_owned(),
                period_ns: 1_000_000,
                slots_elapsed: 10,
                slots_kept: 9,
                slots_missed: 1,
                wake_latency_ns: quantiles(),
                cycle_time_ns: Spread {
                    quantiles: quantiles(),
                    mean: 1.5,
                    stddev: 0.5,
                },
                run_time_ns: quantiles(),
                late_after_ns: 100_000,
                late: 2,
                late_cycles: vec![Late {
                    slot: 7,
                    lateness_ns: 200_000,
                    causes: vec![Cause {
                        kind: "other_process",
                        process: Some("hog".to_owned()),
                        explains_ns: 180_000,
                        percent: 90,
                    }],
                }],
            }],
            logging: Some(Logged {
                to: "run.luna".to_owned(),
                bytes: 9,
                samples: Kept {
                    recorded: 3,
                    lost: 1,
                },
                messages: Kept::default(),
                events: Kept::default(),
                error: None,
            }),
        };
        let none = json!({"recorded": 0, "lost": 0});
        let five = json!({"min": 1, "p50": 2, "p99": 3, "p99_9": 4, "max": 5});
        let seven =
            json!({"min": 1, "p50": 2, "p99": 3, "p99_9": 4, "max": 5, "mean": 1.5, "stddev": 0.5});
        let expected = json!({
            "policy": "fifo:80", "core": 1, "missing": [], "complete": true,
            "allocations": 0, "reallocations": 0, "frees": 0,
            "loops": [{
                "name": "pan", "period_ns": 1_000_000, "slots_elapsed": 10, "slots_kept": 9, "slots_missed": 1,
                "wake_latency_ns": five, "cycle_time_ns": seven, "run_time_ns": five,
                "late_after_ns": 100_000, "late": 2, "late_cycles": [{"slot": 7, "lateness_ns": 200_000, "causes": [
                    {"kind": "other_process", "process": "hog", "explains_ns": 180_000, "percent": 90},
                ]}],
            }],
            "logging": {
                "to": "run.luna", "bytes": 9, "samples": {"recorded": 3, "lost": 1}, "messages": none, "events": none, "error": null,
            },
        });
        assert_eq!(to_value(&measurement).unwrap(), expected);
    }
}

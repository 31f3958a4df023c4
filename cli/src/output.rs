//! What a command found: as one JSON object.

use crate::alloc::Counts;
use crate::demo::replay::Recorded;
use crate::demo::table::Row;
use luna_jiwy::parts::sanity::Interventions;
use serde::Serialize;

/// The head of every measurement.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Measurement {
    /// As obtained: `fifo:80`, `rr:80` or `other`.
    pub(crate) policy: String,
    /// As obtained; nothing if the processes were not bound to a core.
    pub(crate) core: Option<usize>,
    /// What was asked for and not obtained.
    pub(crate) missing: Vec<Missing>,
    /// Whether every process ran to its end.
    pub(crate) complete: bool,
    /// On the real-time path, while the bodies ran.
    #[serde(flatten)]
    pub(crate) counts: Counts,
    /// Those that control or measure first.
    pub(crate) loops: Vec<Loop>,
    /// What became of the log, if there was one.
    pub(crate) logging: Option<Logged>,
}

/// What became of signals, messages and events.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Logged {
    /// Where they went.
    pub(crate) to: String,
    /// How many bytes that are.
    pub(crate) bytes: u64,
    /// Samples of all signals.
    pub(crate) samples: Kept,
    /// As samples.
    pub(crate) messages: Kept,
    /// As samples.
    pub(crate) events: Kept,
    /// The first reason why something could not be written.
    pub(crate) error: Option<String>,
}

/// How many were kept, and how many were not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub(crate) struct Kept {
    /// In the recording.
    pub(crate) recorded: u64,
    /// Not in it: there was no room in the ring, or where the recording goes.
    pub(crate) lost: u64,
}

/// What was asked for and not obtained.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Missing {
    /// The thread that asked for it, or `system`.
    pub(crate) who: String,
    /// In a few words.
    pub(crate) what: String,
    /// The reason.
    pub(crate) why: String,
    /// How to get it.
    pub(crate) remedy: String,
}

/// How well one periodic process kept time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Loop {
    /// As the program calls it.
    pub(crate) name: String,
    /// From one slot to the next.
    pub(crate) period_ns: u64,
    /// Slots that have passed: kept and missed.
    pub(crate) slots_elapsed: u64,
    /// Slots in which it ran.
    pub(crate) slots_kept: u64,
    /// Slots in which it did not.
    pub(crate) slots_missed: u64,
    /// From the slot's time to the process running.
    pub(crate) wake_latency_ns: Quantiles,
    /// From one cycle's begin to the next.
    pub(crate) cycle_time_ns: Spread,
    /// From a cycle's begin to its waiting for the next.
    pub(crate) run_time_ns: Quantiles,
    /// A cycle is late that begins later than this.
    pub(crate) late_after_ns: u64,
    /// How many were.
    pub(crate) late: u64,
    /// The worst of these, the worst first.
    pub(crate) late_cycles: Vec<Late>,
}

/// A cycle that began late.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Late {
    /// The number of its slot.
    pub(crate) slot: u64,
    /// By how much.
    pub(crate) lateness_ns: u64,
    /// What explains half of that or more; empty where the cause is unknown.
    pub(crate) causes: Vec<Cause>,
}

/// A cause of a late cycle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Cause {
    /// `own_overrun`, `own_process`, `other_process`, `other_thread` or `hypervisor`.
    pub(crate) kind: &'static str,
    /// Of the two kinds that are processes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) process: Option<String>,
    /// How much of the lateness it explains.
    pub(crate) explains_ns: u64,
    /// The same in per cent.
    pub(crate) percent: u64,
}

/// Where the values of a histogram lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(crate) struct Quantiles {
    /// The smallest.
    pub(crate) min: u64,
    /// Half of them are at most this.
    pub(crate) p50: u64,
    /// 99 of 100 are.
    pub(crate) p99: u64,
    /// 999 of 1000 are.
    pub(crate) p99_9: u64,
    /// The largest.
    pub(crate) max: u64,
}

/// The same, with mean and standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Spread {
    /// Side by side with the other two.
    #[serde(flatten)]
    pub(crate) quantiles: Quantiles,
    /// Their sum by their number.
    pub(crate) mean: f64,
    /// The root of their mean squared distance from it.
    pub(crate) stddev: f64,
}

/// What `luna demo --json` prints.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Demo {
    /// Side by side with the axes.
    #[serde(flatten)]
    pub(crate) measurement: Measurement,
    /// The run's row of the paper's table 4; nothing if its loop never came to run.
    pub(crate) table_4: Option<Row>,
    /// What was recorded, if that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) record: Option<Recorded>,
    /// Pan, tilt.
    pub(crate) axes: Vec<Axis>,
}

/// How one axis was controlled.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Axis {
    /// `pan` or `tilt`.
    pub(crate) name: &'static str,
    /// Set-point against measured angle, over all cycles; `None` if no cycle measured it.
    pub(crate) tracking_error_deg: Option<TrackingError>,
    /// Where the mechanism was at the end.
    pub(crate) final_state: FinalState,
    /// How often the safety layer changed a duty.
    pub(crate) sanity: Interventions,
}

/// Set-point against measured angle, in degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct TrackingError {
    /// The root of the mean square.
    pub(crate) rms: f64,
    /// The largest, either way.
    pub(crate) max: f64,
}

/// A mechanism at the end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct FinalState {
    /// Of the joint.
    pub(crate) angle_deg: f64,
    /// Of the joint.
    pub(crate) speed_deg_per_s: f64,
    /// In the armature.
    pub(crate) current_a: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json, to_value};

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

        let demo = to_value(Demo {
            measurement,
            table_4: None,
            record: None,
            axes: [Some(TrackingError { rms: 1.0, max: 2.0 }), None]
                .map(|tracking_error_deg| Axis {
                    name: "pan",
                    tracking_error_deg,
                    final_state: FinalState {
                        angle_deg: 3.0,
                        speed_deg_per_s: 4.0,
                        current_a: 5.0,
                    },
                    sanity: Interventions::default(),
                })
                .into(),
        })
        .unwrap();
        assert_eq!(demo["policy"], expected["policy"]);
        assert_eq!(
            demo["axes"][0]["tracking_error_deg"],
            json!({"rms": 1.0, "max": 2.0})
        );
        assert_eq!(demo["axes"][1]["tracking_error_deg"], Value::Null);
        assert!(matches!(demo["loops"], Value::Array(_)));
    }
}

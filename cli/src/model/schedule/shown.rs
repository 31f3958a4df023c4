//! Bounds as text for people, and as JSON.

use super::measured::Missing;
use crate::columns::{of_rows, of_texts};
use crate::text::Count;
use luna_model::Model;
use luna_model::schedule::{Core, Row, Schedule, Verdict};
use serde::Serialize;
use std::time::Duration;

/// What is printed.
#[derive(Debug, Serialize)]
pub(super) struct Shown<'a> {
    model: &'a str,
    latency_ns: Option<u64>,
    parts: Vec<Part<'a>>,
    cores: &'a [Core],
    /// Parts without an executor: they may run before any other.
    not_counted: Vec<&'a str>,
    /// In the recording, and not in the model.
    strangers: &'a [String],
    lost_events: u64,
    /// Of the recording.
    is_damaged: bool,
}

#[derive(Debug, Serialize)]
struct Part<'a> {
    name: &'a str,
    executor: Option<&'a str>,
    host: &'a str,
    core: Option<u16>,
    policy: Option<&'a str>,
    priority: u8,
    period_ns: Option<u64>,
    is_seen: bool,
    cost_ns: Option<u64>,
    longest_poll_ns: Option<u64>,
    bound_ns: Option<u64>,
    measured_ns: Option<u64>,
    deadline_ns: Option<u64>,
    slack_ns: Option<i64>,
    may_wait: bool,
    verdict: &'static str,
    advice: Option<&'a str>,
}

fn nanos(time: Option<Duration>) -> Option<u64> {
    time.map(|time| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
}

impl<'a> Shown<'a> {
    pub(super) fn of(model: &'a Model, schedule: &'a Schedule, missing: &Missing) -> Self {
        let is_lost = |row: &&Row| row.executor.is_none() && row.verdict == Verdict::Nothing;
        let lost = schedule.rows.iter().filter(is_lost);
        Self {
            model: model.name(),
            latency_ns: nanos(schedule.latency),
            parts: schedule.rows.iter().map(Part::of).collect(),
            cores: &schedule.cores,
            not_counted: lost.map(|row| row.name.as_str()).collect(),
            strangers: &schedule.strangers,
            lost_events: missing.events,
            is_damaged: missing.is_damaged,
        }
    }

    /// Whether something was not counted, or nothing was asked.
    pub(super) fn is_incomplete(&self) -> bool {
        let lists = [self.not_counted.len(), self.strangers.len()];
        self.is_empty() || self.lost_events > 0 || self.is_damaged || lists != [0, 0]
    }

    /// Whether nothing was asked.
    fn is_empty(&self) -> bool {
        self.parts.iter().all(|part| part.deadline_ns.is_none())
    }

    pub(super) fn text(&self) -> String {
        let head = [
            "PART", "ON", "CORE", "POLICY", "PRIO", "PERIOD", "COST", "POLL", "BOUND", "MEASURED",
            "DEADLINE", "SLACK", "VERDICT",
        ];
        let rows = self.parts.iter().map(Part::cells);
        let mut text = format!("{}: response times, all times in µs\n", self.model);
        text += &of_rows(head, &[4, 5, 6, 7, 8, 9, 10, 11], rows);
        for part in &self.parts {
            if let Some(advice) = part.advice {
                text += &line(format!("{}: {advice}", part.name));
            }
        }
        for core in self.cores {
            text += &load(core);
        }
        for note in self.notes() {
            text += &line(note);
        }
        text
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.is_empty() {
            notes.push(
                "no part has a period or a deadline: state `period = \"…\"` in parts".to_owned(),
            );
        }
        if self.parts.iter().any(|part| part.bound_ns.is_some()) {
            if self.latency_ns.is_none() {
                notes.push(
                    "the timer is taken to be exact: state `latency` in [schedule], as `luna \
                     jitter` measures it"
                        .to_owned(),
                );
            }
            let parts = self.parts.iter();
            let waiting = parts.filter(|part| part.bound_ns.is_some() && part.may_wait);
            let waiting: Vec<&str> = waiting.map(|part| part.name).collect();
            if !waiting.is_empty() {
                notes.push(format!(
                    "* these bounds leave out waits for other processes and for a time: {}",
                    waiting.join(", ")
                ));
            }
        }
        if !self.not_counted.is_empty() {
            notes.push(format!(
                "not counted, since they name no executor: {}",
                self.not_counted.join(", ")
            ));
        }
        if !self.strangers.is_empty() {
            notes.push(format!(
                "not counted, since the model has no such part: {}",
                self.strangers.join(", ")
            ));
        }
        if self.lost_events > 0 {
            notes.push(format!(
                "{} lost while it was recorded: what was measured may be wrong; give it more \
                 room (LUNA_LOG_EVENTS)",
                Count(self.lost_events, "event")
            ));
        }
        if self.is_damaged {
            notes.push(
                "the recording is damaged or has no end: what was measured may be too little"
                    .to_owned(),
            );
        }
        notes
    }
}

impl<'a> Part<'a> {
    fn of(row: &'a Row) -> Self {
        let (bound, deadline) = (nanos(row.bound), nanos(row.deadline));
        let slack = deadline.zip(bound);
        Self {
            name: &row.name,
            executor: row.executor.as_deref(),
            host: &row.host,
            core: row.core,
            policy: row.policy.as_deref(),
            priority: row.priority,
            period_ns: nanos(row.period),
            is_seen: row.is_seen,
            cost_ns: nanos(row.cost),
            longest_poll_ns: nanos(row.longest_poll),
            bound_ns: bound,
            measured_ns: nanos(row.measured),
            deadline_ns: deadline,
            slack_ns: slack.map(|(deadline, bound)| deadline.cast_signed() - bound.cast_signed()),
            may_wait: row.may_wait,
            verdict: row.verdict.word(),
            advice: row.advice.as_deref(),
        }
    }

    fn cells(&self) -> [String; 13] {
        let text = |text: Option<&str>| text.unwrap_or("-").to_owned();
        let core = self.core.map(|core| match self.host {
            "" => core.to_string(),
            host => format!("{host}:{core}"),
        });
        let period = match self.is_seen {
            true => "seen".to_owned(),
            false => micros(self.period_ns),
        };
        [
            self.name.to_owned(),
            text(self.executor),
            text(core.as_deref()),
            text(self.policy),
            self.priority.to_string(),
            period,
            micros(self.cost_ns),
            micros(self.longest_poll_ns),
            micros(self.bound_ns),
            micros(self.measured_ns),
            micros(self.deadline_ns),
            self.slack_ns
                .map_or("-".to_owned(), |slack| tenths(slack.div_euclid(100))),
            match (self.verdict, self.may_wait) {
                ("holds", true) => "holds*".to_owned(),
                (verdict, _) => verdict.to_owned(),
            },
        ]
    }
}

fn load(core: &Core) -> String {
    let host = match core.host.as_str() {
        "" => String::new(),
        host => format!(" of {host}"),
    };
    let more = match core.is_more {
        true => ", and what is not known",
        false => "",
    };
    let share = core.utilization * 100.0;
    format!(
        "core {}{host}: {share:.1} % for real-time parts{more}\n",
        core.number
    )
}

fn line(text: String) -> String {
    of_texts([], [vec![text]])
}

/// Rounded up to a tenth of a microsecond.
fn micros(nanos: Option<u64>) -> String {
    nanos.map_or("-".to_owned(), |nanos| {
        tenths(nanos.div_ceil(100).cast_signed())
    })
}

fn tenths(tenths: i64) -> String {
    let sign = if tenths < 0 { "-" } else { "" };
    let tenths = tenths.unsigned_abs();
    format!("{sign}{}.{}", tenths / 10, tenths % 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_rounded_up_and_slacks_down() {
        assert_eq!(micros(Some(1_000_001)), "1000.1");
        assert_eq!(micros(Some(99_900)), "99.9");
        assert_eq!(micros(None), "-");
        assert_eq!(
            [150_i64, -150].map(|slack| tenths(slack.div_euclid(100))),
            ["0.1", "-0.2"]
        );
    }
}

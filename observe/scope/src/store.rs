//! The data that the scope keeps: declarations, the last blocks, and counts since the beginning.
//!
//! Its blocks have the format of recordings, and their own numbers.

mod alarms;
mod changes;
mod declared;
mod kept;
mod overview;
#[cfg(test)]
mod tests;

use crate::loops::Loops;
use crate::reduce::{Bucket, Budget};
use alarms::Alarms;
use changes::Changes;
use declared::Declared;
use kept::Kept;
use luna_logger::format::{Event, Record, Type, Values};
use overview::Overview;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A block is cut when a viewer reads and this time has passed: two frames of a screen.
const CUT: Duration = Duration::from_millis(30);

/// Samples of more signals than that are left out.
const MAX_FOLLOWED: usize = 4096;

/// Signals with an overview: 4 KiB for each element.
const MAX_OVERVIEWS: usize = 1024;

/// The limit of the bytes of declarations; the rest is left out.
const MAX_DECLARED: usize = 1 << 20;

/// Codes of events that always pass: ended, late, emergency, spawned. They are rare, and their
/// order and number matter.
const ALWAYS: [u16; 4] = [4, 11, 12, 13];

#[derive(Debug)]
pub(crate) struct Store {
    /// Samples and messages, with the declarations.
    samples: Kept,
    /// In memory of their own, since they are many more.
    events: Kept,
    overviews: BTreeMap<u32, Overview>,
    cut: Instant,
    most_bytes: usize,
    /// The first time of the recording, from which all others are counted.
    start: Option<u64>,
    /// The last time of a file, which was read as a whole.
    until: Option<u64>,
    /// What is before is left out but for the overviews and counts: a viewer has sought in the
    /// file.
    shows_from: Option<u64>,
    /// Viewers get nothing until that time has come.
    is_hidden: bool,
    /// The shown recording: viewers begin again with each.
    recording: Recording,
    declared: Declared,
    alarms: Alarms,
    buckets: BTreeMap<u32, Bucket>,
    budget: Budget,
    loops: Loops,
    left_out_samples: u64,
    left_out_events: u64,
    /// Why nothing more comes, if that is so.
    problem: Option<String>,
    /// How the run ended, once its program has said so.
    report: Option<String>,
    changes: Changes,
    /// The last time of a record.
    last: Option<u64>,
}

/// Identifies one of the recordings that a store has begun. Several may arrive at once: the one
/// that began last is shown, and records of the others are ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Recording(u64);

impl Recording {
    /// Before any has begun.
    pub(crate) const NONE: Recording = Recording(1);
}

/// The blocks that a viewer does not have yet.
#[derive(Default)]
pub(crate) struct News {
    pub(crate) blocks: Vec<Arc<[u8]>>,
    /// The number of blocks at the beginning that repeat declarations.
    pub(crate) declarations: usize,
    /// How many blocks were gone before it got them.
    pub(crate) missed: u64,
    /// It is of another recording than before, which begins with these blocks of declarations.
    pub(crate) begins: bool,
    /// The recording's first time, if anything has one.
    pub(crate) start: Option<u64>,
    /// The recording's last time, if it is a file's.
    pub(crate) until: Option<u64>,
    /// The last time of what has come: viewers get all until there.
    pub(crate) last: Option<u64>,
    /// The first time of the samples and of the events that are kept, if those are not all.
    pub(crate) kept_from: [Option<u64>; 2],
    /// The extremes of each signal since the start, where declarations are repeated.
    pub(crate) overviews: Vec<Value>,
}

/// How far a viewer is.
#[derive(Debug, Default)]
pub(crate) struct Position {
    recording: Option<Recording>,
    /// The numbers of the next blocks of samples and of events.
    next: [u64; 2],
}

impl Store {
    pub(crate) fn new(most_bytes: usize) -> Self {
        Self {
            samples: Kept::new(most_bytes / 2),
            events: Kept::new(most_bytes / 2),
            overviews: BTreeMap::new(),
            cut: Instant::now(),
            most_bytes,
            start: None,
            until: None,
            shows_from: None,
            is_hidden: false,
            recording: Recording::NONE,
            declared: Declared::default(),
            alarms: Alarms::default(),
            buckets: BTreeMap::new(),
            budget: Budget::new(),
            loops: Loops::default(),
            left_out_samples: 0,
            left_out_events: 0,
            problem: None,
            report: None,
            changes: Changes::default(),
            last: None,
        }
    }

    /// A recording begins: the data of the previous one is dropped.
    pub(crate) fn begin(&mut self) -> Recording {
        let recording = Recording(self.recording.0 + 1);
        *self = Self::new(self.most_bytes);
        self.recording = recording;
        recording
    }

    /// A file begins, which is to be seen as a whole: its [overview](Self::overview) comes first.
    pub(crate) fn survey(&mut self) {
        self.begin();
        self.is_hidden = true;
    }

    /// Takes what an overview has of a record.
    pub(crate) fn overview(&mut self, record: &Record<'_>) {
        let time = time(record);
        self.start = self.start.or(time);
        self.until = self.until.max(time);
        if let Record::Sample {
            signal,
            time,
            values,
        } = record
        {
            self.extend_overview(*signal, *time, *values);
        }
    }

    /// The first time of the file that is shown, if it is one.
    pub(crate) fn file(&self) -> Option<u64> {
        self.until.and(self.start)
    }

    /// The file begins again, and is shown from this time on.
    pub(crate) fn begin_at(&mut self, from: u64) -> Recording {
        let overviews = std::mem::take(&mut self.overviews);
        let (start, until) = (self.start, self.until);
        let recording = self.begin();
        (self.overviews, self.start, self.until) = (overviews, start, until);
        self.shows_from = Some(from).filter(|from| start < Some(*from));
        self.is_hidden = self.shows_from.is_some();
        recording
    }

    /// Nothing more comes of the file: viewers get what there is.
    pub(crate) fn reveal(&mut self) {
        self.is_hidden = false;
    }

    fn extend_overview(&mut self, signal: u32, time: u64, values: Values<'_>) {
        if self.overviews.len() < MAX_OVERVIEWS || self.overviews.contains_key(&signal) {
            let overview = self.overviews.entry(signal);
            let overview = overview.or_insert_with(|| Overview::new(values.len()));
            overview.put(time.saturating_sub(self.start.unwrap_or(time)), values);
        }
    }

    /// Sets why the recording ended early, if it is the shown one.
    pub(crate) fn fail(&mut self, of: Recording, problem: String) {
        if of == self.recording {
            self.problem = Some(problem);
        }
    }

    /// Sets how the run ended.
    pub(crate) fn report(&mut self, how: String) {
        self.report = Some(how);
    }

    /// Keeps that a parameter was changed, at the last time that is known.
    pub(crate) fn change(&mut self, name: &str, before: &Value, value: &Value) {
        if let Some(time) = self.last {
            self.changes.put(time, name, before, value);
        }
    }

    /// Takes a record, if its recording is the shown one. O(its length), except at a change of
    /// span.
    pub(crate) fn take(&mut self, of: Recording, record: &Record<'_>) {
        if of != self.recording {
            return;
        }
        let time = time(record);
        self.start = self.start.or(time);
        self.last = self.last.max(time);
        let is_past = time.is_some() && time < self.shows_from;
        self.is_hidden &= is_past || time.is_none();
        match record {
            Record::Sample {
                signal,
                time,
                values,
            } => {
                self.extend_overview(*signal, *time, *values);
                if !is_past {
                    self.sample(*signal, *time, *values);
                }
            }
            Record::Event(event) => self.event(event, is_past),
            Record::Message { .. } => {
                let block = (!is_past).then_some(self.samples.current());
                self.alarms.take(record, block);
                if !is_past {
                    self.samples.put(record);
                }
            }
            other => {
                if self.declared.take(other) {
                    self.samples.put(other);
                }
            }
        }
    }

    fn sample(&mut self, signal: u32, time: u64, values: Values<'_>) {
        let span = self.budget.span(time);
        if !self.buckets.contains_key(&signal) && self.buckets.len() >= MAX_FOLLOWED {
            self.left_out_samples += 1;
            return;
        }
        let bucket = self.buckets.entry(signal).or_default();
        let before = self.samples.written;
        if bucket.is_over(span) {
            self.left_out_samples += give(bucket, &mut self.samples, signal, values.element_type());
        }
        if bucket.put(span, time, values) {
            self.samples.put(&Record::Sample {
                signal,
                time,
                values,
            });
        }
        self.budget.count_bytes(self.samples.written - before);
    }

    fn event(&mut self, event: &Event, is_past: bool) {
        self.loops.take(event);
        self.declared.event(event);
        if is_past {
            return;
        }
        if self.budget.has_event(event.time) || ALWAYS.contains(&event.code) {
            self.events.put(&Record::Event(*event));
        } else {
            self.left_out_events += 1;
        }
    }

    /// Ends the current block, if it is due; kept samples go into it.
    fn cut_if_due(&mut self) {
        if self.cut.elapsed() >= CUT {
            self.cut();
        }
    }

    /// Ends the current block.
    pub(crate) fn cut(&mut self) {
        for (signal, bucket) in &mut self.buckets {
            if let Some(of) = self.declared.type_of(*signal) {
                self.left_out_samples += give(bucket, &mut self.samples, *signal, of);
            }
        }
        self.samples.cut();
        self.events.cut();
        self.cut = Instant::now();
    }

    /// The blocks since a viewer's last read: at most `most` bytes of them, or the declarations if
    /// those are longer, beside one block of samples and one of events.
    pub(crate) fn news(&mut self, position: &mut Position, most: usize) -> News {
        self.cut_if_due();
        if self.is_hidden {
            return News::default();
        }
        let begins = position.recording != Some(self.recording);
        let kept = [&self.samples, &self.events];
        if begins {
            position.recording = Some(self.recording);
            position.next = kept.map(|kept| kept.first);
        }
        let missed = |(kept, next): (&&Kept, &u64)| kept.first.saturating_sub(*next);
        let missed = kept.iter().zip(&position.next).map(missed).sum();
        let mut news = News {
            blocks: Vec::new(),
            declarations: 0,
            missed,
            begins,
            start: self.start,
            until: self.until,
            last: self.last,
            kept_from: kept.map(|kept| kept.kept_from().or(self.shows_from)),
            overviews: Vec::new(),
        };
        if begins || missed > 0 {
            // Also what was declared in those that it has missed, and their alarms.
            let from = (!begins).then_some(position.next[0]);
            let alarms = self.alarms.between(from, self.samples.first);
            news.blocks = self.declared.blocks(alarms);
            let all = self.overviews.iter();
            news.overviews = all
                .map(|(signal, overview)| overview.json(*signal))
                .collect();
        }
        news.declarations = news.blocks.len();
        let mut bytes: usize = news.blocks.iter().map(|block| block.len()).sum();
        for (kept, next) in kept.into_iter().zip(&mut position.next) {
            *next = kept.first.max(*next);
            let most = most.min(bytes + most / 2);
            // At least one, so that a viewer that gets the declarations repeatedly makes progress.
            for (number, block) in kept.since(*next).enumerate() {
                if bytes >= most && number > 0 {
                    break;
                }
                bytes += block.len();
                news.blocks.push(block.clone());
                *next += 1;
            }
        }
        news
    }

    /// The one that is shown.
    #[cfg(test)]
    pub(crate) fn recording(&self) -> Recording {
        self.recording
    }

    /// The loops' statistics, with a version that changes with them.
    pub(crate) fn loops(&self) -> &Loops {
        &self.loops
    }

    /// What viewers are to know of the scope itself.
    pub(crate) fn status(&self) -> Value {
        json!({
            "left_out_samples": self.left_out_samples,
            "left_out_events": self.left_out_events,
            "left_out_declarations": self.declared.is_short(),
            "span": self.budget.nanos(),
            "problem": self.problem,
            "report": self.report,
            "changes": self.changes.json(),
            "emergency": self.declared.emergency().map(|event| json!({
                "degree": event.arguments[0],
                "process": event.subject,
                // The signal that stopped the program, 0 if none did.
                "signal": event.arguments[1],
                "time": event.time.to_string(),
            })),
        })
    }

    /// Bytes that it holds of blocks.
    #[cfg(test)]
    fn held(&self) -> usize {
        self.samples.held() + self.events.held()
    }
}

/// When what the record reports was; nothing for a declaration.
pub(crate) fn time(record: &Record<'_>) -> Option<u64> {
    match record {
        Record::Sample { time, .. }
        | Record::Message { time, .. }
        | Record::Epoch { time, .. }
        | Record::End { time } => Some(*time),
        Record::Event(event) => Some(event.time),
        _ => None,
    }
}

/// Puts the held samples into the block. Returns how many were left out.
fn give(bucket: &mut Bucket, kept: &mut Kept, signal: u32, of: Type) -> u64 {
    bucket.take(|time, bytes| {
        kept.put(&Record::Sample {
            signal,
            time,
            values: Values::from_bytes(of, bytes),
        });
    })
}

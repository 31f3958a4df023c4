//! The data that the scope keeps: declarations, the last blocks, and counts since the beginning.
//!
//! Its blocks have the format of recordings, and their own numbers.

mod declared;
#[cfg(test)]
mod tests;

use crate::loops::Loops;
use crate::reduce::{Bucket, Budget};
use declared::Declared;
use luna_logger::format::{Encoder, Event, Record, Type, Values};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A block is cut when a viewer reads and this time has passed: two frames of a screen.
const CUT: Duration = Duration::from_millis(30);

/// Samples of more signals than that are left out.
const MAX_FOLLOWED: usize = 4096;

/// The limit of the bytes of declarations; the rest is left out.
const MAX_DECLARED: usize = 1 << 20;

/// Codes of events that always pass: ended, late, emergency, spawned. They are rare, and their
/// order and number matter.
const ALWAYS: [u16; 4] = [4, 11, 12, 13];

#[derive(Debug)]
pub(crate) struct Store {
    encoder: Encoder,
    cut: Instant,
    blocks: VecDeque<Arc<[u8]>>,
    /// The number of the first of them since the beginning of the scope.
    first: u64,
    bytes: usize,
    most_bytes: usize,
    /// The shown recording: viewers begin again with each.
    recording: Recording,
    declared: Declared,
    buckets: BTreeMap<u32, Bucket>,
    budget: Budget,
    loops: Loops,
    left_out_samples: u64,
    left_out_events: u64,
    /// Why nothing more comes, if that is so.
    problem: Option<String>,
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
pub(crate) struct News {
    pub(crate) blocks: Vec<Arc<[u8]>>,
    /// The number of blocks at the beginning that repeat declarations.
    pub(crate) declarations: usize,
    /// How many blocks were gone before it got them.
    pub(crate) missed: u64,
    /// It is of another recording than before, which begins with these blocks of declarations.
    pub(crate) begins: bool,
}

/// How far a viewer is.
#[derive(Debug, Default)]
pub(crate) struct Position {
    recording: Option<Recording>,
    next: u64,
}

impl Store {
    pub(crate) fn new(most_bytes: usize) -> Self {
        Self {
            encoder: Encoder::new(),
            cut: Instant::now(),
            blocks: VecDeque::new(),
            first: 0,
            bytes: 0,
            most_bytes,
            recording: Recording::NONE,
            declared: Declared::default(),
            buckets: BTreeMap::new(),
            budget: Budget::new(),
            loops: Loops::default(),
            left_out_samples: 0,
            left_out_events: 0,
            problem: None,
        }
    }

    /// A recording begins: the data of the previous one is dropped.
    pub(crate) fn begin(&mut self) -> Recording {
        let recording = Recording(self.recording.0 + 1);
        let first = self.first + self.blocks.len() as u64;
        *self = Self::new(self.most_bytes);
        (self.recording, self.first) = (recording, first);
        recording
    }

    /// Sets why the recording ended early, if it is the shown one.
    pub(crate) fn fail(&mut self, of: Recording, problem: String) {
        if of == self.recording {
            self.problem = Some(problem);
        }
    }

    /// Takes a record, if its recording is the shown one. O(its length), except at a change of
    /// span.
    pub(crate) fn take(&mut self, of: Recording, record: &Record<'_>) {
        if of != self.recording {
            return;
        }
        match record {
            Record::Sample {
                signal,
                time,
                values,
            } => self.sample(*signal, *time, *values),
            Record::Event(event) => self.event(event),
            other => {
                if self.declared.take(other) {
                    self.encoder.put(other);
                }
            }
        }
        if self.encoder.is_full() {
            self.cut();
        }
    }

    fn sample(&mut self, signal: u32, time: u64, values: Values<'_>) {
        let span = self.budget.span(time);
        if !self.buckets.contains_key(&signal) && self.buckets.len() >= MAX_FOLLOWED {
            self.left_out_samples += 1;
            return;
        }
        let bucket = self.buckets.entry(signal).or_default();
        let before = self.encoder.len();
        if bucket.is_over(span) {
            self.left_out_samples += give(bucket, &mut self.encoder, signal, values.element_type());
        }
        if bucket.put(span, time, values) {
            self.encoder.put(&Record::Sample {
                signal,
                time,
                values,
            });
        }
        self.budget.count_bytes(self.encoder.len() - before);
    }

    fn event(&mut self, event: &Event) {
        self.loops.take(event);
        self.declared.event(event);
        if self.budget.has_event(event.time) || ALWAYS.contains(&event.code) {
            self.encoder.put(&Record::Event(*event));
        } else {
            self.left_out_events += 1;
        }
    }

    /// Ends the current block, if it is due; kept samples go into it.
    fn cut_if_due(&mut self) {
        if self.cut.elapsed() < CUT {
            return;
        }
        for (signal, bucket) in &mut self.buckets {
            if let Some(of) = self.declared.type_of(*signal) {
                self.left_out_samples += give(bucket, &mut self.encoder, *signal, of);
            }
        }
        self.cut();
    }

    fn cut(&mut self) {
        self.cut = Instant::now();
        if self.encoder.is_empty() {
            return;
        }
        let block: Arc<[u8]> = self.encoder.block().into();
        self.encoder.next();
        self.bytes += block.len();
        self.blocks.push_back(block);
        while self.bytes > self.most_bytes && self.blocks.len() > 1 {
            if let Some(block) = self.blocks.pop_front() {
                self.bytes -= block.len();
                self.first += 1;
            }
        }
    }

    /// The blocks since a viewer's last read: at most `most` bytes of them, or the declarations if
    /// those are longer, beside one block.
    pub(crate) fn news(&mut self, position: &mut Position, most: usize) -> News {
        self.cut_if_due();
        let begins = position.recording != Some(self.recording);
        let mut news = News {
            blocks: Vec::new(),
            declarations: 0,
            missed: 0,
            begins,
        };
        if begins {
            news.blocks = self.declared.blocks();
            (position.recording, position.next) = (Some(self.recording), self.first);
        }
        if position.next < self.first {
            news.missed = self.first - position.next;
            position.next = self.first;
            // What was declared in those that it has missed.
            news.blocks = self.declared.blocks();
        }
        news.declarations = news.blocks.len();
        let mut bytes: usize = news.blocks.iter().map(|block| block.len()).sum();
        // At least one, so that a viewer that gets the declarations repeatedly makes progress.
        while (bytes < most || news.blocks.len() == news.declarations)
            && let Some(block) = self.blocks.get((position.next - self.first) as usize)
        {
            bytes += block.len();
            news.blocks.push(block.clone());
            position.next += 1;
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
            "emergency": self.declared.emergency().map(|event| json!({
                "degree": event.arguments[0],
                "process": event.subject,
                "time": event.time.to_string(),
            })),
        })
    }

    /// Bytes that it holds of blocks.
    #[cfg(test)]
    fn held(&self) -> usize {
        self.blocks.iter().map(|block| block.len()).sum()
    }
}

/// Puts the kept samples into the block. Returns how many were left out.
fn give(bucket: &mut Bucket, encoder: &mut Encoder, signal: u32, of: Type) -> u64 {
    bucket.take(|time, bytes| {
        encoder.put(&Record::Sample {
            signal,
            time,
            values: Values::from_bytes(of, bytes),
        });
    })
}

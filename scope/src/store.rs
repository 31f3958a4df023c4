//! What the scope remembers: what was declared, the last blocks, and what is counted from the beginning.
//!
//! Its blocks are of the recordings' own format, numbered anew.

mod declared;

use crate::loops::Loops;
use crate::reduce::{Bucket, Budget};
use declared::Declared;
use luna_logger::format::{Encoder, Event, Record, Type, Values};
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A block is cut when somebody looks and so much time has gone by: each second frame of a screen.
const CUT: Duration = Duration::from_millis(30);

/// Samples of more signals than that are left out.
const MOST_FOLLOWED: usize = 4096;

/// Codes of events whose order and number matter more than their cost: ended, late, emergency, spawned.
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
    /// Which recording it is: viewers begin anew with each.
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

/// Which of the recordings that a store has begun. Several may come at once: the one that began last is shown, and what is still told of the others is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Recording(u64);

impl Recording {
    /// Before any has begun.
    pub(crate) const NONE: Recording = Recording(1);
}

/// What a viewer has not got yet.
pub(crate) struct News {
    pub(crate) blocks: Vec<Arc<[u8]>>,
    /// So many of them, the first ones, repeat what was declared.
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

    /// A recording begins: what is known of another is forgotten.
    pub(crate) fn begin(&mut self) -> Recording {
        let recording = Recording(self.recording.0 + 1);
        let first = self.first + self.blocks.len() as u64;
        *self = Self::new(self.most_bytes);
        (self.recording, self.first) = (recording, first);
        recording
    }

    /// Says why nothing more comes of a recording, if it is the one that is shown.
    pub(crate) fn fail(&mut self, of: Recording, problem: String) {
        if of == self.recording {
            self.problem = Some(problem);
        }
    }

    /// Takes a record of a recording, if it is the one that is shown. O(its length), but for a change of span.
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
        if !self.buckets.contains_key(&signal) && self.buckets.len() >= MOST_FOLLOWED {
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

    /// Ends the block that is under way, if it is due; what is held of signals goes into it.
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

    /// What has come since a viewer looked last, at most about `most` bytes of it.
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
        let mut bytes = 0;
        while bytes < most
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

    /// What is counted of loops, with a number that changes with it.
    pub(crate) fn loops(&self) -> &Loops {
        &self.loops
    }

    /// What viewers are to know of the scope itself.
    pub(crate) fn status(&self) -> Value {
        json!({
            "left_out_samples": self.left_out_samples,
            "left_out_events": self.left_out_events,
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

/// Puts what a bucket holds into the block; says how many it has left out.
fn give(bucket: &mut Bucket, encoder: &mut Encoder, signal: u32, of: Type) -> u64 {
    bucket.take(|time, bytes| {
        encoder.put(&Record::Sample {
            signal,
            time,
            values: Values::from_bytes(of, bytes),
        });
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_logger::format::{ClockBase, Reader, SignalInfo};

    const MOST: usize = 1 << 20;

    fn begun() -> Store {
        let mut store = Store::new(MOST);
        let recording = store.begin();
        store.take(
            recording,
            &Record::Session {
                system: "machine",
                clock: ClockBase::Virtual,
                written_by: "a test",
            },
        );
        store.take(
            recording,
            &Record::Signal(SignalInfo {
                number: 3,
                element_type: Type::F64,
                elements: 1,
                name: "arm/angle",
                unit: "rad",
                description: "",
            }),
        );
        store
    }

    fn sample(store: &mut Store, time: u64, value: f64) {
        let bytes = value.to_le_bytes();
        let values = Values::from_bytes(Type::F64, &bytes);
        let signal = 3;
        let record = Record::Sample {
            signal,
            time,
            values,
        };
        store.take(store.recording, &record);
    }

    /// The samples in some blocks, which a reader can make sense of by themselves.
    fn samples(blocks: &[Arc<[u8]>]) -> Vec<u64> {
        let mut times = Vec::new();
        let mut file = Encoder::head().to_vec();
        let mut encoder = Encoder::new();
        for (number, block) in (0u32..).zip(blocks) {
            // Numbered anew: a viewer does not look at these.
            encoder.discard();
            let mut block = block.to_vec();
            block[4..8].copy_from_slice(&number.to_le_bytes());
            let checksum = zlib(&block[4..12], &block[16..]);
            block[12..16].copy_from_slice(&checksum.to_le_bytes());
            file.extend(block);
        }
        let mut reader = Reader::new(&file[..]).unwrap();
        while let Some(record) = reader.next().unwrap() {
            if let Record::Sample { time, .. } = record {
                times.push(time);
            }
        }
        times
    }

    fn zlib(head: &[u8], rest: &[u8]) -> u32 {
        let mut state = !0u32;
        for byte in head.iter().chain(rest) {
            state ^= u32::from(*byte);
            for _ in 0..8 {
                state = state >> 1 ^ (0xEDB8_8320 & 0u32.wrapping_sub(state & 1));
            }
        }
        !state
    }

    #[test]
    fn memory_is_bounded_whatever_comes() {
        let mut store = begun();
        for n in 0..1_000_000u64 {
            sample(&mut store, n * 1_000_000, n as f64);
        }
        assert!(store.held() <= MOST, "{}", store.held());
        assert_eq!(store.held(), store.bytes);
        let mut position = Position::default();
        let news = store.news(&mut position, usize::MAX);
        assert!(news.begins && news.missed == 0);
        let times = samples(&news.blocks);
        assert!(times.is_sorted());
        assert!(times.len() > 50_000 && *times.last().unwrap() > 990_000_000_000);
    }

    #[test]
    fn who_comes_late_gets_the_declarations() {
        let mut store = begun();
        for n in 0..200_000u64 {
            sample(&mut store, n * 1_000_000, 0.5);
        }
        // The block with the signal's declaration is gone from memory: the reader would refuse its samples.
        assert!(store.first > 0);
        let news = store.news(&mut Position::default(), usize::MAX);
        assert!(!samples(&news.blocks).is_empty());
    }

    #[test]
    fn who_is_too_slow_is_told_what_it_has_missed() {
        let mut store = begun();
        let mut position = Position::default();
        store.news(&mut position, usize::MAX);
        for n in 0..300_000u64 {
            sample(&mut store, n * 1_000_000, 0.5);
        }
        let news = store.news(&mut position, usize::MAX);
        assert!(news.missed > 0 && !news.begins);
        assert!(!samples(&news.blocks).is_empty());
        assert_eq!(store.news(&mut position, usize::MAX).missed, 0);
    }

    #[test]
    fn a_new_recording_begins_anew_for_all() {
        let mut store = begun();
        let mut position = Position::default();
        assert!(store.news(&mut position, usize::MAX).begins);
        assert!(!store.news(&mut position, usize::MAX).begins);
        store.begin();
        assert!(store.news(&mut position, usize::MAX).begins);
    }

    #[test]
    fn a_million_samples_a_second_are_reduced() {
        let mut store = begun();
        for n in 0..2_000_000u64 {
            sample(&mut store, n * 1000, (n % 977) as f64);
        }
        let left_out = store.status()["left_out_samples"].as_u64().unwrap();
        assert!(left_out > 1_960_000, "{left_out}");
    }

    #[test]
    fn of_too_many_events_the_ones_that_matter_go_on() {
        let mut store = begun();
        let event = |code| Event {
            thread: 0,
            time: 5,
            code,
            subject: 1,
            arguments: [0; 2],
        };
        for _ in 0..crate::reduce::MOST_EVENTS + 10 {
            store.take(store.recording, &Record::Event(event(2)));
        }
        store.take(store.recording, &Record::Event(event(12)));
        let position = &mut Position::default();
        let blocks = store.news(position, usize::MAX).blocks;
        assert_eq!(store.left_out_events, 10);
        assert!(!blocks.is_empty());
    }
}

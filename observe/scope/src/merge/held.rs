//! A record that waits until all programs have reported up to its time.

use super::Out;
use luna_logger::format::{Event, Level, Record, Type, Values};
use std::cmp::Ordering;

/// A record with its time on the common clock.
#[derive(Debug)]
pub(super) struct Held {
    pub(super) time: u64,
    /// Of those of one time, the first that came is the first.
    pub(super) order: u64,
    pub(super) what: What,
}

#[derive(Debug)]
pub(super) enum What {
    Sample(u32, Type, Box<[u8]>),
    Message {
        thread: u32,
        level: Level,
        process: u32,
        truncated: bool,
        target: Box<str>,
        text: Box<str>,
    },
    Event(Event),
}

impl Held {
    /// Of memory.
    pub(super) fn bytes(&self) -> usize {
        let beside = match &self.what {
            What::Sample(_, _, bytes) => bytes.len(),
            What::Message { target, text, .. } => target.len() + text.len(),
            What::Event(_) => 0,
        };
        size_of::<Self>() + beside
    }

    pub(super) fn give(&self, out: Out<'_>) {
        let time = self.time;
        match &self.what {
            What::Sample(signal, of, bytes) => out(&Record::Sample {
                signal: *signal,
                time,
                values: Values::from_bytes(*of, bytes),
            }),
            What::Message {
                thread,
                level,
                process,
                truncated,
                target,
                text,
            } => out(&Record::Message {
                thread: *thread,
                time,
                level: *level,
                process: *process,
                truncated: *truncated,
                target,
                text,
            }),
            What::Event(event) => out(&Record::Event(*event)),
        }
    }
}

impl Ord for Held {
    fn cmp(&self, other: &Self) -> Ordering {
        (self.time, self.order).cmp(&(other.time, other.order))
    }
}

impl PartialOrd for Held {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Held {
    fn eq(&self, other: &Self) -> bool {
        self.order == other.order
    }
}

impl Eq for Held {}

//! A sink that keeps what it takes, and a parser for that.

#![allow(dead_code, reason = "each test file uses some of it")]

use luna_logger::format::{Losing, ReadError, Reader, Record, Value};
use luna_logger::{Level, Sink};
use std::collections::BTreeMap;
use std::io;
use std::sync::{Arc, Mutex};

/// What a sink has taken.
#[derive(Debug, Clone, Default)]
pub(crate) struct Kept(Arc<Mutex<Vec<u8>>>);

impl Kept {
    pub(crate) fn sink(&self) -> KeepingSink {
        KeepingSink(self.clone())
    }

    pub(crate) fn append(&self, bytes: &[u8]) {
        self.0.lock().unwrap().extend_from_slice(bytes);
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().clone()
    }

    /// All of it, which must be whole.
    pub(crate) fn read(&self) -> Content {
        let (content, error) = read(&self.bytes());
        assert!(error.is_none(), "{error:?}");
        assert!(content.has_ended);
        content
    }
}

#[derive(Debug)]
pub(crate) struct KeepingSink(Kept);

impl Sink for KeepingSink {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.0.append(head);
        Ok(())
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.0.append(block);
        Ok(())
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Message {
    pub(crate) level: Level,
    pub(crate) target: String,
    pub(crate) text: String,
    pub(crate) truncated: bool,
}

/// The contents of a recording.
#[derive(Debug, Default)]
pub(crate) struct Content {
    pub(crate) system: String,
    pub(crate) signals: BTreeMap<u32, String>,
    pub(crate) threads: Vec<String>,
    /// By signal, with their times.
    pub(crate) samples: BTreeMap<u32, Vec<(u64, Vec<Value>)>>,
    pub(crate) messages: Vec<Message>,
    pub(crate) lost: BTreeMap<u32, u64>,
    /// By thread.
    pub(crate) lost_messages: BTreeMap<u32, u64>,
    /// Lost on the way, as counted by the receiver.
    pub(crate) lost_blocks: u64,
    pub(crate) epochs: usize,
    pub(crate) has_ended: bool,
    /// The times of all samples and messages, as they come.
    pub(crate) times: Vec<u64>,
}

/// What can be read, and why not more.
pub(crate) fn read(bytes: &[u8]) -> (Content, Option<ReadError>) {
    let mut content = Content::default();
    let mut reader = match Reader::new(bytes) {
        Ok(reader) => reader,
        Err(error) => return (content, Some(error)),
    };
    loop {
        let record = match reader.next() {
            Ok(Some(record)) => record,
            Ok(None) => break,
            Err(error) => return (content, Some(error)),
        };
        match record {
            Record::Session { system, .. } => content.system = system.to_owned(),
            Record::Thread { name, .. } => content.threads.push(name.to_owned()),
            Record::Signal(info) => {
                content.signals.insert(info.number, info.name.to_owned());
            }
            Record::Sample {
                signal,
                time,
                values,
            } => {
                content.times.push(time);
                let of = content.samples.entry(signal).or_default();
                of.push((time, values.iter().collect()));
            }
            Record::Message {
                time,
                level,
                truncated,
                target,
                text,
                ..
            } => {
                content.times.push(time);
                content.messages.push(Message {
                    level,
                    target: target.to_owned(),
                    text: text.to_owned(),
                    truncated,
                });
            }
            Record::Losses {
                of: Losing::Signal(signal),
                lost,
            } => {
                let before = content.lost.insert(signal, lost);
                assert!(before.is_none_or(|before| before <= lost));
            }
            Record::Losses {
                of: Losing::Messages(thread),
                lost,
            } => {
                let before = content.lost_messages.insert(thread, lost);
                assert!(before.is_none_or(|before| before <= lost));
            }
            Record::Losses {
                of: Losing::Blocks,
                lost,
            } => content.lost_blocks = lost,
            Record::Epoch { .. } => content.epochs += 1,
            _ => {}
        }
    }
    content.has_ended = reader.has_ended();
    (content, None)
}

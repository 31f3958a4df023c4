//! MCAP, for Foxglove, Lichtblick and PlotJuggler: a topic for each signal, messages as Foxglove's
//! `Log`, events and losses as topics of their own.
//!
//! Samples are Protocol Buffers, all else is JSON, each with its schema, which all of them read. Times are those of the day where the
//! recording has them, else those of its clock. The file is compressed by lz4.

use super::Converted;
use super::recording::each;
use super::selection::Filter;
use crate::failure::{self, Failure};
use crate::result_file::ResultFile;
use luna_logger::format::json::{self, Topic};
use luna_logger::format::{Level, Losing, Names, Record, protobuf};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use serde_json::json;
use std::collections::HashMap;
use std::path::Path;

/// Foxglove's level of a message: debug, info, warning, error are 1 to 4.
fn level_number(level: Level) -> u8 {
    match level {
        Level::Trace | Level::Debug => 1,
        Level::Info => 2,
        Level::Warn => 3,
        Level::Error => 4,
    }
}

pub(super) fn write(
    input: &Path,
    output: &Path,
    filter: &Filter,
    replaces: bool,
) -> Result<Converted, Failure> {
    let failed = failure::failed::<mcap::McapError>(output);
    let mut file = Mcap::new(ResultFile::create(output, replaces)?).map_err(&failed)?;
    let converted = each(input, filter, |record| file.take(record).map_err(&failed))?;
    file.writer.finish().map_err(&failed)?;
    file.writer.into_inner().finish()?;
    Ok(converted)
}

struct Mcap {
    writer: Writer<ResultFile>,
    signals: HashMap<u32, Channel>,
    /// Of messages, losses and events, by private names.
    others: HashMap<&'static str, Channel>,
    names: Names,
    /// From the recording's clock to the time of day.
    offset: i128,
    has_epoch: bool,
    last: u64,
}

struct Channel {
    id: u16,
    name: String,
    sequence: u32,
}

impl Mcap {
    fn new(output: ResultFile) -> mcap::McapResult<Self> {
        let options = WriteOptions::new()
            .library(concat!("luna ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Lz4));
        Ok(Self {
            writer: options.create(output)?,
            signals: HashMap::new(),
            others: HashMap::new(),
            names: Names::default(),
            offset: 0,
            has_epoch: false,
            last: 0,
        })
    }

    fn channel(&mut self, topic: &Topic) -> mcap::McapResult<Channel> {
        let Topic {
            schema, encoding, ..
        } = topic;
        let of_schema = encoding.of_schema();
        let schema = self
            .writer
            .add_schema(&topic.schema_name, of_schema, schema)?;
        let of_messages = encoding.of_messages();
        let id = self
            .writer
            .add_channel(schema, &topic.name, of_messages, &topic.metadata)?;
        Ok(Channel {
            id,
            name: topic.name.clone(),
            sequence: 0,
        })
    }

    fn take(&mut self, record: &Record<'_>) -> mcap::McapResult<()> {
        self.names.take(record);
        match *record {
            Record::Epoch { time, unix } if !self.has_epoch => {
                // The first alone: steps of the clock of the day do not tear the recording apart.
                self.has_epoch = true;
                self.offset = i128::from(unix) - i128::from(time);
                Ok(())
            }
            Record::Signal(info) => {
                if !self.signals.contains_key(&info.number) {
                    let channel = self.channel(&Topic::of_signal(&info))?;
                    self.signals.insert(info.number, channel);
                }
                Ok(())
            }
            Record::Sample {
                signal,
                time,
                values,
            } => {
                let time = self.time(time);
                // The reader gives no sample that was not declared.
                let Some(channel) = self.signals.get_mut(&signal) else {
                    return Ok(());
                };
                let message = protobuf::sample(values);
                put(&mut self.writer, channel, time, message.as_bytes())
            }
            Record::Message {
                thread,
                time,
                level,
                target,
                text,
                ..
            } => {
                let time = self.time(time);
                let thread = self.names.thread(thread);
                let content = json!({
                    "timestamp": { "sec": time / 1_000_000_000, "nsec": time % 1_000_000_000 },
                    "level": level_number(level),
                    "message": text,
                    "name": format!("{thread}: {target}"),
                    "file": "",
                    "line": 0,
                });
                self.add("messages", of_messages, time, &content.to_string())
            }
            Record::Losses { of, lost } => self.losses(of, lost),
            Record::Event(event) => {
                let time = self.time(event.time);
                let content = json::event(&self.names, &event);
                self.add("events", Topic::of_events, time, &content)
            }
            _ => Ok(()),
        }
    }

    fn losses(&mut self, of: Losing, lost: u64) -> mcap::McapResult<()> {
        let of = match of {
            Losing::Signal(number) => match self.signals.get(&number) {
                Some(channel) => channel.name.clone(),
                None => return Ok(()),
            },
            Losing::Messages(thread) => format!("messages of {}", self.names.thread(thread)),
            Losing::Events(thread) => format!("events of {}", self.names.thread(thread)),
            Losing::Blocks => "blocks on the way".to_owned(),
        };
        let topic = || {
            let properties = json!({ "of": { "type": "string" }, "lost": { "type": "integer" } });
            Topic::new("/luna/losses", "luna.Losses", &properties)
        };
        let content = json!({ "of": of, "lost": lost }).to_string();
        self.add("losses", topic, self.last, &content)
    }

    /// Adds to a channel that is made with what comes first on it.
    fn add(
        &mut self,
        to: &'static str,
        topic: impl FnOnce() -> Topic,
        time: u64,
        content: &str,
    ) -> mcap::McapResult<()> {
        let mut channel = match self.others.remove(to) {
            Some(channel) => channel,
            None => self.channel(&topic())?,
        };
        put(&mut self.writer, &mut channel, time, content.as_bytes())?;
        self.others.insert(to, channel);
        Ok(())
    }

    fn time(&mut self, time: u64) -> u64 {
        let shifted = i128::from(time) + self.offset;
        self.last = u64::try_from(shifted.max(0)).unwrap_or(u64::MAX);
        self.last
    }
}

fn of_messages() -> Topic {
    let properties = json!({
        "timestamp": {
            "type": "object", "title": "time",
            "properties": { "sec": { "type": "integer" }, "nsec": { "type": "integer" } },
        },
        "level": { "type": "integer" },
        "message": { "type": "string" },
        "name": { "type": "string" },
        "file": { "type": "string" },
        "line": { "type": "integer" },
    });
    Topic::new("/luna/log", "foxglove.Log", &properties)
}

fn put(
    writer: &mut Writer<ResultFile>,
    channel: &mut Channel,
    time: u64,
    content: &[u8],
) -> mcap::McapResult<()> {
    let header = MessageHeader {
        channel_id: channel.id,
        sequence: channel.sequence,
        log_time: time,
        publish_time: time,
    };
    channel.sequence = channel.sequence.wrapping_add(1);
    writer.write_to_known_channel(&header, content)
}

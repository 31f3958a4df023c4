//! MCAP, for Foxglove, Lichtblick and PlotJuggler: a topic for each signal, messages as Foxglove's
//! `Log`, events and losses as topics of their own.
//!
//! Messages are JSON with a schema, which all of them read. Times are those of the day where the
//! recording has them, else those of its clock. The file is compressed by zstd.

use super::events::{Names, Words};
use super::recording::each;
use super::selection::Filter;
use super::{Converted, broken, create};
use crate::failure::Failure;
use luna_logger::format::{Event, Level, Losing, Record, SignalInfo, Type, Value, Values};
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use serde_json::{Value as Json, json};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::BufWriter;
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

pub(super) fn write(input: &Path, output: &Path, filter: &Filter) -> Result<Converted, Failure> {
    let failed = broken::<mcap::McapError>(output);
    let mut file = Mcap::new(create(output)?).map_err(&failed)?;
    let converted = each(input, filter, |record| file.take(record).map_err(&failed))?;
    file.writer.finish().map_err(&failed)?;
    Ok(converted)
}

struct Mcap {
    writer: Writer<BufWriter<File>>,
    signals: HashMap<u32, Channel>,
    topics: HashMap<&'static str, Channel>,
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
    fn new(output: BufWriter<File>) -> mcap::McapResult<Self> {
        let options = WriteOptions::new().library(concat!("luna ", env!("CARGO_PKG_VERSION")));
        Ok(Self {
            writer: options.create(output)?,
            signals: HashMap::new(),
            topics: HashMap::new(),
            names: Names::default(),
            offset: 0,
            has_epoch: false,
            last: 0,
        })
    }

    fn channel(
        &mut self,
        topic: &str,
        schema: &str,
        properties: &Json,
        about: &BTreeMap<String, String>,
    ) -> mcap::McapResult<Channel> {
        let described = json!({ "title": schema, "type": "object", "properties": properties });
        let text = described.to_string();
        let schema = self
            .writer
            .add_schema(schema, "jsonschema", text.as_bytes())?;
        let id = self.writer.add_channel(schema, topic, "json", about)?;
        Ok(Channel {
            id,
            name: topic.to_owned(),
            sequence: 0,
        })
    }

    fn signal(&mut self, info: &SignalInfo<'_>) -> mcap::McapResult<()> {
        if self.signals.contains_key(&info.number) {
            return Ok(());
        }
        let one = match info.element_type {
            Type::Bool => json!({ "type": "boolean" }),
            Type::F32 | Type::F64 => json!({ "type": "number" }),
            _ => json!({ "type": "integer" }),
        };
        let value = match info.elements {
            1 => one,
            _ => json!({ "type": "array", "items": one }),
        };
        let schema = format!("luna.{}x{}", info.element_type, info.elements);
        let about = [("unit", info.unit), ("description", info.description)]
            .into_iter()
            .filter(|(_, text)| !text.is_empty())
            .map(|(name, text)| (name.to_owned(), text.to_owned()))
            .collect();
        let topic = format!("/{}", info.name.trim_start_matches('/'));
        let channel = self.channel(&topic, &schema, &json!({ "value": value }), &about)?;
        self.signals.insert(info.number, channel);
        Ok(())
    }

    /// Puts a message into a topic, which is made with its first one.
    fn put(
        &mut self,
        topic: &'static str,
        schema: &str,
        properties: impl FnOnce() -> Json,
        time: u64,
        content: &Json,
    ) -> mcap::McapResult<()> {
        if !self.topics.contains_key(topic) {
            let channel = self.channel(topic, schema, &properties(), &BTreeMap::new())?;
            self.topics.insert(topic, channel);
        }
        match self.topics.get_mut(topic) {
            Some(channel) => put(&mut self.writer, channel, time, content),
            None => Ok(()),
        }
    }

    fn event(&mut self, event: &Event) -> mcap::McapResult<()> {
        let time = self.time(event.time);
        let properties = || {
            let (text, number) = (json!({ "type": "string" }), json!({ "type": "integer" }));
            json!({
                "event": text, "thread": text, "subject": text, "first": text, "second": text,
                "code": number, "number": number,
                "arguments": { "type": "array", "items": number },
            })
        };
        let Words {
            what,
            subject,
            first,
            second,
        } = self.names.words(event);
        let content = json!({
            "event": what,
            "thread": self.thread(event.thread),
            "subject": subject,
            "first": first,
            "second": second,
            "code": event.code,
            "number": event.subject,
            "arguments": event.arguments,
        });
        self.put("/luna/events", "luna.Event", properties, time, &content)
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
            Record::Signal(info) => self.signal(&info),
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
                let content = json!({ "value": value(values) });
                put(&mut self.writer, channel, time, &content)
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
                let properties = || {
                    json!({
                        "timestamp": {
                            "type": "object", "title": "time",
                            "properties": { "sec": { "type": "integer" }, "nsec": { "type": "integer" } },
                        },
                        "level": { "type": "integer" },
                        "message": { "type": "string" },
                        "name": { "type": "string" },
                        "file": { "type": "string" },
                        "line": { "type": "integer" },
                    })
                };
                let thread = self.names.thread(thread).unwrap_or_default();
                let content = json!({
                    "timestamp": { "sec": time / 1_000_000_000, "nsec": time % 1_000_000_000 },
                    "level": level_number(level),
                    "message": text,
                    "name": format!("{thread}: {target}"),
                    "file": "",
                    "line": 0,
                });
                self.put("/luna/log", "foxglove.Log", properties, time, &content)
            }
            Record::Losses { of, lost } => self.losses(of, lost),
            Record::Event(event) => self.event(&event),
            _ => Ok(()),
        }
    }

    fn losses(&mut self, of: Losing, lost: u64) -> mcap::McapResult<()> {
        let of = match of {
            Losing::Signal(number) => match self.signals.get(&number) {
                Some(channel) => channel.name.clone(),
                None => return Ok(()),
            },
            Losing::Messages(thread) => format!("messages of {}", self.thread(thread)),
            Losing::Events(thread) => format!("events of {}", self.thread(thread)),
            Losing::Blocks => "blocks on the way".to_owned(),
        };
        let properties = || json!({ "of": { "type": "string" }, "lost": { "type": "integer" } });
        let content = json!({ "of": of, "lost": lost });
        self.put(
            "/luna/losses",
            "luna.Losses",
            properties,
            self.last,
            &content,
        )
    }

    fn thread(&self, number: u32) -> &str {
        self.names.thread(number).unwrap_or("other threads")
    }

    fn time(&mut self, time: u64) -> u64 {
        let shifted = i128::from(time) + self.offset;
        self.last = u64::try_from(shifted.max(0)).unwrap_or(u64::MAX);
        self.last
    }
}

fn put(
    writer: &mut Writer<BufWriter<File>>,
    channel: &mut Channel,
    time: u64,
    content: &Json,
) -> mcap::McapResult<()> {
    let header = MessageHeader {
        channel_id: channel.id,
        sequence: channel.sequence,
        log_time: time,
        publish_time: time,
    };
    channel.sequence = channel.sequence.wrapping_add(1);
    writer.write_to_known_channel(&header, content.to_string().as_bytes())
}

/// A number as JSON has it: null if it is not finite.
fn value(values: Values<'_>) -> Json {
    let one = |value: Value| match value {
        Value::Bool(value) => json!(value),
        Value::Signed(value) => json!(value),
        Value::Unsigned(value) => json!(value),
        Value::Float(value) => json!(value),
    };
    let mut all: Vec<Json> = values.iter().map(one).collect();
    if all.len() == 1 {
        all.remove(0)
    } else {
        Json::Array(all)
    }
}

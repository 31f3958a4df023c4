//! Records as messages of topics.

use foxglove::messages::{Log, Timestamp, log};
use foxglove::{Channel, Context, FoxgloveError, PartialMetadata, RawChannel, Schema};
use luna_logger::format::{Event, Level, Record, SignalInfo, Subject, Type, Value, Values};
use serde_json::json;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// The topics of one recording, and what their messages need of it.
pub(crate) struct Topics {
    context: Arc<Context>,
    signals: HashMap<u32, Arc<RawChannel>>,
    messages: Option<Channel<Log>>,
    events: Option<Arc<RawChannel>>,
    threads: HashMap<u32, String>,
    /// Of processes, and of the kinds of events.
    names: HashMap<(Subject, u32), String>,
    /// From the recording's clock to the time of day.
    offset: i128,
    has_epoch: bool,
    /// Room for a message.
    text: Vec<u8>,
}

impl Topics {
    pub(crate) fn new(context: &Arc<Context>) -> Self {
        Self {
            context: context.clone(),
            signals: HashMap::new(),
            messages: None,
            events: None,
            threads: HashMap::new(),
            names: HashMap::new(),
            offset: 0,
            has_epoch: false,
            text: Vec::new(),
        }
    }

    /// Makes the topics that do not depend on the recording, so that viewers can subscribe to them
    /// before the first message.
    pub(crate) fn begin(&mut self) -> Result<(), FoxgloveError> {
        let (text, number) = (json!({ "type": "string" }), json!({ "type": "integer" }));
        let properties = json!({
            "event": text, "process": text, "thread": text, "number": number,
            "arguments": { "type": "array", "items": number },
        });
        self.messages = Some(self.context.channel_builder("/luna/log").build());
        self.events =
            Some(self.channel("/luna/events", "luna.Event", &properties, BTreeMap::new())?);
        Ok(())
    }

    fn channel(
        &self,
        topic: &str,
        schema: &str,
        properties: &serde_json::Value,
        about: BTreeMap<String, String>,
    ) -> Result<Arc<RawChannel>, FoxgloveError> {
        let described = json!({ "title": schema, "type": "object", "properties": properties });
        let schema = Schema::new(schema, "jsonschema", described.to_string().into_bytes());
        self.context
            .channel_builder(topic)
            .message_encoding("json")
            .schema(schema)
            .metadata(about)
            .build_raw()
    }

    pub(crate) fn take(&mut self, record: &Record<'_>) -> Result<(), FoxgloveError> {
        match *record {
            Record::Epoch { time, unix } if !self.has_epoch => {
                // The first alone: steps of the clock of the day do not tear the plots apart.
                self.has_epoch = true;
                self.offset = i128::from(unix) - i128::from(time);
            }
            Record::Thread { number, name } => {
                self.threads.insert(number, name.to_owned());
            }
            Record::Name {
                subject: subject @ (Subject::Process | Subject::Code),
                number,
                name,
                ..
            } => {
                self.names.insert((subject, number), name.to_owned());
            }
            Record::Signal(info) => self.declare(&info)?,
            Record::Sample {
                signal,
                time,
                values,
            } => self.sample(signal, time, values),
            Record::Message {
                thread,
                time,
                level,
                target,
                text,
                ..
            } => self.message(thread, time, level, target, text),
            Record::Event(event) => self.event(&event),
            _ => {}
        }
        Ok(())
    }

    fn declare(&mut self, info: &SignalInfo<'_>) -> Result<(), FoxgloveError> {
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
        let channel = self.channel(&topic, &schema, &json!({ "value": value }), about)?;
        self.signals.insert(info.number, channel);
        Ok(())
    }

    fn sample(&mut self, signal: u32, time: u64, values: Values<'_>) {
        let at = self.at(time);
        // The reader gives no sample that was not declared.
        if let Some(channel) = self.signals.get(&signal)
            && channel.has_sinks()
        {
            sample_text(&mut self.text, values);
            channel.log_with_meta(&self.text, at);
        }
    }

    fn message(&self, thread: u32, time: u64, level: Level, target: &str, text: &str) {
        let Some(channel) = self.messages.as_ref().filter(|channel| channel.has_sinks()) else {
            return;
        };
        let level = match level {
            Level::Trace | Level::Debug => log::Level::Debug,
            Level::Info => log::Level::Info,
            Level::Warn => log::Level::Warning,
            Level::Error => log::Level::Error,
        };
        let time = self.time(time);
        let seconds = u32::try_from(time / 1_000_000_000).unwrap_or(u32::MAX);
        let message = Log {
            timestamp: Some(Timestamp::new(seconds, (time % 1_000_000_000) as u32)),
            level: level.into(),
            message: text.to_owned(),
            name: format!("{}: {target}", self.thread(thread)),
            file: String::new(),
            line: 0,
        };
        channel.log_with_meta(&message, PartialMetadata::with_log_time(time));
    }

    fn event(&self, event: &Event) {
        let Some(channel) = self.events.as_ref().filter(|channel| channel.has_sinks()) else {
            return;
        };
        let name = |subject, number: u32| {
            let name = self.names.get(&(subject, number));
            name.map_or("", String::as_str)
        };
        let content = json!({
            "event": name(Subject::Code, event.code.into()),
            "process": name(Subject::Process, event.subject),
            "thread": self.thread(event.thread),
            "number": event.subject,
            "arguments": event.arguments,
        });
        channel.log_with_meta(content.to_string().as_bytes(), self.at(event.time));
    }

    fn thread(&self, number: u32) -> &str {
        let name = self.threads.get(&number);
        name.map_or("other threads", String::as_str)
    }

    /// An instant of the recording's clock, as time of the day.
    fn time(&self, time: u64) -> u64 {
        let shifted = i128::from(time) + self.offset;
        u64::try_from(shifted.max(0)).unwrap_or(u64::MAX)
    }

    fn at(&self, time: u64) -> PartialMetadata {
        PartialMetadata::with_log_time(self.time(time))
    }
}

/// A sample as JSON. A number that is not finite is null, as JSON has it.
fn sample_text(text: &mut Vec<u8>, values: Values<'_>) {
    text.clear();
    text.extend(br#"{"value":"#);
    let is_list = values.len() > 1;
    if is_list {
        text.push(b'[');
    }
    for (number, value) in values.iter().enumerate() {
        if number > 0 {
            text.push(b',');
        }
        // Writing a number to memory does not fail.
        let _ = match value {
            Value::Bool(value) => serde_json::to_writer(&mut *text, &value),
            Value::Signed(value) => serde_json::to_writer(&mut *text, &value),
            Value::Unsigned(value) => serde_json::to_writer(&mut *text, &value),
            Value::Float(value) => serde_json::to_writer(&mut *text, &value),
        };
    }
    if is_list {
        text.push(b']');
    }
    text.push(b'}');
}

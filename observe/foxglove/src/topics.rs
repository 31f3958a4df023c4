//! Records as messages of topics.

use foxglove::messages::{Log, Timestamp, log};
use foxglove::{Channel, Context, FoxgloveError, PartialMetadata, RawChannel, Schema};
use luna_logger::format::json::{self, Topic};
use luna_logger::format::{Event, Level, Names, Record, SignalInfo, Values, protobuf};
use std::collections::HashMap;
use std::sync::Arc;

/// The topics of one recording, and what their messages need of it.
pub(crate) struct Topics {
    context: Arc<Context>,
    signals: HashMap<u32, Arc<RawChannel>>,
    messages: Option<Channel<Log>>,
    events: Option<Arc<RawChannel>>,
    names: Names,
    /// From the recording's clock to the time of day.
    offset: i128,
    has_epoch: bool,
}

impl Topics {
    pub(crate) fn new(context: &Arc<Context>) -> Self {
        Self {
            context: context.clone(),
            signals: HashMap::new(),
            messages: None,
            events: None,
            names: Names::forgetting(),
            offset: 0,
            has_epoch: false,
        }
    }

    /// Makes the topics that do not depend on the recording, so that viewers can subscribe to them
    /// before the first message.
    pub(crate) fn begin(&mut self) -> Result<(), FoxgloveError> {
        self.messages = Some(self.context.channel_builder("/luna/log").build());
        self.events = Some(self.channel(Topic::of_events())?);
        Ok(())
    }

    fn channel(&self, topic: Topic) -> Result<Arc<RawChannel>, FoxgloveError> {
        let schema = Schema::new(topic.schema_name, topic.encoding.of_schema(), topic.schema);
        self.context
            .channel_builder(topic.name)
            .message_encoding(topic.encoding.of_messages())
            .schema(schema)
            .metadata(topic.metadata)
            .build_raw()
    }

    pub(crate) fn take(&mut self, record: &Record<'_>) -> Result<(), FoxgloveError> {
        self.names.take(record);
        match *record {
            Record::Epoch { time, unix } if !self.has_epoch => {
                // The first alone: steps of the clock of the day do not tear the plots apart.
                self.has_epoch = true;
                self.offset = i128::from(unix) - i128::from(time);
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
        let channel = self.channel(Topic::of_signal(info))?;
        self.signals.insert(info.number, channel);
        Ok(())
    }

    fn sample(&mut self, signal: u32, time: u64, values: Values<'_>) {
        let at = self.at(time);
        // The reader gives no sample that was not declared.
        if let Some(channel) = self.signals.get(&signal)
            && channel.has_sinks()
        {
            channel.log_with_meta(protobuf::sample(values).as_bytes(), at);
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
            name: format!("{}: {target}", self.names.thread(thread)),
            file: String::new(),
            line: 0,
        };
        channel.log_with_meta(&message, PartialMetadata::with_log_time(time));
    }

    fn event(&self, event: &Event) {
        let Some(channel) = self.events.as_ref().filter(|channel| channel.has_sinks()) else {
            return;
        };
        let content = json::event(&self.names, event);
        channel.log_with_meta(content.as_bytes(), self.at(event.time));
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

//! Signals and events as messages of topics, the same live in Foxglove and in an MCAP file.
//!
//! Events are JSON. Samples are Protocol Buffers: JSON has no number for NaN and the infinities,
//! and its readers round integers of more than 53 bits.

use super::protobuf;
use super::record::{Event, SignalInfo};
use super::words::{Names, Words};
use serde_json::json;
use std::collections::BTreeMap;

/// How the messages of a topic are encoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// JSON, with a JSON Schema.
    Json,
    /// Protocol Buffers, with a `FileDescriptorSet`.
    Protobuf,
}

impl Encoding {
    /// The name of the messages' encoding, as MCAP and Foxglove have it.
    pub fn of_messages(self) -> &'static str {
        match self {
            Encoding::Json => "json",
            Encoding::Protobuf => "protobuf",
        }
    }

    /// The name of the schema's encoding, as MCAP and Foxglove have it.
    pub fn of_schema(self) -> &'static str {
        match self {
            Encoding::Json => "jsonschema",
            Encoding::Protobuf => "protobuf",
        }
    }
}

/// A topic: what its messages are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name, which begins with `/`.
    pub name: String,
    /// The name of its schema.
    pub schema_name: String,
    /// Its schema.
    pub schema: Vec<u8>,
    /// How the messages and the schema are encoded.
    pub encoding: Encoding,
    /// What else is known of it: `unit` and `description`.
    pub metadata: BTreeMap<String, String>,
}

impl Topic {
    /// A topic of messages in JSON that are objects with these properties.
    pub fn new(name: &str, schema_name: &str, properties: &serde_json::Value) -> Topic {
        let schema = json!({ "title": schema_name, "type": "object", "properties": properties });
        Topic {
            name: name.to_owned(),
            schema_name: schema_name.to_owned(),
            schema: schema.to_string().into_bytes(),
            encoding: Encoding::Json,
            metadata: BTreeMap::new(),
        }
    }

    /// That of a signal, for [`protobuf::sample`]s.
    ///
    /// ```
    /// use luna_logger::format::json::{Encoding, Topic};
    /// use luna_logger::format::{SignalInfo, Type, Values, protobuf};
    ///
    /// let topic = Topic::of_signal(&SignalInfo {
    ///     number: 0,
    ///     element_type: Type::I16,
    ///     elements: 2,
    ///     name: "arm/place",
    ///     unit: "mm",
    ///     description: "",
    /// });
    /// assert_eq!((&*topic.name, &*topic.schema_name), ("/arm/place", "luna.i16x2"));
    /// assert_eq!(topic.encoding, Encoding::Protobuf);
    /// assert_eq!(topic.metadata["unit"], "mm");
    /// let message = protobuf::sample(Values::from_bytes(Type::I16, &[1, 0, 2, 0]));
    /// assert_eq!(message.as_bytes(), [0x0A, 2, 2, 4]); // field 1, two bytes, 1 and 2 in zigzag
    /// ```
    pub fn of_signal(info: &SignalInfo<'_>) -> Topic {
        let (schema_name, schema) = protobuf::schema(info);
        let metadata = [("unit", info.unit), ("description", info.description)]
            .into_iter()
            .filter(|(_, text)| !text.is_empty())
            .map(|(name, text)| (name.to_owned(), text.to_owned()));
        Topic {
            name: format!("/{}", info.name.trim_start_matches('/')),
            schema_name,
            schema: schema.as_bytes().to_vec(),
            encoding: Encoding::Protobuf,
            metadata: metadata.collect(),
        }
    }

    /// That of [`event`]s.
    pub fn of_events() -> Topic {
        let (text, number) = (json!({ "type": "string" }), json!({ "type": "integer" }));
        let properties = json!({
            "event": text, "thread": text, "subject": text, "first": text, "second": text,
            "code": number, "number": number,
            "arguments": { "type": "array", "items": number },
        });
        Topic::new("/luna/events", "luna.Event", &properties)
    }
}

/// An event: in words, and by its numbers.
///
/// ```
/// use luna_logger::format::json::{Topic, event};
/// use luna_logger::format::{Event, Names};
///
/// let one = Event { thread: 1, time: 0, code: 5, subject: 3, arguments: [9, 0] };
/// let text: serde_json::Value = serde_json::from_str(&event(&Names::default(), &one)).unwrap();
/// assert_eq!(text["subject"], "channel 3");
/// assert_eq!(text["first"], "process 9");
/// let schema: serde_json::Value = serde_json::from_slice(&Topic::of_events().schema).unwrap();
/// let keys = |of: &serde_json::Value| -> Vec<String> {
///     of.as_object().unwrap().keys().cloned().collect()
/// };
/// assert_eq!(keys(&text), keys(&schema["properties"]));
/// ```
pub fn event(names: &Names, event: &Event) -> String {
    let Words {
        what,
        subject,
        first,
        second,
    } = names.words(event);
    json!({
        "event": what,
        "thread": names.thread(event.thread),
        "subject": subject,
        "first": first,
        "second": second,
        "code": event.code,
        "number": event.subject,
        "arguments": event.arguments,
    })
    .to_string()
}

//! Signals and events as messages in JSON, the same live in Foxglove and in an MCAP file.

use super::record::{Event, SignalInfo};
use super::types::{Type, Value, Values};
use super::words::{Names, Words};
use serde_json::json;
use std::collections::BTreeMap;

/// A topic of JSON messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its name, which begins with `/`.
    pub name: String,
    /// The name of its schema.
    pub schema_name: String,
    /// Its schema, a JSON Schema.
    pub schema: String,
    /// What else is known of it: `unit` and `description`.
    pub metadata: BTreeMap<String, String>,
}

impl Topic {
    /// A topic of messages that are objects with these properties.
    pub fn new(name: &str, schema_name: &str, properties: &serde_json::Value) -> Topic {
        let schema = json!({ "title": schema_name, "type": "object", "properties": properties });
        Topic {
            name: name.to_owned(),
            schema_name: schema_name.to_owned(),
            schema: schema.to_string(),
            metadata: BTreeMap::new(),
        }
    }

    /// That of a signal, for [`sample`]s.
    ///
    /// ```
    /// use luna_logger::format::json::{Topic, sample};
    /// use luna_logger::format::{SignalInfo, Type, Values};
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
    /// assert_eq!(topic.metadata["unit"], "mm");
    /// let mut text = Vec::new();
    /// sample(&mut text, Values::from_bytes(Type::I16, &[1, 0, 2, 0]));
    /// assert_eq!(text, br#"{"value":[1,2]}"#);
    /// ```
    pub fn of_signal(info: &SignalInfo<'_>) -> Topic {
        let one = match info.element_type {
            Type::Bool => json!({ "type": "boolean" }),
            Type::F32 | Type::F64 => json!({ "type": "number" }),
            _ => json!({ "type": "integer" }),
        };
        let value = match info.elements {
            1 => one,
            _ => json!({ "type": "array", "items": one }),
        };
        let name = format!("/{}", info.name.trim_start_matches('/'));
        let schema = format!("luna.{}x{}", info.element_type, info.elements);
        let mut topic = Topic::new(&name, &schema, &json!({ "value": value }));
        topic.metadata = [("unit", info.unit), ("description", info.description)]
            .into_iter()
            .filter(|(_, text)| !text.is_empty())
            .map(|(name, text)| (name.to_owned(), text.to_owned()))
            .collect();
        topic
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
/// let schema: serde_json::Value = serde_json::from_str(&Topic::of_events().schema).unwrap();
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

/// A sample, written over `text`. A number that is not finite is null, as JSON has it.
pub fn sample(text: &mut Vec<u8>, values: Values<'_>) {
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

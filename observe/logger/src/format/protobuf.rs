//! As much of Protocol Buffers' encoding as Perfetto traces and the messages of signals need.
//!
//! It allocates: nothing here is for the real-time path.

#[cfg(feature = "json")]
use super::record::SignalInfo;
#[cfg(feature = "json")]
use super::types::{Type, Value, Values};

/// A message that is being written, field by field.
///
/// ```
/// use luna_logger::format::protobuf::Message;
/// assert_eq!(Message::default().number(1, 150).as_bytes(), b"\x08\x96\x01");
/// ```
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Message(Vec<u8>);

impl Message {
    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }

    /// A field of an integer type, a boolean or an enumeration.
    pub fn number(mut self, field: u32, value: u64) -> Self {
        self.varint(u64::from(field) << 3);
        self.varint(value);
        self
    }

    /// A field of type `double`.
    pub fn double(mut self, field: u32, value: f64) -> Self {
        self.varint(u64::from(field) << 3 | 1);
        self.0.extend_from_slice(&value.to_le_bytes());
        self
    }

    /// A field of type `fixed64`.
    pub fn fixed(mut self, field: u32, value: u64) -> Self {
        self.varint(u64::from(field) << 3 | 1);
        self.0.extend_from_slice(&value.to_le_bytes());
        self
    }

    /// A field of type `string` or `bytes`.
    pub fn text(mut self, field: u32, text: &str) -> Self {
        self.bytes(field, text.as_bytes());
        self
    }

    /// A field that is a message itself.
    pub fn message(mut self, field: u32, message: &Message) -> Self {
        self.bytes(field, &message.0);
        self
    }

    fn bytes(&mut self, field: u32, bytes: &[u8]) {
        self.varint(u64::from(field) << 3 | 2);
        self.varint(bytes.len() as u64);
        self.0.extend_from_slice(bytes);
    }

    /// It as it is written.
    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    #[cfg(feature = "json")]
    fn element(&mut self, of: Type, value: Value) {
        match value {
            Value::Bool(value) => self.0.push(value.into()),
            // Zigzag: a small negative number is as short as a small positive one.
            Value::Signed(value) => self.varint((value << 1 ^ value >> 63).cast_unsigned()),
            Value::Unsigned(value) => self.varint(value),
            // Exact: it was widened when it was read.
            Value::Float(value) if of == Type::F32 => {
                self.0.extend_from_slice(&(value as f32).to_le_bytes());
            }
            Value::Float(value) => self.0.extend_from_slice(&value.to_le_bytes()),
        }
    }
}

/// The number of the one field of a signal's message.
#[cfg(feature = "json")]
const VALUE: u32 = 1;

/// The message of a sample: its one field `value`, repeated if the signal is an array.
///
/// Every number is exact in it, also one that is not finite and an integer of 64 bits.
#[cfg(feature = "json")]
pub fn sample(values: Values<'_>) -> Message {
    let of = values.element_type();
    let mut elements = Message::default();
    for value in values.iter() {
        elements.element(of, value);
    }
    let mut message = Message::default();
    if values.len() == 1 {
        let wire = match of {
            Type::F32 => 5,
            Type::F64 => 1,
            _ => 0,
        };
        message.varint(u64::from(VALUE) << 3 | wire);
        message.0.append(&mut elements.0);
    } else {
        message.bytes(VALUE, &elements.0);
    }
    message
}

/// The schema of a signal's samples, a `FileDescriptorSet` with one message of the package `luna`,
/// and that message's full name.
#[cfg(feature = "json")]
pub(super) fn schema(info: &SignalInfo<'_>) -> (String, Message) {
    // By `FieldDescriptorProto.Type` and `.Label` of `descriptor.proto`.
    let kind = match info.element_type {
        Type::F64 => 1,
        Type::F32 => 2,
        Type::U64 => 4,
        Type::Bool => 8,
        Type::U8 | Type::U16 | Type::U32 => 13,
        Type::I8 | Type::I16 | Type::I32 => 17,
        Type::I64 => 18,
    };
    let label = if info.elements == 1 { 1 } else { 3 };
    let field = Message::default()
        .text(1, "value")
        .number(3, VALUE.into())
        .number(4, label)
        .number(5, kind)
        .text(10, "value");
    let name = format!("{}x{}", info.element_type, info.elements);
    let described = Message::default().text(1, &name).message(2, &field);
    let file = Message::default()
        .text(1, &format!("luna/{name}.proto"))
        .text(2, "luna")
        .message(4, &described)
        .text(12, "proto3");
    (format!("luna.{name}"), Message::default().message(1, &file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_as_the_specification_has_it() {
        // The specification's own examples: 150 in field 1, "testing" in field 2.
        let message = Message::default().number(1, 150).text(2, "testing");
        assert_eq!(message.as_bytes(), b"\x08\x96\x01\x12\x07testing");
        let outer = Message::default().message(3, &Message::default().number(1, 150));
        assert_eq!(outer.as_bytes(), b"\x1a\x03\x08\x96\x01");
        let double = Message::default().double(1, 1.0);
        assert_eq!(double.as_bytes(), b"\x09\0\0\0\0\0\0\xf0\x3f");
    }

    #[cfg(feature = "json")]
    #[test]
    fn samples_are_exact() {
        let of = |of, bytes: &[u8]| sample(Values::from_bytes(of, bytes)).as_bytes().to_vec();
        // The specification's own examples of zigzag.
        assert_eq!(of(Type::I32, &(-2_i32).to_le_bytes()), b"\x08\x03");
        let least = of(Type::I64, &i64::MIN.to_le_bytes());
        assert_eq!(least, b"\x08\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01");
        assert_eq!(of(Type::I64, &i64::MAX.to_le_bytes())[1], 0xfe);
        assert_eq!(of(Type::U64, &u64::MAX.to_le_bytes()), least);
        assert_eq!(of(Type::Bool, &[1]), b"\x08\x01");
        assert_eq!(
            of(Type::F32, &f32::INFINITY.to_le_bytes()),
            b"\x0d\0\0\x80\x7f"
        );
        assert_eq!(of(Type::I16, &[1, 0, 0xfe, 0xff]), b"\x0a\x02\x02\x03");
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.0] {
            let bytes = value.to_le_bytes();
            assert_eq!(of(Type::F64, &bytes), [&b"\x09"[..], &bytes].concat());
        }
    }
}

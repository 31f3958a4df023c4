//! Types of values, levels of messages, and what losses are counted for.

use std::fmt;

/// The type of a signal's elements, by its number in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum Type {
    /// One byte, 0 or 1.
    Bool = 1,
    /// One byte, two's complement, as all signed types.
    I8 = 2,
    /// Two bytes.
    I16 = 3,
    /// Four bytes.
    I32 = 4,
    /// Eight bytes.
    I64 = 5,
    /// One byte.
    U8 = 6,
    /// Two bytes.
    U16 = 7,
    /// Four bytes.
    U32 = 8,
    /// Eight bytes.
    U64 = 9,
    /// Four bytes, IEEE 754.
    F32 = 10,
    /// Eight bytes, IEEE 754.
    F64 = 11,
}

impl Type {
    /// All of them in the order of their numbers, with the name and the size.
    const ALL: [(Type, &'static str, usize); 11] = [
        (Type::Bool, "bool", 1),
        (Type::I8, "i8", 1),
        (Type::I16, "i16", 2),
        (Type::I32, "i32", 4),
        (Type::I64, "i64", 8),
        (Type::U8, "u8", 1),
        (Type::U16, "u16", 2),
        (Type::U32, "u32", 4),
        (Type::U64, "u64", 8),
        (Type::F32, "f32", 4),
        (Type::F64, "f64", 8),
    ];

    pub(crate) fn from_byte(byte: u8) -> Option<Type> {
        let index = usize::from(byte).checked_sub(1)?;
        Self::ALL.get(index).map(|(one, ..)| *one)
    }

    /// How many bytes an element takes in a recording.
    pub fn size(self) -> usize {
        Self::ALL[self as usize - 1].2
    }

    /// Its name, as Rust has it.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize - 1].1
    }

    /// The value in the lowest bytes of `word`; the other bytes are ignored.
    pub(crate) fn value(self, word: u64) -> Value {
        match self {
            Type::Bool => Value::Bool(word & 0xFF != 0),
            Type::I8 => Value::Signed((word as i8).into()),
            Type::I16 => Value::Signed((word as i16).into()),
            Type::I32 => Value::Signed((word as i32).into()),
            Type::I64 => Value::Signed(word as i64),
            Type::U8 => Value::Unsigned((word as u8).into()),
            Type::U16 => Value::Unsigned((word as u16).into()),
            Type::U32 => Value::Unsigned((word as u32).into()),
            Type::U64 => Value::Unsigned(word),
            Type::F32 => Value::Float(f32::from_bits(word as u32).into()),
            Type::F64 => Value::Float(f64::from_bits(word)),
        }
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// An element of a sample. Its `Display` is its shortest exact text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// Of a boolean.
    Bool(bool),
    /// Of a signed integer.
    Signed(i64),
    /// Of an unsigned integer.
    Unsigned(u64),
    /// Of a floating-point number; an `f32` is exact in it.
    Float(f64),
}

impl Value {
    /// The value as a floating-point number; an integer of more than 53 bits is rounded.
    pub fn as_f64(self) -> f64 {
        match self {
            Value::Bool(value) => f64::from(u8::from(value)),
            Value::Signed(value) => value as f64,
            Value::Unsigned(value) => value as f64,
            Value::Float(value) => value,
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Bool(value) => u8::from(*value).fmt(f),
            Value::Signed(value) => value.fmt(f),
            Value::Unsigned(value) => value.fmt(f),
            Value::Float(value) => value.fmt(f),
        }
    }
}

/// The elements of one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Values<'a> {
    of: Type,
    bytes: &'a [u8],
}

impl<'a> Values<'a> {
    pub(crate) fn new(of: Type, bytes: &'a [u8]) -> Self {
        Self { of, bytes }
    }

    /// The complete elements in `bytes`, little-endian.
    pub fn from_bytes(of: Type, bytes: &'a [u8]) -> Self {
        Self::new(of, &bytes[..bytes.len() - bytes.len() % of.size()])
    }

    /// Their bytes, as in a recording.
    ///
    /// ```
    /// use luna_logger::format::{Type, Values};
    /// assert_eq!(Values::from_bytes(Type::U16, &[1, 2, 3]).bytes(), [1, 2]);
    /// ```
    pub fn bytes(self) -> &'a [u8] {
        self.bytes
    }

    /// Their type.
    pub fn element_type(self) -> Type {
        self.of
    }

    /// How many there are.
    pub fn len(self) -> usize {
        self.bytes.len() / self.of.size()
    }

    /// Whether it has no elements. A reader never returns such values.
    pub fn is_empty(self) -> bool {
        self.bytes.is_empty()
    }

    /// Each of them.
    pub fn iter(self) -> impl Iterator<Item = Value> + 'a {
        self.bytes.chunks_exact(self.of.size()).map(move |bytes| {
            let mut word = [0; 8];
            word[..bytes.len()].copy_from_slice(bytes);
            self.of.value(u64::from_le_bytes(word))
        })
    }
}

/// A message's level, by its number in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Level {
    /// Something has failed.
    Error = 1,
    /// Something may fail soon.
    Warn = 2,
    /// Information for users.
    Info = 3,
    /// Information for developers.
    Debug = 4,
    /// Detailed information for developers, of every step.
    Trace = 5,
}

impl Level {
    /// All of them in the order of their numbers, with the name.
    const ALL: [(Level, &'static str); 5] = [
        (Level::Error, "ERROR"),
        (Level::Warn, "WARN"),
        (Level::Info, "INFO"),
        (Level::Debug, "DEBUG"),
        (Level::Trace, "TRACE"),
    ];

    pub(crate) fn from_byte(byte: u8) -> Option<Level> {
        let index = usize::from(byte).checked_sub(1)?;
        Self::ALL.get(index).map(|(one, _)| *one)
    }

    /// Its name in capitals.
    pub fn name(self) -> &'static str {
        Self::ALL[self as usize - 1].1
    }
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// What the times of a recording count from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum ClockBase {
    /// The machine's monotonic clock.
    Monotonic = 1,
    /// A virtual clock, which has nothing to do with the time of day.
    Virtual = 2,
}

impl ClockBase {
    pub(crate) fn from_byte(byte: u8) -> Option<ClockBase> {
        [ClockBase::Monotonic, ClockBase::Virtual]
            .into_iter()
            .find(|one| *one as u8 == byte)
    }
}

/// Of what something was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Losing {
    /// Samples of the signal with this number.
    Signal(u32),
    /// Messages of the thread with this number.
    Messages(u32),
    /// CSP events of the thread with this number.
    Events(u32),
    /// Blocks on the way to a recorder on another computer, counted by that recorder; their
    /// contents are unknown.
    Blocks,
}

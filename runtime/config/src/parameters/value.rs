//! Values on their way in and out, whatever their types.

use std::fmt;

/// A parameter's value, whatever its type: as it is [set](super::Parameters::set) and
/// [listed](super::Parameters::list).
///
/// Made by `into()` of numbers, `bool`, text, and arrays of numbers.
///
/// ```
/// use luna::parameters::Value;
///
/// let gains: Value = [2.0, 0.5].into();
/// assert_eq!(gains, Value::List(vec![Value::Float(2.0), Value::Float(0.5)]));
/// assert_eq!(gains.to_string(), "[2.0, 0.5]");
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// A number with a fraction.
    Float(f64),
    /// A whole number. A parameter of type `f64` takes it too, if it is that number exactly.
    Integer(i128),
    /// Yes or no.
    Bool(bool),
    /// One of the names of a [`Choice`](super::Choice).
    Text(String),
    /// Of an array.
    List(Vec<Value>),
    /// As it was written: read as the parameter's type asks. `2.5`, `[1, 2]`, `true`, `speed`.
    Written(String),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // Shortest text that gives the same number.
            Value::Float(number) => write!(f, "{number:?}"),
            Value::Integer(number) => number.fmt(f),
            Value::Bool(is) => is.fmt(f),
            Value::Text(text) | Value::Written(text) => f.write_str(text),
            Value::List(values) => {
                f.write_str("[")?;
                for (index, value) in values.iter().enumerate() {
                    let comma = if index == 0 { "" } else { ", " };
                    write!(f, "{comma}{value}")?;
                }
                f.write_str("]")
            }
        }
    }
}

macro_rules! from {
    ($($($of:ty),+ => $make:expr;)*) => {$($(
        impl From<$of> for Value {
            fn from(value: $of) -> Value {
                $make(value)
            }
        }
    )+)*};
}

from! {
    i8, i16, i32, i64, u8, u16, u32, u64 => |number| Value::Integer(i128::from(number));
    f64 => Value::Float;
    // 0.1, and not the f32 nearest to it.
    f32 => |number: f32| Value::Float(number.to_string().parse().unwrap_or(number.into()));
    bool => Value::Bool;
    &str => |text: &str| Value::Text(text.to_owned());
    String => Value::Text;
}

impl<T: Into<Value>, const N: usize> From<[T; N]> for Value {
    fn from(values: [T; N]) -> Value {
        Value::List(values.into_iter().map(Into::into).collect())
    }
}

impl<T: Into<Value>> From<Vec<T>> for Value {
    fn from(values: Vec<T>) -> Value {
        Value::List(values.into_iter().map(Into::into).collect())
    }
}

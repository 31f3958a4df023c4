//! What values a parameter can have, and how they lie in words.

use super::error::Reason;
use super::value::Value;
use crate::nearest::nearest;
use std::fmt;
use std::sync::Arc;

/// What an element is.
#[doc(hidden)]
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    F64,
    F32,
    Integer {
        name: &'static str,
        least: i128,
        most: i128,
    },
    Bool,
    Choice(Arc<[&'static str]>),
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Kind::F64 => f.write_str("f64"),
            Kind::F32 => f.write_str("f32"),
            Kind::Integer { name, .. } => f.write_str(name),
            Kind::Bool => f.write_str("bool"),
            Kind::Choice(names) => write!(f, "one of {}", listed(names)),
        }
    }
}

/// All that decides whether a value can be taken.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Form {
    pub(super) kind: Kind,
    /// How many elements an array has; none if it is none.
    pub(super) elements: Option<usize>,
    /// For each element.
    pub(super) range: Option<(Value, Value)>,
}

impl Form {
    /// The choices.
    pub(super) fn choices(&self) -> Vec<String> {
        match &self.kind {
            Kind::Choice(names) => names.iter().map(|&name| name.to_owned()).collect(),
            _ => Vec::new(),
        }
    }

    /// The type, as the program calls it.
    pub(super) fn type_name(&self) -> String {
        match (self.elements, &self.kind) {
            (Some(elements), kind) => format!("[{kind}; {elements}]"),
            (None, Kind::Choice(_)) => "choice".to_owned(),
            (None, kind) => kind.to_string(),
        }
    }

    /// The words of a value, or why it cannot be one.
    pub(super) fn pack(&self, value: &Value) -> Result<Box<[u64]>, Reason> {
        let wrong = || Reason::WrongType {
            expected: self.expected(),
        };
        let Some(elements) = self.elements else {
            return match value {
                Value::List(_) => Err(wrong()),
                one => Ok([self.element(one)?].into()),
            };
        };
        let written;
        let values = match value {
            Value::List(values) => values,
            Value::Written(text) => {
                let inner = text.trim().strip_prefix('[').ok_or_else(wrong)?;
                let inner = inner.strip_suffix(']').ok_or_else(wrong)?.trim();
                let inner = inner.strip_suffix(',').unwrap_or(inner);
                let parts = inner.split(',').filter(|_| !inner.is_empty());
                written = parts
                    .map(|part| Value::Written(part.to_owned()))
                    .collect::<Vec<_>>();
                &written
            }
            _ => return Err(wrong()),
        };
        if values.len() != elements {
            return Err(Reason::WrongLength {
                expected: elements,
                found: values.len(),
            });
        }
        values.iter().map(|value| self.element(value)).collect()
    }

    /// The value in these words.
    pub(super) fn unpack(&self, words: &[u64]) -> Value {
        let mut values = words.iter().map(|&word| self.read(word));
        match self.elements {
            Some(_) => Value::List(values.collect()),
            None => values.next().unwrap_or(Value::Bool(false)),
        }
    }

    fn read(&self, word: u64) -> Value {
        match &self.kind {
            Kind::F64 => Value::Float(f64::from_bits(word)),
            Kind::F32 => f32::from_bits(word as u32).into(),
            Kind::Integer { least, .. } if *least < 0 => Value::Integer((word as i64).into()),
            Kind::Integer { .. } => Value::Integer(word.into()),
            Kind::Bool => Value::Bool(word != 0),
            Kind::Choice(names) => {
                Value::Text(names.get(word as usize).copied().unwrap_or("").to_owned())
            }
        }
    }

    fn element(&self, value: &Value) -> Result<u64, Reason> {
        let wrong = || Reason::WrongType {
            expected: self.expected(),
        };
        let read;
        let value = match value {
            Value::Written(text) => {
                read = self.parse(text.trim()).ok_or_else(wrong)?;
                &read
            }
            value => value,
        };
        let word = match (&self.kind, value) {
            (Kind::F64 | Kind::F32, Value::Float(number)) if !number.is_finite() => {
                return Err(Reason::NotFinite);
            }
            (Kind::F64 | Kind::F32, Value::Float(number)) => self.float(*number)?,
            (Kind::F64 | Kind::F32, Value::Integer(number)) => {
                let float = *number as f64;
                if float as i128 != *number {
                    return Err(Reason::NotExact);
                }
                self.float(float)?
            }
            (Kind::Integer { least, most, .. }, Value::Integer(number)) => {
                if !(least..=most).contains(&number) {
                    return Err(self.out_of_range());
                }
                *number as u64
            }
            (Kind::Bool, Value::Bool(is)) => u64::from(*is),
            (Kind::Choice(names), Value::Text(text)) => {
                match names.iter().position(|name| name == text) {
                    Some(index) => index as u64,
                    None => {
                        return Err(Reason::NoSuchChoice {
                            choices: listed(names),
                            nearest: nearest(text, names.iter().copied()).map(str::to_owned),
                        });
                    }
                }
            }
            _ => return Err(wrong()),
        };
        match self.is_within(word) {
            true => Ok(word),
            false => Err(self.out_of_range()),
        }
    }

    fn float(&self, number: f64) -> Result<u64, Reason> {
        match self.kind {
            Kind::F32 if !(number as f32).is_finite() => Err(self.out_of_range()),
            Kind::F32 => Ok(u64::from((number as f32).to_bits())),
            _ => Ok(number.to_bits()),
        }
    }

    /// What was written, as a value of this type.
    fn parse(&self, text: &str) -> Option<Value> {
        match &self.kind {
            Kind::F64 | Kind::F32 => text.parse().ok().map(Value::Float),
            Kind::Integer { .. } => text.parse().ok().map(Value::Integer),
            Kind::Bool => text.parse().ok().map(Value::Bool),
            Kind::Choice(_) => Some(Value::Text(text.trim_matches('"').to_owned())),
        }
    }

    fn is_within(&self, word: u64) -> bool {
        let Some((least, most)) = &self.range else {
            return true;
        };
        // An f32 is read as its limits are written: 0.1 lies within 0.0 to 0.1.
        match (self.read(word), least, most) {
            (Value::Float(number), Value::Float(least), Value::Float(most)) => {
                (least..=most).contains(&&number)
            }
            (Value::Integer(number), Value::Integer(least), Value::Integer(most)) => {
                (least..=most).contains(&&number)
            }
            _ => true,
        }
    }

    fn out_of_range(&self) -> Reason {
        let (least, most) = match (&self.range, &self.kind) {
            (Some((least, most)), _) => (least.to_string(), most.to_string()),
            (None, Kind::Integer { least, most, .. }) => (least.to_string(), most.to_string()),
            (None, _) => (f32::MIN.to_string(), f32::MAX.to_string()),
        };
        Reason::OutOfRange { least, most }
    }

    /// What a value has to be, in words.
    fn expected(&self) -> String {
        let (one, several) = match &self.kind {
            Kind::F64 | Kind::F32 => ("a number".to_owned(), "numbers"),
            Kind::Integer { .. } => ("a whole number".to_owned(), "whole numbers"),
            Kind::Bool => ("true or false".to_owned(), "true or false"),
            Kind::Choice(names) => (format!("one of {}", listed(names)), "names"),
        };
        match self.elements {
            Some(elements) => format!("a list of {elements} {several}"),
            None => one,
        }
    }
}

fn listed(names: &[&str]) -> String {
    names.join(", ")
}

//! Values of types that a program learns when it runs: for tools that print and send what other
//! programs exchange.
//!
//! Both programs of a channel state their type by name, size and alignment. A type that is made of
//! numbers, truth values and characters says by its name how it lies in memory: `f64`, `[i32; 3]`,
//! `[[bool; 2]; 4]`. So do strings of serde. Values of others can be received as bytes, and not
//! sent.
//!
//! ```
//! use luna_ipc::any::AnyType;
//! use luna_ipc::{Blackboard, look};
//!
//! let name = format!("doc/{}/any", std::process::id());
//! let writer = Blackboard::new(&name).entry("speed", [1.5_f32, -2.0]).write()?;
//! let found = look::at(&name)?.unwrap();
//! let key = &found.keys[0];
//! let value = AnyType::of(&key.value)?.read(&key.bytes)?;
//! assert_eq!(value.to_string(), "[1.5, -2.0]");
//! assert_eq!(value.of().parse("1.5 -2").unwrap(), value);
//! # drop(writer);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod form;
mod scalar;
mod value;

pub use value::AnyValue;

use crate::codec::Codec;
use crate::error::TypeInfo;
use crate::look::Kind;
use crate::{Endpoint, IpcError, ReceiveLink, SendLink, blackboard};
use form::Form;
use luna::{Receiver, Sender};
use std::sync::Arc;

/// A type of values, as the programs of a channel or the writer of a blackboard state it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnyType(Arc<Parts>);

#[derive(Debug, PartialEq, Eq)]
struct Parts {
    info: TypeInfo,
    form: Form,
}

/// Why values of a type cannot be had, read from bytes, or made of a text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AnyError {
    /// The type does not say how its values lie in memory.
    #[error(
        "values of {info} cannot be printed: only numbers, bool, char, arrays of them and serde's String; others as bytes"
    )]
    Form {
        /// The type.
        info: Box<TypeInfo>,
    },
    /// It is no type of single values.
    #[error("{info} is that of a {}: its values cannot be had from outside", kind.word())]
    Kind {
        /// What is stated.
        info: Box<TypeInfo>,
        /// What that is.
        kind: Kind,
    },
    /// The bytes are none of this type.
    #[error("{found} bytes are no value of {info}")]
    Bytes {
        /// The type.
        info: Box<TypeInfo>,
        /// How many bytes there are.
        found: usize,
    },
    /// The text is none of this type.
    #[error("`{text}` is no value of type `{name}`: {why}")]
    Text {
        /// The text.
        text: String,
        /// The type's name.
        name: String,
        /// What is wrong.
        why: String,
    },
}

impl AnyType {
    /// The type, if it says how its values lie in memory.
    ///
    /// # Errors
    ///
    /// [`AnyError::Form`], [`AnyError::Kind`].
    pub fn of(info: &TypeInfo) -> Result<Self, AnyError> {
        let form = match Kind::of(info) {
            Kind::Channel => Form::plain(info),
            Kind::Serde => Form::of_serde(info),
            kind => return Err(Self::refused(info, kind)),
        };
        let info = info.clone();
        match form {
            Some(form) => Ok(Self(Arc::new(Parts { info, form }))),
            None => Err(AnyError::Form {
                info: Box::new(info),
            }),
        }
    }

    /// The type, with values that are bytes, whatever they mean: they can be received and read, and
    /// not sent or set.
    ///
    /// # Errors
    ///
    /// [`AnyError::Kind`].
    pub fn raw(info: &TypeInfo) -> Result<Self, AnyError> {
        let form = match Kind::of(info) {
            Kind::Channel => Form::Raw(info.size as usize),
            Kind::Serde => Form::RawSerde(info.size as usize),
            kind => return Err(Self::refused(info, kind)),
        };
        let info = info.clone();
        Ok(Self(Arc::new(Parts { info, form })))
    }

    fn refused(info: &TypeInfo, kind: Kind) -> AnyError {
        let info = Box::new(info.clone());
        AnyError::Kind { info, kind }
    }

    fn is_raw(&self) -> bool {
        matches!(self.0.form, Form::Raw(_) | Form::RawSerde(_))
    }

    /// What the programs state.
    pub fn info(&self) -> &TypeInfo {
        &self.0.info
    }

    /// A value of its bytes, as they lie in memory.
    ///
    /// # Errors
    ///
    /// [`AnyError::Bytes`]: they are too few or too many, or no string.
    pub fn read(&self, bytes: &[u8]) -> Result<AnyValue, AnyError> {
        let value = self.0.form.value(bytes);
        let bytes = value.ok_or_else(|| AnyError::Bytes {
            info: Box::new(self.0.info.clone()),
            found: bytes.len(),
        })?;
        Ok(AnyValue::new(self.clone(), bytes))
    }

    /// A value of a text: a number; `true` or `false`; a character; the elements of an array,
    /// separated by commas or spaces, with or without brackets; for a string the text as it is.
    ///
    /// ```
    /// use luna_ipc::any::AnyType;
    /// use luna_ipc::{Blackboard, look};
    ///
    /// let name = format!("doc/{}/parse", std::process::id());
    /// let writer = Blackboard::new(&name).entry("grid", [[0_u8; 2]; 2]).write()?;
    /// let key = look::at(&name)?.unwrap().keys.remove(0);
    /// let grid = AnyType::of(&key.value)?;
    /// assert_eq!(grid.parse("[[1, 2], [3, 4]]")?.to_string(), "[[1, 2], [3, 4]]");
    /// assert_eq!(grid.parse("1 2 3 4")?, grid.parse("[[1,2],[3,4]]")?);
    /// assert!(grid.parse("1 2 3").is_err() && grid.parse("1 2 3 256").is_err());
    /// # drop(writer);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`AnyError::Text`]. So it is for all values of a [raw](Self::raw) type.
    pub fn parse(&self, text: &str) -> Result<AnyValue, AnyError> {
        let made = self.0.form.parse(text);
        let bytes = made.map_err(|why| AnyError::Text {
            text: text.to_owned(),
            name: self.0.info.name.clone(),
            why,
        })?;
        Ok(AnyValue::new(self.clone(), bytes))
    }
}

impl Codec<AnyValue> {
    fn any(of: &AnyType) -> Self {
        let (sent, received) = (of.clone(), of.clone());
        let write = move |value: &AnyValue| match *value.of() == sent {
            true if sent.is_raw() => Err("what its bytes mean is not known".to_owned()),
            true => Ok(sent.0.form.laid_out(value.bytes())),
            false => Err(format!("it is one of {}", value.of().info())),
        };
        let read = move |bytes: &[u8]| {
            let value = received.0.form.taken_up(bytes);
            let value = value.and_then(|bytes| received.read(&bytes).ok());
            value.ok_or_else(|| "its bytes are no value of that type".to_owned())
        };
        Self::bytes(of.0.info.clone(), of.0.form.room(), write, read)
    }
}

impl Endpoint {
    /// As [`sender`](Self::sender), for a type that is known when the program runs. The layout
    /// version is that of the type. Not for the real-time path: each value allocates.
    ///
    /// # Errors
    ///
    /// As there.
    ///
    /// ```
    /// use luna_ipc::any::AnyType;
    /// use luna_ipc::{Endpoint, look};
    ///
    /// let name = format!("doc/{}/any-sender", std::process::id());
    /// let (receiver, link) = luna_ipc::receiver::<u16>(&name)?; // of another program
    /// let found = look::at(&name)?.unwrap();
    /// let of = AnyType::of(&found.value)?;
    /// let (sender, link_of_sender) = Endpoint::new(&name).any_sender(&of)?;
    /// # drop((receiver, link, sender, link_of_sender));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn any_sender(
        &self,
        of: &AnyType,
    ) -> Result<(Sender<AnyValue>, SendLink<AnyValue>), IpcError> {
        self.sending(Codec::any(of), luna::channel())
    }

    /// As [`receiver`](Self::receiver), for a type that is known when the program runs. The layout
    /// version is that of the type. Not for the real-time path: each value allocates.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn any_receiver(
        &self,
        of: &AnyType,
    ) -> Result<(Receiver<AnyValue>, ReceiveLink<AnyValue>), IpcError> {
        self.receiving(Codec::any(of))
    }
}

/// Sets the value of one key of a blackboard that readers have open, and that no program writes:
/// this program is its writer for so long. Returns the number of the value.
///
/// Not for the real-time path: as [`Blackboard::write`](crate::Blackboard::write).
///
/// # Errors
///
/// [`IpcError`]: a program writes it, none reads it, it has no such key, or the value is of another
/// type than the key's.
///
/// ```
/// use luna_ipc::any::{self, AnyType};
/// use luna_ipc::{Blackboard, look};
///
/// let name = format!("doc/{}/set", std::process::id());
/// let writer = Blackboard::new(&name).entry("speed", 0.0_f64).write()?;
/// let speed = Blackboard::new(&name).read()?.entry::<f64>("speed")?;
/// drop(writer); // the reader keeps it open
/// let key = look::at(&name)?.unwrap().keys.remove(0);
/// let value = AnyType::of(&key.value)?.parse("0.25")?;
/// assert_eq!(any::set(&name, "speed", &value)?, 2);
/// assert_eq!(speed.get()?.value, 0.25);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn set(name: &str, key: &str, value: &AnyValue) -> Result<u64, IpcError> {
    if value.of().is_raw() {
        return Err(IpcError::Key {
            name: name.to_owned(),
            key: key.to_owned(),
            why: "cannot be set to bytes whose meaning is not known",
        });
    }
    blackboard::set(name, key, value)
}

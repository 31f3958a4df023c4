//! A value of a type that is known at run time.

use super::AnyType;
use std::fmt;

/// A value of an [`AnyType`]. It shows as Rust writes it, a string without quotes, and bytes in
/// hexadecimal digits; with the feature `serde` it can be serialized, as JSON for example.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AnyValue {
    of: AnyType,
    bytes: Vec<u8>,
}

impl AnyValue {
    /// The bytes are a value of the type.
    pub(super) fn new(of: AnyType, bytes: Vec<u8>) -> Self {
        Self { of, bytes }
    }

    /// Its type.
    pub fn of(&self) -> &AnyType {
        &self.of
    }

    /// Its bytes: as they lie in memory, or in serde's encoding by postcard.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl fmt::Display for AnyValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.of.0.form.print(&self.bytes, f)
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for AnyValue {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        self.of.0.form.serialize(&self.bytes, to)
    }
}

//! Values and their records outside of the program.

use thiserror::Error;

/// A value that a record of a device turns into.
///
/// The conversion runs in the link's process on the real-time path: it must not allocate or block.
///
/// ```
/// use luna::external::{FromBytes, Malformed};
///
/// #[derive(Debug, PartialEq)]
/// struct Tilt { roll: i16, pitch: i16 }
///
/// impl FromBytes for Tilt {
///     fn from_bytes(bytes: &[u8]) -> Result<Tilt, Malformed> {
///         let &[a, b, c, d, sum] = bytes else { return Err(Malformed("a tilt has 5 bytes")) };
///         if sum != a ^ b ^ c ^ d {
///             return Err(Malformed("the check sum is wrong"));
///         }
///         Ok(Tilt { roll: i16::from_le_bytes([a, b]), pitch: i16::from_le_bytes([c, d]) })
///     }
/// }
///
/// assert_eq!(Tilt::from_bytes(&[2, 0, 3, 0, 1]), Ok(Tilt { roll: 2, pitch: 3 }));
/// ```
pub trait FromBytes: Sized {
    /// Makes the value of a record's bytes, without what frames them.
    ///
    /// # Errors
    ///
    /// They mean nothing: then [`from_bad`](Self::from_bad) is called.
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed>;

    /// The value for a record that is broken or means nothing. Without one, which is the default,
    /// the link ends with the error.
    ///
    /// # Errors
    ///
    /// No value stands for it: the error as it came.
    fn from_bad(bad: BadRecord) -> Result<Self, BadRecord> {
        Err(bad)
    }
}

/// A channel of results gets broken records as errors, in their order, and the link goes on with
/// the next.
impl<T: FromBytes> FromBytes for Result<T, BadRecord> {
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        T::from_bytes(bytes).map(Ok)
    }

    fn from_bad(bad: BadRecord) -> Result<Self, BadRecord> {
        Ok(Err(bad))
    }
}

impl<const N: usize> FromBytes for [u8; N] {
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        bytes
            .try_into()
            .map_err(|_| Malformed("its length is not that of the array"))
    }
}

/// A value that can be written as a record.
///
/// The conversion runs in the link's process on the real-time path: it must not allocate or block.
///
/// ```
/// use luna::external::ToBytes;
///
/// struct Torque(f32);
///
/// impl ToBytes for Torque {
///     fn length(&self) -> usize { 4 }
///     fn to_bytes(&self, to: &mut [u8]) { to.copy_from_slice(&self.0.to_le_bytes()) }
/// }
/// # let mut bytes = [0; 4];
/// # Torque(1.0).to_bytes(&mut bytes);
/// # assert_eq!(bytes, 1.0_f32.to_le_bytes());
/// ```
pub trait ToBytes {
    /// How many bytes it has, without what frames them.
    fn length(&self) -> usize;

    /// Writes it, to exactly that many bytes.
    fn to_bytes(&self, to: &mut [u8]);
}

impl<const N: usize> ToBytes for [u8; N] {
    fn length(&self) -> usize {
        N
    }

    fn to_bytes(&self, to: &mut [u8]) {
        to.copy_from_slice(self);
    }
}

/// Why bytes mean nothing, in words: "the check sum is wrong".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Error)]
#[error("{0}")]
pub struct Malformed(
    /// The reason.
    pub &'static str,
);

/// A record that cannot be read or written, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Error)]
#[error("record {number} {fault}")]
#[non_exhaustive]
pub struct BadRecord {
    /// Which of the link's records it is, counted from 1, the bad ones included.
    pub number: u64,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What is wrong with a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Error)]
#[non_exhaustive]
pub enum Fault {
    /// It has more bytes than the framing allows. When it is read, it is skipped.
    #[error("has more than the {most} bytes that its framing allows")]
    TooLong {
        /// How many the framing allows.
        most: usize,
    },
    /// The file ended within it.
    #[error("was cut off by the end of the file after {came} bytes")]
    Cut {
        /// How many of its bytes came, with those that frame it.
        came: usize,
    },
    /// Its bytes mean nothing.
    #[error("cannot be decoded: {0}")]
    Malformed(Malformed),
    /// A record to be written has not the one length that the framing allows.
    #[error("has {length} bytes, but the framing is of {fixed} each")]
    WrongLength {
        /// The length it has.
        length: usize,
        /// The length of all records.
        fixed: usize,
    },
    /// A record to be written contains the byte that ends records, so it would be read as two.
    #[error("contains `{}`, which ends records", .delimiter.escape_ascii())]
    HoldsDelimiter {
        /// That byte.
        delimiter: u8,
    },
    /// A record to be written has no bytes: the reader could not see that it was there.
    #[error("has no bytes, which its framing cannot show")]
    Empty,
}

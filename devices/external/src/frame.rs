//! Bytes that are a value of their own.

use super::record::{FromBytes, Malformed, ToBytes};
use std::fmt;
use std::ops::Deref;

/// Up to `N` bytes with their length, in the value itself: what a channel carries without
/// allocation when a record is not decoded.
///
/// It moves with all its room, used or not, so take a small `N`: for long records decode to a type
/// of your own.
///
/// A slice of bytes in all uses, and `write!` appends text to it.
///
/// ```
/// use luna::external::Frame;
/// use std::fmt::Write;
///
/// let mut line = Frame::<16>::EMPTY;
/// write!(line, "speed {}", 12)?;
/// assert_eq!(line.text(), Ok("speed 12"));
/// assert!(Frame::<4>::new(b"longer").is_none());
/// # Ok::<(), std::fmt::Error>(())
/// ```
#[derive(Clone, Copy)]
pub struct Frame<const N: usize> {
    length: usize,
    bytes: [u8; N],
}

impl<const N: usize> Frame<N> {
    /// No bytes.
    pub const EMPTY: Self = Self {
        length: 0,
        bytes: [0; N],
    };

    /// These bytes, if there is room for them. O(length); it may be called on the real-time path,
    /// as all of a frame.
    ///
    /// ```
    /// assert_eq!(&*luna::external::Frame::<4>::new(b"abc").unwrap(), b"abc");
    /// ```
    pub fn new(bytes: &[u8]) -> Option<Self> {
        let mut frame = Self::EMPTY;
        frame.append(bytes).then_some(frame)
    }

    /// Appends these bytes if there is room for all of them. Returns whether there was.
    ///
    /// ```
    /// let mut frame = luna::external::Frame::<4>::EMPTY;
    /// assert!(frame.append(b"abc"));
    /// assert!(!frame.append(b"de"));
    /// assert_eq!(&*frame, b"abc");
    /// ```
    #[must_use = "false: nothing was appended"]
    pub fn append(&mut self, bytes: &[u8]) -> bool {
        let Some(room) = self.bytes[self.length..].get_mut(..bytes.len()) else {
            return false;
        };
        room.copy_from_slice(bytes);
        self.length += bytes.len();
        true
    }

    /// The bytes as text.
    ///
    /// # Errors
    ///
    /// They are not UTF-8.
    pub fn text(&self) -> Result<&str, std::str::Utf8Error> {
        std::str::from_utf8(self)
    }
}

impl<const N: usize> Deref for Frame<N> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl<const N: usize> Default for Frame<N> {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl<const N: usize> PartialEq for Frame<N> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<const N: usize> Eq for Frame<N> {}

impl<const N: usize> PartialEq<[u8]> for Frame<N> {
    fn eq(&self, other: &[u8]) -> bool {
        **self == *other
    }
}

impl<const N: usize> fmt::Write for Frame<N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if self.append(text.as_bytes()) {
            Ok(())
        } else {
            Err(fmt::Error)
        }
    }
}

impl<const N: usize> fmt::Debug for Frame<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Frame(b\"{}\")", self.escape_ascii())
    }
}

impl<const N: usize> FromBytes for Frame<N> {
    fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        Frame::new(bytes).ok_or(Malformed("it does not fit in its `Frame`"))
    }
}

impl<const N: usize> ToBytes for Frame<N> {
    fn length(&self) -> usize {
        self.length
    }

    fn to_bytes(&self, to: &mut [u8]) {
        to.copy_from_slice(self);
    }
}

//! Values in, framed bytes out.

use super::error::LinkError;
use super::framing::{Framing, Kind};
use super::record::{BadRecord, Fault, ToBytes};

/// Frames one record at a time for writing: for links of your own. It allocates when it is made,
/// and then no more; all else of it is for the real-time path.
///
/// ```
/// use luna::external::{Frame, Framing, Packer, Prefix};
///
/// let mut packer = Packer::new(Framing::prefixed(Prefix::U8, 10))?;
/// let record = Frame::<10>::new(b"abc").unwrap();
/// assert_eq!(packer.pack(&record), Ok(&b"\x03abc"[..]));
/// assert_eq!(packer.packed(), b"\x03abc"); // to write it once more
/// # Ok::<(), luna::external::LinkError>(())
/// ```
#[derive(Debug)]
pub struct Packer {
    framing: Framing,
    buffer: Box<[u8]>,
    /// How much of it is the record packed last.
    packed: usize,
    /// Of the record packed last.
    number: u64,
}

impl Packer {
    /// One for this framing.
    ///
    /// # Errors
    ///
    /// [`LinkError::Room`] or [`LinkError::PrefixTooSmall`].
    pub fn new(framing: Framing) -> Result<Self, LinkError> {
        framing.validate()?;
        let around = match framing.kind {
            Kind::Prefixed(prefix) => prefix.size(),
            Kind::Delimited { .. } => 1,
            _ => 0,
        };
        Ok(Self {
            framing,
            buffer: vec![0; framing.most + around].into_boxed_slice(),
            packed: 0,
            number: 0,
        })
    }

    /// The bytes to write for `value`. O(their number).
    ///
    /// # Errors
    ///
    /// The value cannot be written in this framing, with its number, counted from 1.
    pub fn pack(&mut self, value: &impl ToBytes) -> Result<&[u8], BadRecord> {
        self.number += 1;
        self.packed = 0;
        let number = self.number;
        self.packed = self
            .frame(value)
            .map_err(|fault| BadRecord { number, fault })?;
        Ok(self.packed())
    }

    /// The bytes of the record that was packed last; none if there was none, or it could not be
    /// packed.
    pub fn packed(&self) -> &[u8] {
        &self.buffer[..self.packed]
    }

    fn frame(&mut self, value: &impl ToBytes) -> Result<usize, Fault> {
        let (length, most) = (value.length(), self.framing.most);
        match self.framing.kind {
            Kind::Fixed if length != most => {
                return Err(Fault::WrongLength {
                    length,
                    fixed: most,
                });
            }
            Kind::Packets if length == 0 => return Err(Fault::Empty),
            _ if length > most => return Err(Fault::TooLong { most }),
            _ => {}
        }
        let begin = match self.framing.kind {
            Kind::Prefixed(prefix) => {
                prefix.write(length, &mut self.buffer);
                prefix.size()
            }
            _ => 0,
        };
        let mut end = begin + length;
        value.to_bytes(&mut self.buffer[begin..end]);
        if let Kind::Delimited { delimiter, .. } = self.framing.kind {
            if self.buffer[..end].contains(&delimiter) {
                return Err(Fault::HoldsDelimiter { delimiter });
            }
            self.buffer[end] = delimiter;
            end += 1;
        }
        Ok(end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Frame, Prefix};

    #[track_caller]
    fn packs(framing: Framing, value: &[u8], expected: Result<&[u8], Fault>) {
        let mut packer = Packer::new(framing).unwrap();
        let value = Frame::<16>::new(value).unwrap();
        // Twice, so that nothing of the first is left in the second.
        for number in 1..=2 {
            let expected = expected.map_err(|fault| BadRecord { number, fault });
            assert_eq!(packer.pack(&value), expected);
        }
    }

    #[test]
    fn each_framing() {
        packs(Framing::fixed(3), b"abc", Ok(b"abc"));
        packs(Framing::lines(3), b"abc", Ok(b"abc\n"));
        packs(Framing::lines(3), b"", Ok(b"\n"));
        packs(Framing::delimited(b';', 3), b"a\n", Ok(b"a\n;"));
        packs(Framing::prefixed(Prefix::U8, 3), b"ab", Ok(b"\x02ab"));
        packs(
            Framing::prefixed(Prefix::U16Big, 300),
            b"ab",
            Ok(b"\0\x02ab"),
        );
        packs(
            Framing::prefixed(Prefix::U32Little, 3),
            b"",
            Ok(b"\0\0\0\0"),
        );
        packs(Framing::chunks(3), b"ab", Ok(b"ab"));
        packs(Framing::chunks(3), b"", Ok(b""));
        packs(Framing::packets(3), b"abc", Ok(b"abc"));
    }

    #[test]
    fn what_no_reader_would_understand() {
        for length in [2, 4] {
            let fault = Fault::WrongLength { length, fixed: 3 };
            packs(Framing::fixed(3), &b"abcd"[..length], Err(fault));
        }
        let too_long = Err(Fault::TooLong { most: 3 });
        packs(Framing::lines(3), b"abcd", too_long);
        packs(Framing::prefixed(Prefix::U8, 3), b"abcd", too_long);
        packs(Framing::chunks(3), b"abcd", too_long);
        packs(Framing::packets(3), b"abcd", too_long);
        packs(Framing::packets(3), b"", Err(Fault::Empty));
        let delimiter = b'\n';
        packs(
            Framing::lines(3),
            b"a\nb",
            Err(Fault::HoldsDelimiter { delimiter }),
        );
    }
}

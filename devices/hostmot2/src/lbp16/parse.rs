//! Parsing of packets, for a card.

use super::{Command, Reader};

/// One command of a packet with its data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Operation<'a> {
    /// The command.
    pub command: Command,
    /// The data to be written: as long as [`Command::data_len`], empty if it reads.
    pub data: &'a [u8],
}

/// Why the rest of a packet cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseError {
    /// It ends within a command, its address or its data.
    #[error("the packet ends within a command")]
    Truncated,
    /// A command transfers nothing.
    #[error("a command transfers no elements")]
    NoElements,
}

/// The commands of a packet, in order. An error ends them.
///
/// ```
/// use hostmot2::lbp16::{Operations, ParseError};
///
/// let mut operations = Operations::new(&[0x01, 0x42, 0x00, 0x01, 0x01]);
/// let cookie = operations.next().unwrap()?;
/// assert_eq!(cookie.command.address, Some(0x0100));
/// assert_eq!(operations.next(), Some(Err(ParseError::Truncated)));
/// assert_eq!(operations.next(), None);
/// # Ok::<(), ParseError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Operations<'a> {
    rest: &'a [u8],
}

impl<'a> Operations<'a> {
    /// The commands of `packet`.
    pub fn new(packet: &'a [u8]) -> Self {
        Self { rest: packet }
    }

    fn parse(&mut self) -> Result<Operation<'a>, ParseError> {
        let mut reader = Reader::new(self.rest);
        let word = reader.u16().ok_or(ParseError::Truncated)?;
        let address = match Command::has_address(word) {
            true => Some(reader.u16().ok_or(ParseError::Truncated)?),
            false => None,
        };
        let command = Command::from_word(word, address).ok_or(ParseError::NoElements)?;
        let due = if command.write { command.data_len() } else { 0 };
        let (data, rest) = reader
            .rest()
            .split_at_checked(due)
            .ok_or(ParseError::Truncated)?;
        self.rest = rest;
        Ok(Operation { command, data })
    }
}

impl<'a> Iterator for Operations<'a> {
    type Item = Result<Operation<'a>, ParseError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let parsed = self.parse();
        if parsed.is_err() {
            self.rest = &[];
        }
        Some(parsed)
    }
}

impl std::iter::FusedIterator for Operations<'_> {}

//! Creation of packets.

use super::{Command, MAX_COUNT, MAX_PACKET, Space, Width};

/// A packet under construction. Its buffer is allocated at the start.
#[derive(Debug, Clone)]
pub struct Packet {
    bytes: Vec<u8>,
    answer_len: usize,
}

/// Why a command does not go into a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PacketError {
    /// It transfers nothing, or more than [`MAX_COUNT`] elements, or its data is not a whole number
    /// of elements.
    #[error("a command transfers 1 to {MAX_COUNT} whole elements, this one does not")]
    Count,
    /// The packet or its answer would be longer than [`MAX_PACKET`].
    #[error("a packet and its answer have at most {MAX_PACKET} bytes each; make two of it")]
    Full,
}

impl Packet {
    /// An empty packet. Allocates.
    pub fn new() -> Self {
        Self {
            bytes: Vec::with_capacity(MAX_PACKET),
            answer_len: 0,
        }
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.answer_len = 0;
    }

    /// The bytes to send.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The length of the answer, in bytes; 0 if there is none.
    pub fn answer_len(&self) -> usize {
        self.answer_len
    }

    /// Adds a read of `count` elements from `address` on.
    ///
    /// # Errors
    ///
    /// [`PacketError`]; the packet is as before then.
    pub fn read(
        &mut self,
        space: Space,
        width: Width,
        address: u16,
        count: u8,
    ) -> Result<&mut Self, PacketError> {
        let command = Command {
            write: false,
            info: false,
            space,
            width,
            increment: true,
            count,
            address: Some(address),
        };
        // One element needs no increment, and cards' manuals write it so.
        self.push(
            Command {
                increment: count > 1,
                ..command
            },
            &[],
        )
    }

    /// Adds a write of `data` from `address` on.
    ///
    /// # Errors
    ///
    /// [`PacketError`]; the packet is as before then.
    pub fn write(
        &mut self,
        space: Space,
        width: Width,
        address: u16,
        data: &[u8],
    ) -> Result<&mut Self, PacketError> {
        let elements = data.len() / width.bytes();
        let count = u8::try_from(elements).map_err(|_| PacketError::Count)?;
        self.push(
            Command {
                write: true,
                info: false,
                space,
                width,
                increment: count > 1,
                count,
                address: Some(address),
            },
            data,
        )
    }

    /// Adds a write of one 32-bit register of HostMot2.
    ///
    /// # Errors
    ///
    /// As [`write`](Self::write).
    pub fn write_register(&mut self, address: u16, value: u32) -> Result<&mut Self, PacketError> {
        self.write(
            Space::HostMot2,
            Width::Bits32,
            address,
            &value.to_le_bytes(),
        )
    }

    /// Adds `command`, with its `data` if it writes. O(data).
    ///
    /// # Errors
    ///
    /// [`PacketError`]; the packet is as before then.
    pub fn push(&mut self, command: Command, data: &[u8]) -> Result<&mut Self, PacketError> {
        let due = if command.write { command.data_len() } else { 0 };
        if command.count == 0 || command.count > MAX_COUNT || data.len() != due {
            return Err(PacketError::Count);
        }
        let read = command.data_len() - due;
        let address = if command.address.is_some() { 2 } else { 0 };
        if self.bytes.len() + 2 + address + due > MAX_PACKET || self.answer_len + read > MAX_PACKET
        {
            return Err(PacketError::Full);
        }
        self.bytes.extend_from_slice(&command.word().to_le_bytes());
        if let Some(address) = command.address {
            self.bytes.extend_from_slice(&address.to_le_bytes());
        }
        self.bytes.extend_from_slice(data);
        self.answer_len += read;
        Ok(self)
    }
}

impl Default for Packet {
    fn default() -> Self {
        Self::new()
    }
}

//! Emergency messages of nodes.

use super::NodeId;
use super::nmt::frame;
use crate::Frame;
use std::fmt;

/// An EMCY message: a node reports an error, or that there is none any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Emergency {
    /// Whose.
    pub node: NodeId,
    /// The error code; 0 means that no error is left.
    pub code: u16,
    /// The error register (object 1001h).
    pub register: u8,
    /// What the manufacturer adds.
    pub data: [u8; 5],
}

impl Emergency {
    /// Whether it reports that no error is left.
    pub fn is_reset(&self) -> bool {
        self.code >> 8 == 0
    }

    /// The kind of its error, by the standard.
    pub fn meaning(&self) -> &'static str {
        match self.code >> 8 {
            0x00 => "no error",
            0x10 => "generic error",
            0x20 => "current",
            0x21 => "current at the input",
            0x22 => "current inside the device",
            0x23 => "current at the output",
            0x30 => "voltage",
            0x31 => "mains voltage",
            0x32 => "voltage inside the device",
            0x33 => "voltage at the output",
            0x40 => "temperature",
            0x41 => "ambient temperature",
            0x42 => "device temperature",
            0x50 => "device hardware",
            0x60 => "device software",
            0x61 => "internal software",
            0x62 => "user software",
            0x63 => "data set",
            0x70 => "additional modules",
            0x80 => "monitoring",
            0x81 => "communication",
            0x82 => "protocol error",
            0x90 => "external error",
            0xF0 => "additional functions",
            0xFF => "device specific",
            _ => "of no kind of the standard",
        }
    }

    /// Its message.
    pub fn frame(&self) -> Frame {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.data;
        frame(
            self.node.emergency(),
            &[low, high, self.register, a, b, c, d, e],
        )
    }

    /// The message of a frame, if it is one.
    pub fn decode(frame: &Frame) -> Option<Self> {
        let &[low, high, register, a, b, c, d, e] = frame.data() else {
            return None;
        };
        Some(Self {
            node: NodeId::of(frame.standard_id()?, 0x80)?,
            code: u16::from_le_bytes([low, high]),
            register,
            data: [a, b, c, d, e],
        })
    }
}

impl fmt::Display for Emergency {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, code, .. } = self;
        write!(f, "{node}: {code:04X}h, {}", self.meaning())
    }
}

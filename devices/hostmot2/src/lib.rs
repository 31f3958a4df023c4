//! Mesa Electronics' Anything I/O cards over Ethernet: the protocol LBP16, and the functions of the
//! HostMot2 firmware.
//!
//! | module | contents |
//! | --- | --- |
//! | [`lbp16`] | packets: commands, creation, parsing |
//! | [`registers`] | HostMot2's registers and their bits |
//! | [`idrom`] | the card's description of itself: modules, pins, clocks |
//! | [`Client`] | blocking exchanges, for set-up: [`Client::describe`] |
//! | [`Layout`] | the two packets of a control cycle, and the answer |
//! | [`encoder`] | 16-bit counters as positions of 64 bits, rates by time stamp |
//! | [`pwm`] | duties as registers |
//! | [`Bucket`] | the limit of errors |
//!
//! Only [`Client`] does I/O. The rest computes on bytes, allocates nothing after creation
//! (exceptions are documented), and never panics on its input.
//!
//! ```
//! use hostmot2::lbp16::{Packet, Space, Width};
//!
//! let mut packet = Packet::new();
//! packet.read(Space::HostMot2, Width::Bits32, 0x0100, 1)?;
//! assert_eq!(packet.bytes(), [0x01, 0x42, 0x00, 0x01]); // asks for the cookie
//! assert_eq!(packet.answer_len(), 4);
//! # Ok::<(), hostmot2::lbp16::PacketError>(())
//! ```
//!
//! # How answers are identified
//!
//! An answer of LBP16 has only data. So each request writes a number into the card's scratch
//! registers and reads it back: an answer with another number is late, doubled or foreign, and is
//! not used. The write packet of a cycle leaves a number too, which the next answer contains: so a
//! lost or overtaken write is detected. The start packet leaves a third number, which no other
//! packet writes: so a card that was restarted or has another master is detected, even if it drives
//! nothing.

#![forbid(unsafe_code)]

mod bucket;
mod client;
mod cycle;
mod description;
pub mod encoder;
pub mod idrom;
mod layout;
pub mod lbp16;
pub mod pwm;
pub mod registers;
mod selection;

pub use bucket::Bucket;
pub use client::{Client, ClientError};
pub use cycle::{Answer, AnswerError, EchoState, Outputs, RawEncoder};
pub use description::{Board, Description};
pub use layout::{Layout, SequenceWindow};
pub use selection::{LayoutError, OutputPin, Selection};

/// The UDP port on which cards listen.
pub const PORT: u16 = 27181;

/// Random cases from the seed `LUNA_SEED`; without it always the same.
#[cfg(test)]
fn seeded() -> proptest::test_runner::Config {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    proptest::test_runner::Config {
        rng_seed: proptest::test_runner::RngSeed::Fixed(seed.unwrap_or(20_261_121)),
        failure_persistence: None,
        ..Default::default()
    }
}

//! What the processes of LUNA do, as a recording thread takes it.
//!
//! [`ByteRing`]: bytes that one thread writes while another reads them.

// The model is the same for either checker: shuttle has loom's names.
#[cfg(shuttle)]
extern crate shuttle as loom;

mod byte_ring;

pub use byte_ring::ByteRing;

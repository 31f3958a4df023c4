//! What the processes of LUNA do, event by event, as a recorder takes it.
//!
//! The kernel [reports](report) events of a thread that is traced, and [names](name) what it makes
//! (`luna_core::events`). This crate has what is between those and the recorder:
//!
//! - [`code`]: what events are there.
//! - [`ring`]: the ring of a thread's events; [`attach`] lets a thread write to one.
//! - [`listen`]: the names of processes, channels and loops.
//! - [`sub_turn`], [`name_in_ring`], [`waits_in`]: what the framework reports beside the kernel.
//! - [`ByteRing`]: bytes that one thread writes while another reads them, for recordings of a run.
//!
//! Without the feature `events` no thread is traced, and there is no ring of events.

#![cfg_attr(
    not(feature = "events"),
    allow(
        rustdoc::broken_intra_doc_links,
        reason = "the page speaks of what `events` has"
    )
)]

// The model is the same for either checker: shuttle has loom's names.
#[cfg(shuttle)]
extern crate shuttle as loom;

mod byte_ring;
#[cfg(not(loom))]
pub mod code;
#[cfg(all(feature = "events", not(loom)))]
mod names;
#[cfg(not(loom))]
mod parts;
#[cfg(any(all(feature = "events", not(loom)), all(test, loom)))]
mod ring;
#[cfg(all(feature = "events", not(loom)))]
mod waits_in;

pub use byte_ring::ByteRing;
#[cfg(not(loom))]
pub use luna_core::events::{
    Kind, begin_turn, current_process, done, end_turn, is_on, name, name_executor, name_process,
    note_failure, report, report_executor,
};
#[cfg(not(loom))]
pub use parts::{TEXT, TEXT_HEAD, name_in_ring, sub_turn};
#[cfg(all(feature = "events", not(loom)))]
pub use {
    luna_core::events::detach,
    names::{Name, Names, is_for, listen},
    ring::{Losses, Reader, Writer, attach, ring},
    waits_in::{WaitsIn, waits_in},
};

/// The future itself.
#[cfg(not(any(feature = "events", loom)))]
#[inline(always)]
pub fn waits_in<F>(_: (Kind, u32), future: F) -> F {
    future
}

//! The core of LUNA: the parts that channels and executors share, so that they work together
//! without depending on each other, and low-level parts of `src`.
//!
//! - [`current`]: the process that this thread polls, how it is woken, and its priority. Only this
//!   module knows how a process becomes ready.
//! - [`wait_list`], [`timer_queue`]: intrusive lists of waiting operations, and deadlines.
//! - [`biased_lock`]: the lock of channels, select states and timer queues, biased towards the
//!   executor that alone uses it.
//! - [`deferred_free`], [`arc_cache`], [`byte_ring`]: memory off the real-time path, and bytes that
//!   one thread writes while another reads them.
//! - [`failover`], [`park`], [`spin`]: how threads take turns, wait and spin.
//!   Only `src` uses [`failover`] and [`byte_ring`].
//! - [`events`], [`replay_log`], [`path`]: recording, replaying and checking a run.
//! - `fetch`, `model_local` (private): prefetches, and thread-locals that a model checker sees.

#![cfg_attr(
    not(feature = "std"),
    no_std,
    allow(
        rustdoc::broken_intra_doc_links,
        reason = "the pages speak of what `std` has"
    )
)]
#![allow(
    clippy::new_without_default,
    reason = "what is made here belongs to one thread or system: made on purpose, not by default"
)]

// The model is the same whichever tool checks it: shuttle has loom's names.
#[cfg(shuttle)]
extern crate shuttle as loom;

extern crate alloc;

#[cfg(all(test, not(feature = "std")))]
compile_error!("the unit tests need `std`: tests without it are in the package `luna-bare`");

pub mod arc_cache;
pub mod biased_lock;
#[cfg(feature = "std")]
pub mod byte_ring;
pub mod current;
pub mod deferred_free;
pub mod events;
#[cfg(feature = "std")]
pub mod failover;
mod fetch;
mod model_local;
pub mod park;
pub mod path;
pub mod replay_log;
pub mod spin;
pub mod timer_queue;
pub mod wait_list;

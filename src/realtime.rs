//! The real-time path: whether this thread is on it ([`on_path`]), how it leaves it for a moment
//! ([`off_path`]), whether the system refused priority inheritance ([`refused_boosts`]), and how a
//! program that a process starts gets back what its executor has given up ([`ordinary_child`]).
//!
//! A program that a process starts by `std::process` runs on the core that its executor or thread
//! is pinned to, beside the real-time processes, and does not get SIGINT, SIGTERM, SIGHUP and
//! SIGQUIT, which those threads block. It has an ordinary policy. `ordinary_child` lets it run on
//! all cores of this program and take signals:
//!
//! ```
//! use luna::prelude::*;
//! use luna::realtime::ordinary_child;
//! use std::process::Command;
//!
//! let mut system = System::new("camera");
//! let control = system.executor("control").core(0).build()?;
//! control.process("starter").spawn(async {
//!     // A program is started off the path: it takes milliseconds.
//!     let ended = luna::blocking(|| ordinary_child(&mut Command::new("true")).status()).await;
//!     let _ = ended;
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! ```
//! use luna::realtime::{off_path, on_path};
//!
//! luna::run(async {
//!     assert!(!off_path(on_path));
//!     let room = off_path(|| Vec::<u64>::with_capacity(1000)); // allocates on purpose
//!     assert!(room.capacity() >= 1000);
//!     Ok(())
//! })?;
//! # Ok::<(), luna::Error>(())
//! ```

pub use luna_core::current::on_path;
pub use luna_core::path::off_path;
pub use luna_machine::threads::ordinary_child;

use crate::report::Shortfall;

/// The boosts that the system has refused.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct RefusedBoosts {
    /// How often it happened.
    pub count: u32,
    /// The first of them.
    pub first: Shortfall,
}

/// Whether the system has refused to let a thread inherit a priority, which is no error: the
/// process then runs at its thread's own priority. Reads files; not for the real-time path.
///
/// ```
/// // No boost was refused, since no process has inherited.
/// assert_eq!(luna::realtime::refused_boosts(), None);
/// ```
pub fn refused_boosts() -> Option<RefusedBoosts> {
    let (count, priority, number) = luna_core::current::refused_boosts()?;
    let first = Shortfall::of_inheritance(priority, number);
    Some(RefusedBoosts { count, first })
}

//! The real-time path: whether this thread is on it ([`on_path`]), how it leaves it for a moment
//! ([`off_path`]), and whether the system refused priority inheritance ([`refused_boosts`]).
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

pub use luna_core::current::{RefusedBoosts, on_path, refused_boosts};
pub use luna_core::path::off_path;

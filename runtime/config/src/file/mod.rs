//! Reading TOML files that people write: system files here, models in
//! `luna-model`. Each error has
//! its line and column, what stands there, and what to do. For LUNA's own crates: it may change
//! with each release.

mod problem;
#[cfg(feature = "toml")]
mod table;
#[cfg(feature = "toml")]
mod values;

pub use problem::{Problem, Source, nearest, of_environment};
#[cfg(feature = "toml")]
pub use table::{Entry, entries, parse};
#[cfg(feature = "toml")]
pub use values::{core, policy, policy_of_any, time, time_or_none};

/// Why a file is not read.
#[cfg(not(feature = "toml"))]
pub(crate) const NO_TOML: &str =
    "this program reads no TOML; build luna-rt with its feature `toml`";

/// The greatest priority of a process.
pub const MAX_PRIORITY: i64 = luna_core::current::LEVELS as i64 - 1;
/// The greatest number of a core.
pub const MAX_CORE: i64 = 4095;

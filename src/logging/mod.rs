//! Signals, messages and recordings: what the system has of `luna-logger`, or nothing at all
//! without the feature `logger`.
//!
//! Both files define the same names, so that the rest of the library, and a user's processes, are
//! the same with and without.

#[cfg(feature = "logger")]
#[path = "on.rs"]
mod logger;
#[cfg(not(feature = "logger"))]
#[path = "off.rs"]
mod logger;

pub use logger::*;

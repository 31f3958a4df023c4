//! Tests of the logger. One program; a module a subject.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../../../tests/shared/mod.rs"]
#[macro_use]
mod shared;

#[cfg(feature = "events")]
mod events;
#[cfg(all(feature = "log", feature = "tracing"))]
mod facades;
mod format;
mod killed;
#[cfg(feature = "events")]
mod names;
mod network;
mod no_executor;
mod places;
mod recording;

//! Tests of plants, their links and FMUs. One program; a module a subject.

#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

#[cfg(feature = "fmi")]
mod fmu;
mod link;

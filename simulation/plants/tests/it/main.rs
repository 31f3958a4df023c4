//! Tests of plants, their links and FMUs. One program; a module a subject.

#[cfg(feature = "fmi")]
mod fmu;
mod link;

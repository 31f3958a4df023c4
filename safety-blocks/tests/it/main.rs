//! Tests of the safety blocks. One program; a module a subject.

#[path = "../common/mod.rs"]
mod common;

mod on_plants;
mod processes;
mod properties;
mod safe_axis;

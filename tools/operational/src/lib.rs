//! The operational model of LUNA's channels and processes, random networks, and the check of traces
//! against the model. See `docs/internals/proof.md`.
//!
//! A crate of its own, so that tests build it with optimization: following states is most of their
//! work. `tests/it/operational/` of `luna-rt` runs the networks.

#![allow(
    missing_docs,
    missing_debug_implementations,
    reason = "for one test program of the workspace alone"
)]

pub mod check;
pub mod generate;
pub mod model;
pub mod network;
pub mod simulate;
pub mod states;

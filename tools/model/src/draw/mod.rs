//! Drawings of composition and communication.

mod dot;
pub(crate) mod layout;
mod mermaid;
mod picture;
mod sequence;
mod svg;

pub(crate) use dot::dot;
pub(crate) use mermaid::mermaid;
pub(crate) use sequence::sequence;
pub(crate) use svg::svg;

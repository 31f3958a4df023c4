//! Drawings of composition and communication.

mod dot;
mod labels;
pub(crate) mod layout;
mod mermaid;
mod picture;
mod route;
mod sequence;
mod svg;

pub(crate) use dot::dot;
pub(crate) use mermaid::mermaid;
pub(crate) use sequence::sequence;
pub(crate) use svg::svg;

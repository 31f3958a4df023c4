//! Texts of models, and what is wrong in them: as in the files that programs read.

pub use luna::error::Problem;
pub(crate) use luna::file::{Source, nearest};

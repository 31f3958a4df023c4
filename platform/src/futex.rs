//! A word that threads can wait on.

pub use crate::backend::futex::Futex;

/// How a wait ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waited {
    /// Woken, or the word had changed, or for no reason: look again.
    Woken,
    /// The deadline came.
    TimedOut,
}

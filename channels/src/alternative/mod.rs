//! Alternatives: several operations are offered, one of them happens.

mod after;
mod choice;
mod guard;
mod locks;
mod macros;
mod offer;
mod partner;
mod ready_set;
mod registered;
mod stop;
mod when;

pub use after::{After, after, at};
pub use choice::{Choice, choose};
pub use guard::Guard;
pub(crate) use guard::{Attempt, RawGuard, Terms, own_seed};
pub use offer::{Either, Never, Offer, Place, Seed, guard, no_guard};
pub(crate) use partner::{Commit, commit};
pub(crate) use registered::Entry;
pub use registered::{Alternative, AlternativeRecv};
#[cfg(not(loom))]
pub(crate) use stop::with_stopped;
pub use when::{Due, When};

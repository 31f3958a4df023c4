//! Alternatives: several operations are offered, one of them happens.

mod after;
mod choose;
mod fast_path;
mod guard;
mod list;
mod macros;
mod ready_set;
mod registered;
mod select;
mod stop;
mod when;

pub use after::{After, after, at};
pub(crate) use fast_path::{Commit, PlainGuard, commit, take_first};
pub use guard::Guard;
pub(crate) use guard::{Attempt, RawGuard, Terms, own_seed};
pub use list::{Cons, Either, Guards, Never, Nil, Seed, Seeds, Skip, guard};
pub(crate) use registered::Entry;
pub use registered::{Alternative, AlternativeRecv};
pub use select::{Select, select};
#[cfg(not(loom))]
pub(crate) use stop::with_stopped;
pub use when::{Due, When};

//! The humanoid head of the thesis (appendix A.3): four axes of a neck and three of two eyes follow
//! a target that cameras see.
//!
//! [`network::build`] adds the processes to a system. [`vision`] finds the target, [`motion`] and
//! [`kinematics`] make set-points of it, [`pid`] brings the joints there, [`safety`] is the layer
//! before the hardware. [`mechanics`] is the simulated machine, [`outcome`] judges a run, and
//! [`parameters`] has all figures. `examples/head/README.md` is the page about it.

pub mod kinematics;
pub mod mechanics;
pub mod messages;
pub mod motion;
pub mod network;
pub mod outcome;
pub mod parameters;
pub mod pid;
pub mod safety;
pub mod vision;

pub use mechanics::{Fault, Trouble};
pub use network::{Head, Place, Settings};
pub use outcome::Findings;

/// The head from above and from the side, for `Settings::picture` of the scope, which moves what is
/// bound to signals in it.
pub const PICTURE: &str = include_str!("head.svg");

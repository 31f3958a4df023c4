//! TUlip, the walking robot of the thesis (appendix A.4): modules in layers from non to hard
//! real-time, with simulated mechanics.
//!
//! [`network::build`] adds the processes to a system. [`world`] is the world model, [`gait`]
//! decides on steps, [`balance`] keeps the robot up by set-points of the joints, with [`legs`] as
//! the kinematics. [`controllers`] are exchanged while it walks, and [`safety`] is the module
//! before the actuators. [`mechanics`] is the simulated robot and says what is modelled,
//! [`outcome`] judges a run, and [`parameters`] has all figures. `examples/tulip/README.md` is the
//! page about it.

pub mod balance;
pub mod controllers;
pub mod gait;
pub mod legs;
pub mod mechanics;
pub mod messages;
pub mod network;
pub mod outcome;
pub mod parameters;
mod processes;
pub mod safety;
pub mod world;

pub use mechanics::{Fault, Trouble};
pub use network::{Place, Settings, Tulip};
pub use outcome::Findings;

/// The robot from above and its legs from the side, for `Settings::picture` of the scope, which
/// moves what is bound to signals in it.
pub const PICTURE: &str = include_str!("tulip.svg");

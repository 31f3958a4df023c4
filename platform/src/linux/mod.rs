//! The complete backend: Linux, through `nix` where it has the call and `libc` where it has not.

mod alternate_stack;
pub mod boost;
pub(crate) mod clock;
mod deadline;
pub mod fence;
pub(crate) mod futex;
pub mod inside;
pub mod lock;
pub(crate) mod privileges;
pub(crate) mod reactor;
pub(crate) mod thread;

//! The complete backend: Linux, through `nix` where it has the call and `libc` where it has not.

pub(crate) mod clock;
pub mod futex;
pub mod lock;

//! The backend without an operating system: one CPU, and its interrupts.
//!
//! It is picked by the absence of the feature `std`. A program gives it a [`Port`]: a clock, and a
//! way to idle and to end that. The critical section comes from the crate `critical-section`, which
//! has implementations for most chips. docs/no-std.md shows a whole port.
//!
//! # Contexts
//!
//! What is a thread elsewhere is a *context* here: the program is one, and each [`interrupt`] that
//! is running is another. A context has thread-locals of its own ([`Local`]), so code in an
//! interrupt looks to channels and executors like another thread. It runs no executor, and its
//! wakes take the way of a remote thread's: a few bits, and the port's [`wake`](Port::wake) if the
//! executor idles.
//!
//! # Locks
//!
//! A lock ([`lock`]) is the critical section: an interrupt cannot wait for what it has interrupted.
//! Locks are biased as elsewhere, since the fast paths rely on it; but the owner of a bias enters
//! by beginning the critical section ([`inside`]). So an interrupt that revokes a bias finds the
//! owner outside, and waits for nothing. docs/no-std.md lists what runs with interrupts disabled.
//!
//! # Allocation and panics
//!
//! Nothing here allocates. Panics end the program: nothing is caught.

#[cfg(any(not(target_has_atomic = "64"), debug_assertions))]
mod atomic;
mod context;
mod critical;
mod port;

pub mod alarm;
#[path = "../portable/boost.rs"]
pub mod boost;
pub(crate) mod clock;
pub mod fence;
pub(crate) mod futex;
pub mod inside;
pub mod lock;
mod once;

#[cfg(any(not(target_has_atomic = "64"), debug_assertions))]
pub use atomic::{AtomicI64, AtomicU64};
#[doc(hidden)]
pub use context::CONTEXTS;
pub use context::{AccessError, Local, NESTED_INTERRUPTS, interrupt, is_interrupt};
pub use once::OnceLock;
pub use port::{Port, install};

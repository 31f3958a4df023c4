//! The platform layer of LUNA.
//!
//! Processes, channels and executors call the system through this crate alone. Above it stand
//! channels, executors and the framework itself, which see one interface whatever is below: each
//! backend is a folder that defines the same names.
//!
//! | backend | what it is | picked |
//! | --- | --- | --- |
//! | `linux` | complete | on Linux |
//! | `portable` | the standard library alone | elsewhere, and with `--cfg luna_portable` |
//! | `model` | loom's clock, lock and wait, to check protocols | with `--cfg loom` |
//! | `bare` | one CPU and its interrupts, without an operating system | without the feature `std` |
//!
//! `linux` has policies, priority-inheriting futex locks, absolute futex waits, epoll and memory
//! locking. `portable` has no real-time policy; asking for one is an error.
//!
//! `bare` has what `luna-core` and `luna-channels` need, and nothing else of the
//! list below. docs/no-std.md of the project describes it.
//!
//! What it offers of the system:
//!
//! - [`thread`]: threads with a policy, a core and a stack, as obtained, and what was
//!   refused.
//! - [`clock`], [`futex`], [`bell`], [`deadline_sleep`], [`lock`], [`spin`],
//!   [`reactor`]: time, and waiting for it, for other threads, and for files. [`fence`], [`inside`]
//!   and [`boost`] are what a biased lock and priority inheritance need of the kernel. [`alarm`]:
//!   deadlines of a busy thread.
//! - [`on_drop`]: what is undone at the end of a scope. [`debug_fields`]: `Debug` of a part.
//!
//! It knows nothing of processes: they are the subject of `luna-core`. What a system needs of its
//! machine beside these, such as signals and locked memory, is in `luna-machine`.
//!
//! A system call is made on the real-time path only where a function's documentation says so;
//! [`path`] lets a test hold the path to that.

#![cfg_attr(
    not(feature = "std"),
    no_std,
    allow(
        rustdoc::broken_intra_doc_links,
        reason = "the pages speak of what `std` has"
    )
)]
#![allow(
    clippy::new_without_default,
    reason = "what is made here belongs to one thread or system: made on purpose, not by default"
)]

// The model is the same for either checker: shuttle has loom's names.
#[cfg(shuttle)]
extern crate shuttle as loom;

extern crate alloc;

#[cfg(all(feature = "std", not(loom)))]
pub mod alarm;
pub mod bell;
pub mod clock;
pub mod deadline_sleep;
pub mod futex;
mod macros;
pub mod on_drop;
pub mod panics;
pub mod path;
#[cfg(all(feature = "std", not(loom)))]
pub mod reactor;
#[cfg(not(loom))]
pub mod spin;
pub mod sync;
#[cfg(all(feature = "std", not(loom)))]
pub mod thread;

#[cfg(all(loom, not(feature = "std")))]
compile_error!("the models need the feature `std`");

#[cfg(not(target_has_atomic = "ptr"))]
compile_error!("LUNA needs a processor with compare-and-swap: Cortex-M3 or later, RISC-V with `A`");

#[cfg(all(test, not(feature = "std")))]
compile_error!("the unit tests need `std`: tests without it are in the package `luna-bare`");

#[cfg(loom)]
#[path = "model/mod.rs"]
mod backend;
#[cfg(all(feature = "std", target_os = "linux", not(luna_portable), not(loom)))]
#[path = "linux/mod.rs"]
mod backend;
#[cfg(all(
    feature = "std",
    not(all(target_os = "linux", not(luna_portable))),
    not(loom)
))]
#[path = "portable/mod.rs"]
mod backend;
#[cfg(not(feature = "std"))]
pub mod bare;
#[cfg(not(feature = "std"))]
use bare as backend;

#[cfg(not(feature = "std"))]
pub use backend::alarm;
pub use backend::boost;
pub use backend::fence;
pub use backend::inside;
pub use backend::lock;
#[cfg(loom)]
pub use backend::spin;

impl<T: Default> Default for lock::PiLock<T> {
    fn default() -> Self {
        Self::new(T::default())
    }
}

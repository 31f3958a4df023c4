//! Holds the real-time path of LUNA programs to its rules, in tests: whoever allocates, frees, blocks on a lock or makes an unexpected system
//! call on it fails the test, with the process' name and a backtrace.
//!
//! The *path* is what [`on_path`](luna_platform::current::on_path) says: all that running processes and their executors do between the start of
//! the bodies and their end. Of system calls it allows those alone that wake a thread, sleep, arm a timer, wait for a contended
//! priority-inheriting lock, lend a thread a priority, or move a file's data ([`Call`](luna_platform::path::Call)); of memory nothing.
//!
//! A test program that is to be guarded makes [`Allocator`] its own, and runs its systems within [`check`]:
//!
//! ```
//! use luna::prelude::*;
//!
//! #[global_allocator]
//! static ALLOCATOR: luna_path_guard::Allocator = luna_path_guard::Allocator::new();
//!
//! luna_path_guard::check(|| {
//!     let mut system = System::new("guarded");
//!     let main = system.executor("main").build().unwrap();
//!     let (output, input) = luna::channel();
//!     main.process("source").spawn(async move { Ok(output.send(7).await?) }).unwrap();
//!     main.process("sink")
//!         .spawn(async move {
//!             // What a body needs is made before, or off the path and said so.
//!             let mut seen = luna::off_path(|| Vec::with_capacity(1));
//!             seen.push(input.recv().await?);
//!             luna::off_path(|| drop(seen));
//!             Ok(())
//!         })
//!         .unwrap();
//!     system.run().unwrap();
//! });
//! ```
//!
//! It is run by `RUSTFLAGS="--cfg luna_path_guard" cargo test`. Without this cfg, nothing is watched and nothing costs anything: `check` calls its
//! closure, and says on standard error that it was not held to anything. [`coverage`] tells the same to a program.
//!
//! # What it sees, and how
//!
//! - **Memory**: all that goes through Rust's global allocator; on Linux with glibc also what C code allocates and frees by `malloc`, `calloc`, `realloc` and
//!   `free`, the C library itself included.
//! - **System calls**: all of the thread, whoever makes them (the standard library, C, inline assembly), by the kernel's Syscall User Dispatch: Linux
//!   5.11 on x86-64. Elsewhere memory alone is watched, and that is said by name.
//! - **Locks**: one that blocks, when it blocks: it waits by a system call (in the standard library and in C a futex). A lock that is free when it is taken leaves no
//!   trace that could be seen; make tests contend for it, or keep such locks out of the code.
//! - Not seen: time. A loop that spins, a long computation and a page fault break no rule that is checked here.
//!
//! A signal's handler counts as part of what it interrupts. What a thread does while it panics is not watched: a panic has a report of its own.

mod allocator;
mod coverage;
mod scope;
mod violation;

#[cfg(all(
    luna_path_guard,
    target_os = "linux",
    target_env = "gnu",
    not(target_feature = "crt-static")
))]
mod c_memory;
#[cfg(luna_path_guard)]
mod room;
#[cfg(luna_path_guard)]
mod symbols;
#[cfg(luna_path_guard)]
mod system_calls;
#[cfg(luna_path_guard)]
mod watch;

pub use allocator::Allocator;
pub use coverage::{Coverage, coverage};
pub use scope::{check, collect, seen};
pub use violation::{Kind, Violation};

//! Enforces the rules of the real-time path on LUNA programs, in tests: code on it that allocates,
//! frees, blocks on a lock or makes an unexpected system call fails the test, with the process'
//! name and a backtrace.
//!
//! The *path* is defined by [`on_path`](luna_core::current::on_path): all that running
//! processes and their executors do between the start of the bodies and their end. It allows only
//! system calls that wake a thread, sleep, arm a timer, wait for a contended priority-inheriting
//! lock, boost a thread, or move a file's data ([`Call`](luna_core::path::Call)); it allows no
//! allocation and no free.
//!
//! A guarded test program uses [`Allocator`] as its own, and runs its systems within [`check`]:
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
//!             let mut seen = luna::realtime::off_path(|| Vec::with_capacity(1));
//!             seen.push(input.recv().await?);
//!             luna::realtime::off_path(|| drop(seen));
//!             Ok(())
//!         })
//!         .unwrap();
//!     system.run().unwrap();
//! });
//! ```
//!
//! Run it with `RUSTFLAGS="--cfg luna_path_guard" cargo test`. Without this cfg, nothing is watched
//! and nothing has a cost: `check` calls its closure, and reports on standard error that nothing
//! was checked. [`coverage`] returns the same to a program.
//!
//! # What it detects, and how
//!
//! - **Memory**: all calls of Rust's global allocator; on Linux with glibc also `malloc`, `calloc`,
//!   `realloc` and `free` by C code and by the C library itself.
//! - **System calls**: all calls of the thread, from any code (the standard library, C, inline
//!   assembly), by the kernel's Syscall User Dispatch: Linux 5.11 on x86-64. Elsewhere only memory
//!   is watched, and a message names the test.
//! - **Locks**: a lock that blocks, when it blocks: it waits by a system call (in the standard
//!   library and in C a futex). Taking a free lock cannot be detected; make tests contend for it,
//!   or keep such locks out of the code.
//! - Not detected: time. A loop that spins, a long computation and a page fault break no rule that
//!   is checked here.
//!
//! A signal's handler counts as part of the code that it interrupts. A panicking thread is not
//! watched: a panic has a report of its own.

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

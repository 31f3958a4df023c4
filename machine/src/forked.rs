//! Whether this process is the child of a bare `fork` in the middle of a system.
//!
//! Such a child has a copy of the program's memory and of its signal handlers, but only the thread
//! that called `fork`. No other thread exists in it: it must wait for none, and bringing the
//! machine to safety is the parent's work.
//!
//! ```
//! luna_machine::forked::remember_process();
//! assert!(!luna_machine::forked::is_child());
//! ```

use std::sync::atomic::{AtomicU32, Ordering};

/// The number of the process that was remembered last, 0 for none.
static PROCESS: AtomicU32 = AtomicU32::new(0);

/// Remembers the calling process as the one that has the program's threads.
pub fn remember_process() {
    PROCESS.store(std::process::id(), Ordering::Relaxed);
}

/// Whether the calling process is another than the one that was remembered. One system call.
/// Async-signal-safe.
pub fn is_child() -> bool {
    let known = PROCESS.load(Ordering::Relaxed);
    known != 0 && known != std::process::id()
}

/// Ends such a child at once: nothing of the parent is flushed or dropped in it.
#[cfg(all(target_os = "linux", not(luna_portable)))]
pub fn end_child(code: i32) -> ! {
    // SAFETY: it ends the process and has no precondition.
    unsafe { nix::libc::_exit(code) }
}

/// Ends such a child.
#[cfg(not(all(target_os = "linux", not(luna_portable))))]
pub fn end_child(code: i32) -> ! {
    std::process::exit(code)
}

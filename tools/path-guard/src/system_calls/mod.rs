//! Watches system calls by the kernel's Syscall User Dispatch.
//!
//! While a thread is on the path, a byte of its own ([`Selector`]) makes the kernel stop its system
//! calls. The kernel then raises SIGSYS in place of the call, whatever code makes it. The handler
//! checks the rules, notes a violation, makes the call for the thread, and returns the kernel's
//! result to it: nothing else changes for the program.

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod dispatch;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod names;
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod rules;
#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
mod unwatched;

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
pub(crate) use dispatch::{arm, availability, probe};
#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
pub(crate) use unwatched::{arm, availability, probe};

use std::sync::atomic::{AtomicU8, Ordering, compiler_fence};

/// What becomes of a thread's system calls: a byte that the kernel reads.
#[repr(transparent)]
pub(crate) struct Selector(AtomicU8);

impl Selector {
    const LET_PASS: u8 = 0;
    const STOP: u8 = 1;

    pub(crate) const fn new() -> Self {
        Self(AtomicU8::new(Self::LET_PASS))
    }

    /// From now on each is stopped.
    #[inline]
    pub(crate) fn stop(&self) {
        self.set(Self::STOP);
    }

    /// From now on the guard ignores the thread's calls.
    #[inline]
    pub(crate) fn let_pass(&self) {
        self.set(Self::LET_PASS);
    }

    fn set(&self, value: u8) {
        // The kernel reads it on this thread: only the compiler must not move a call across.
        compiler_fence(Ordering::SeqCst);
        self.0.store(value, Ordering::Relaxed);
        compiler_fence(Ordering::SeqCst);
    }
}

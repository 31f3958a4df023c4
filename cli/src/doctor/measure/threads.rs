//! Threads to measure with.

use luna::Policy;
use luna_platform::thread::{Attributes, Obtained, SpawnError, Thread, spawn};
use std::convert::Infallible;

/// As an executor of a user: above the kernel's interrupt threads.
pub(super) const PRIORITY: u8 = 80;

/// A thread on `core` under SCHED_FIFO with `priority`, or without what was refused.
pub(super) fn on<T: Send + 'static>(
    core: usize,
    priority: u8,
    body: impl FnOnce() -> T + Send + 'static,
) -> Result<Thread<T>, String> {
    let attributes = Attributes::new("doctor")
        .core(core)
        .policy(Policy::fifo(priority));
    spawn(attributes, |_| Ok::<_, Infallible>(()), |()| body())
        .map_err(|error: SpawnError<Infallible>| error.to_string())
}

/// The thread's result.
pub(super) fn end<T>(thread: Thread<T>) -> Result<T, String> {
    thread
        .join()
        .map_err(|_| "a measuring thread panicked".to_owned())
}

/// `fifo:80, core 1`, as obtained.
pub(super) fn how(obtained: &Obtained) -> String {
    let core = obtained
        .core
        .map_or_else(|| "any core".to_owned(), |core| format!("core {core}"));
    format!("{}, {core}", obtained.policy)
}

//! User code at its worst, over all operations: wakers that panic and call operations in their
//! clone, wake and drop, values and closures that panic, futures that are dropped, moved and
//! forgotten, channels that end. `every` tries each operation with each of these; `stress` mixes
//! them at random.
//!
//! A second drop and a use after free show here by a value's own mark; under AddressSanitizer,
//! which is a step of CI, they all show. A waker that is called under a lock locks the same lock,
//! which the lock finds, and panics.

#![cfg(all(not(loom), target_os = "linux"))]

mod actors;
mod every;
mod stress;
mod world;

/// Each test counts what there is, or keeps both cores busy.
fn one_at_a_time() -> std::sync::MutexGuard<'static, ()> {
    static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    ONE.lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

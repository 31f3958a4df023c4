//! Pinned threads for the measurements.

use std::{panic, thread};

use core_affinity::CoreId;

/// The cores that this process may use: all, or those set by `taskset`.
///
/// # Panics
///
/// The system does not list its cores.
pub fn cores() -> Vec<CoreId> {
    let cores = core_affinity::get_core_ids().unwrap_or_default();
    assert!(!cores.is_empty(), "the system does not list its cores");
    cores
}

/// The core for a scenario on one core: the first.
///
/// # Panics
///
/// As [`cores`].
pub fn one_core() -> CoreId {
    cores()[0]
}

/// The cores for a scenario on two: the first two, or none if there is only one.
///
/// # Panics
///
/// As [`cores`].
pub fn two_cores() -> Option<[CoreId; 2]> {
    cores().first_chunk().copied()
}

/// Runs `work` on a thread of its own that is pinned to `core`, as are the threads that `work`
/// starts.
///
/// # Panics
///
/// The thread cannot be pinned, or `work` panics.
pub fn on_core<T: Send>(core: CoreId, work: impl FnOnce() -> T + Send) -> T {
    thread::scope(|scope| join(scope.spawn(|| pinned(core, work))))
}

/// Runs two pieces of work at the same time, each as with [`on_core`]; returns the second's result.
///
/// # Panics
///
/// A thread cannot be pinned, or one of the two panics.
pub fn on_cores<T: Send>(
    cores: [CoreId; 2],
    first: impl FnOnce() + Send,
    second: impl FnOnce() -> T + Send,
) -> T {
    thread::scope(|scope| {
        let first = scope.spawn(move || pinned(cores[0], first));
        let second = scope.spawn(move || pinned(cores[1], second));
        let result = join(second);
        join(first);
        result
    })
}

fn pinned<T>(core: CoreId, work: impl FnOnce() -> T) -> T {
    assert!(
        core_affinity::set_for_current(core),
        "cannot pin a thread to {core:?}"
    );
    work()
}

fn join<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread
        .join()
        .unwrap_or_else(|panic| panic::resume_unwind(panic))
}

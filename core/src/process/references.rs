//! Biased reference counts of processes: no atomics on the process' own thread.
//!
//! A waiting future can be moved out of its process and outlive it (boxed and sent to another
//! thread, for instance), and its node with it. The wake handle in the node must therefore keep the
//! process' memory. One atomic count would cost two read-modify-write operations for each wait,
//! although nearly all references begin and end on one thread. This is biased reference counting
//! (J. Choi, T. Shull, J. Torrellas, PACT 2018), simplified by two facts: references begin on the
//! executor's thread, or as copies of others; and the executor knows when its process has ended.

use core::cell::Cell;
use luna_platform::sync::atomic::{AtomicI64, Ordering};

/// Added when the process has ended: the count alone cannot reach it before.
const ENDED: i64 = 1 << 62;

/// # Invariants
///
/// `here` is accessed on the executor's thread alone, before the end; of a process that was never
/// built by the thread that ends it. Until the end, `here + elsewhere` is the number of references;
/// `elsewhere` is the number of those made on any thread, minus those that ended on any. After the
/// end, `elsewhere - ENDED` is the number of references.
#[derive(Debug)]
pub(crate) struct References {
    here: Cell<i64>,
    elsewhere: AtomicI64,
}

impl References {
    pub(crate) fn new() -> Self {
        Self {
            here: Cell::new(0),
            elsewhere: AtomicI64::new(0),
        }
    }

    /// With one that was made outside of the executor's thread.
    #[cfg(not(loom))]
    pub(crate) fn with_one() -> Self {
        Self {
            here: Cell::new(0),
            elsewhere: AtomicI64::new(1),
        }
    }

    /// Counts one more. On the executor's thread, before the end.
    #[inline]
    pub(crate) fn add_here(&self) {
        self.here.set(self.here.get() + 1);
    }

    /// Counts one less. On the executor's thread, before the end.
    #[inline(always)]
    pub(crate) fn remove_here(&self) {
        self.here.set(self.here.get().wrapping_sub(1));
    }

    /// Counts one more, on any thread, for a caller that has a reference already.
    #[inline]
    pub(crate) fn add_elsewhere(&self) {
        // Relaxed: the caller's reference keeps the process, and was passed on with its own
        // synchronisation.
        self.elsewhere.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts one less, on any thread; `true` if it was the last one of a process that has ended.
    #[inline]
    #[must_use = "the last one frees the process"]
    pub(crate) fn remove_elsewhere(&self) -> bool {
        // AcqRel: all other references' uses of the process happen before it is freed.
        self.elsewhere.fetch_sub(1, Ordering::AcqRel) - 1 == ENDED
    }

    /// Ends the process, on the executor's thread, once; `true` if there is no reference to it.
    #[must_use = "without references the process is to be freed"]
    pub(crate) fn end(&self) -> bool {
        let here = self.here.get();
        // The common case costs one load. The load may return an old value, but not one from before
        // a copy of a reference that has ended on this thread: a reference is copied before it
        // ends. So each reference that is counted as ended was counted as begun. If the sum is 0
        // there is no reference, and none that could be copied. Acquire: as in `remove_elsewhere`.
        if self.elsewhere.load(Ordering::Acquire) + here == 0 {
            return true;
        }
        let added = here + ENDED;
        self.elsewhere.fetch_add(added, Ordering::AcqRel) + added == ENDED
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn the_last_one_after_the_end_is_told() {
        let references = References::new();
        references.add_here();
        references.add_here();
        references.remove_here();
        assert!(!references.end());
        assert!(references.remove_elsewhere());
    }

    #[test]
    fn a_copy_counts_before_the_end_and_after_it() {
        let references = References::new();
        references.add_here();
        references.add_elsewhere();
        references.remove_here();
        assert!(!references.end());
        references.add_elsewhere();
        assert!(!references.remove_elsewhere());
        assert!(references.remove_elsewhere());
    }

    #[test]
    fn more_may_end_elsewhere_than_are_counted_there() {
        let references = References::new();
        references.add_here();
        references.add_here();
        assert!(!references.remove_elsewhere());
        assert!(!references.remove_elsewhere());
        assert!(references.end());
    }
}

#[cfg(all(test, loom))]
mod loom_tests {
    use super::*;
    use loom::sync::Arc;
    use loom::sync::atomic::AtomicUsize;

    /// The executor's thread owns the cells: the other thread does not touch them.
    struct Shared(References);
    // SAFETY: the test accesses `here` on one thread alone, as the type's invariants require.
    unsafe impl Send for Shared {}
    // SAFETY: of what is shared here, `here` is accessed on one thread alone, and `elsewhere` is
    // atomic.
    unsafe impl Sync for Shared {}

    /// A reference on another thread was copied before; the original ends on the executor's thread.
    #[test]
    fn a_copy_that_is_alive_is_never_overlooked() {
        loom::model(|| {
            let shared = Arc::new((
                Shared(References::new()),
                AtomicUsize::new(0),
                AtomicUsize::new(2),
            ));
            let copied = Arc::new(AtomicUsize::new(0));
            shared.0.0.add_here();
            let other = {
                let (shared, copied) = (shared.clone(), copied.clone());
                loom::thread::spawn(move || {
                    // A copy of the executor's reference, which lives until the executor's thread
                    // is notified.
                    shared.0.0.add_elsewhere();
                    copied.store(1, Ordering::Release);
                    shared.2.fetch_sub(1, Ordering::SeqCst);
                    if shared.0.0.remove_elsewhere() {
                        assert_eq!(shared.2.load(Ordering::SeqCst), 0);
                        shared.1.fetch_add(1, Ordering::SeqCst);
                    }
                })
            };
            // The original ends once it is no longer borrowed; if it still is, it ends after the
            // process.
            let may_go = copied.load(Ordering::Acquire) == 1;
            if may_go {
                shared.2.fetch_sub(1, Ordering::SeqCst);
                shared.0.0.remove_here();
            }
            if shared.0.0.end() {
                assert_eq!(
                    shared.2.load(Ordering::SeqCst),
                    0,
                    "freed while referred to"
                );
                shared.1.fetch_add(1, Ordering::SeqCst);
            }
            if !may_go {
                other.join().unwrap();
                shared.2.fetch_sub(1, Ordering::SeqCst);
                if shared.0.0.remove_elsewhere() {
                    shared.1.fetch_add(1, Ordering::SeqCst);
                }
            } else {
                other.join().unwrap();
            }
            assert_eq!(shared.1.load(Ordering::SeqCst), 1);
        });
    }

    #[test]
    fn exactly_one_frees_and_only_when_all_have_gone() {
        loom::model(|| {
            let shared = Arc::new((
                Shared(References::new()),
                AtomicUsize::new(0),
                AtomicUsize::new(3),
            ));
            for _ in 0..3 {
                shared.0.0.add_here();
            }
            let gone = |shared: &(Shared, AtomicUsize, AtomicUsize)| {
                shared.2.fetch_sub(1, Ordering::SeqCst);
                if shared.0.0.remove_elsewhere() {
                    assert_eq!(
                        shared.2.load(Ordering::SeqCst),
                        0,
                        "freed while referred to"
                    );
                    shared.1.fetch_add(1, Ordering::SeqCst);
                }
            };
            let others: Vec<_> = (0..2)
                .map(|_| {
                    let shared = shared.clone();
                    loom::thread::spawn(move || gone(&shared))
                })
                .collect();
            if shared.0.0.end() {
                shared.1.fetch_add(1, Ordering::SeqCst);
            }
            gone(&shared);
            for other in others {
                other.join().unwrap();
            }
            assert_eq!(shared.1.load(Ordering::SeqCst), 1);
        });
    }
}

//! Wakes one sleeping thread, and reports whether the thread was asleep.
//!
//! For a thread that waits on the caller's core, with a higher priority: no other core has to be
//! woken, and the thread runs before the call returns. If the thread is busy, the caller turns to
//! another one.
//!
//! ```
//! use luna_core::standby::Standby;
//!
//! let standby = Standby::new();
//! assert!(!standby.call()); // it does not sleep yet
//! std::thread::scope(|scope| {
//!     scope.spawn(|| standby.sleep(|| false));
//!     while !standby.call() {}
//! });
//! ```

use crate::path::{self, Call};
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::sync::atomic::{Ordering, fence};

/// The thread works.
const BUSY: u32 = 0;
/// The thread sleeps, or is about to.
const ASLEEP: u32 = 1;
/// The thread was called while it slept, and will be busy.
const CALLED: u32 = 2;

/// The state that one thread sleeps in, and by which others call it.
#[derive(Debug)]
pub struct Standby {
    state: Futex,
}

impl Standby {
    /// For a thread that does not sleep.
    pub fn new() -> Self {
        Self {
            state: Futex::new(BUSY),
        }
    }

    /// Calls the thread; returns whether it was asleep. If so, it sees all that was done before
    /// this. One system call in that case. Async-signal-safe on Linux.
    pub fn call(&self) -> bool {
        // Pairs with the fence in `sleep`: a thread that does not sleep because of this call sees
        // the reason, although the call returns false.
        fence(Ordering::SeqCst);
        let called =
            self.state
                .word()
                .compare_exchange(ASLEEP, CALLED, Ordering::AcqRel, Ordering::Acquire);
        if called.is_ok() {
            path::expected(Call::Wake, || self.state.wake_one());
        }
        called.is_ok()
    }

    /// Sleeps until it is called, unless `is_wanted` says that there is work already. If a
    /// [`call`](Self::call) did not find the thread asleep, `is_wanted` or the thread's previous
    /// work saw what was done before that call. By one thread at a time.
    pub fn sleep(&self, is_wanted: impl FnOnce() -> bool) {
        self.state.word().store(ASLEEP, Ordering::Release);
        fence(Ordering::SeqCst);
        if !is_wanted() {
            while self.state.word().load(Ordering::Acquire) == ASLEEP {
                self.state.wait(ASLEEP, Instant::NEVER);
            }
        }
        self.state.word().swap(BUSY, Ordering::AcqRel);
    }
}

#[cfg(all(test, loom))]
mod loom_tests {
    use super::*;
    use luna_platform::sync::Arc;
    use luna_platform::sync::atomic::{AtomicBool, AtomicUsize};

    /// Of two callers, each is seen by the thread, or knows that it is not.
    #[test]
    fn one_that_is_told_that_it_comes_is_seen() {
        loom::model(|| {
            let shared = Arc::new((Standby::new(), AtomicUsize::new(0)));
            let callers: Vec<_> = [1, 2]
                .into_iter()
                .map(|work| {
                    let shared = shared.clone();
                    loom::thread::spawn(move || {
                        shared.1.fetch_or(work, Ordering::Relaxed);
                        if shared.0.call() { work } else { 0 }
                    })
                })
                .collect();
            // It always wakes: if neither caller has found it asleep, it has found the work of
            // both.
            shared.0.sleep(|| shared.1.load(Ordering::Relaxed) == 3);
            let seen = shared.1.load(Ordering::Relaxed);
            let promised = callers
                .into_iter()
                .fold(0, |all, caller| all | caller.join().unwrap());
            assert_eq!(seen & promised, promised);
        });
    }

    /// The end is notified to a thread that is busy or asleep: it never misses it.
    #[test]
    fn it_does_not_sleep_through_what_it_waits_for() {
        loom::model(|| {
            let shared = Arc::new((Standby::new(), AtomicBool::new(false)));
            let other = shared.clone();
            let ends = loom::thread::spawn(move || {
                other.1.store(true, Ordering::Relaxed);
                other.0.call();
            });
            while !shared.1.load(Ordering::Relaxed) {
                shared.0.sleep(|| shared.1.load(Ordering::Relaxed));
            }
            ends.join().unwrap();
        });
    }
}

//! A thread's sleep until a deadline that other threads may bring forward.
//!
//! The thread sleeps in a futex with a timeout. Under a real-time policy the kernel ends that sleep
//! in the timer's interrupt itself, on every preemption model. A timerfd or a POSIX timer expires
//! in a kernel thread of low priority on PREEMPT_RT, which a busy thread of a higher one starves.
//!
//! ```text
//!   sleeper                                    others
//!   1 until = never; read the changes          a set a deadline that the sleeper looks at
//!   2 look at all deadlines         <------>   b read `until`; the deadline is earlier?
//!   3 until = the earliest                     c count a change; the sleeper waits? wake it
//!   4 wait, unless a change was counted
//! ```
//!
//! Full fences lie between 1 and 2, and between a and b. So either 2 sees the deadline of a, or b
//! sees what 1 wrote or later. In the second case the deadline is not before `until`, which the
//! sleeper wakes at anyway; or c counts a change, which ends 4 or prevents it.

use crate::clock::Instant;
use crate::futex::Futex;
use crate::path::{self, Call};
use crate::sync::atomic::{AtomicU64, Ordering, fence};

/// Set while the sleeper waits or is about to. Changes are counted in the bits above.
const WAITS: u32 = 1;
const CHANGE: u32 = 2;

/// The sleep of one thread.
///
/// ```
/// use luna_platform::clock::Instant;
/// use luna_platform::deadline_sleep::DeadlineSleep;
/// use std::time::Duration;
///
/// let sleep = DeadlineSleep::new();
/// let deadline = Instant::now() + Duration::from_millis(1);
/// while Instant::now() < deadline {
///     sleep.sleep(|| deadline);
/// }
/// ```
#[derive(Debug)]
pub struct DeadlineSleep {
    /// When the sleeper wakes by itself, in nanoseconds; that of [`Instant::NEVER`] while it is
    /// awake, so that each new deadline is counted as a change.
    until: AtomicU64,
    changes: Futex,
}

impl DeadlineSleep {
    /// A sleep that no thread is in.
    pub fn new() -> Self {
        Self {
            until: AtomicU64::new(Instant::NEVER.as_nanos()),
            changes: Futex::new(0),
        }
    }

    /// Ends the present sleep at `at` or before, unless it ends by then anyway. What the caller
    /// changed before is seen by the sleeper's next look at its deadlines. From any thread.
    /// Real-time path: yes; at most one system call.
    pub fn wake_by(&self, at: Instant) {
        fence(Ordering::SeqCst);
        if at.as_nanos() >= self.until.load(Ordering::Relaxed) {
            return;
        }
        let before = self.changes.word().fetch_add(CHANGE, Ordering::AcqRel);
        if before & WAITS != 0 {
            path::expected(Call::Wake, || self.changes.wake_one());
        }
    }

    /// Sleeps until the deadline that `earliest` gives, or until another thread [brings it
    /// forward](Self::wake_by). May end without a cause. One thread only. Real-time path: yes; one
    /// system call.
    pub fn sleep(&self, earliest: impl FnOnce() -> Instant) {
        let changes = self.changes.word();
        self.until
            .store(Instant::NEVER.as_nanos(), Ordering::Relaxed);
        let seen = changes.load(Ordering::Acquire);
        fence(Ordering::SeqCst);
        let deadline = earliest();
        if deadline <= Instant::now_real() {
            return;
        }
        self.until.store(deadline.as_nanos(), Ordering::Relaxed);
        let waits =
            changes.compare_exchange(seen, seen | WAITS, Ordering::AcqRel, Ordering::Relaxed);
        if waits.is_ok() {
            path::expected(Call::Sleep, || self.changes.wait(seen | WAITS, deadline));
            changes.fetch_and(!WAITS, Ordering::AcqRel);
        }
    }
}

#[cfg(all(test, loom))]
mod loom_tests {
    use super::*;
    use loom::sync::Arc;

    /// Two threads set deadlines of their own, in either order; the second one has passed already. A
    /// sleeper that does not notice it would be reported as a deadlock: in the model time stands.
    #[test]
    fn no_deadline_is_missed() {
        let mut builder = loom::model::Builder::new();
        builder.preemption_bound = builder.preemption_bound.or(Some(2));
        builder.check(|| {
            let sleep = Arc::new(DeadlineSleep::new());
            let deadlines = Arc::new([AtomicU64::new(u64::MAX), AtomicU64::new(u64::MAX)]);
            let setters = [(0, 10), (1, 0)].map(|(number, at)| {
                let (sleep, deadlines) = (sleep.clone(), deadlines.clone());
                loom::thread::spawn(move || {
                    deadlines[number].store(at, Ordering::Relaxed);
                    sleep.wake_by(Instant::from_nanos(at));
                })
            });
            let earliest = || {
                let [first, second] = &*deadlines;
                let second = second.load(Ordering::Relaxed);
                Instant::from_nanos(first.load(Ordering::Relaxed).min(second))
            };
            while earliest() > Instant::from_nanos(0) {
                sleep.sleep(earliest);
            }
            setters.map(|setter| setter.join().unwrap());
        });
    }

    /// The sleeper has just woken at 5, when another thread sets a deadline behind that: it is not
    /// to be taken for one that the sleeper wakes at.
    #[test]
    fn a_deadline_behind_the_last_sleep_is_noticed() {
        loom::model(|| {
            let (sleep, deadline) = (DeadlineSleep::new(), AtomicU64::new(u64::MAX));
            sleep.until.store(5, Ordering::Relaxed);
            let shared = Arc::new((sleep, deadline));
            let own = shared.clone();
            let setter = loom::thread::spawn(move || {
                own.1.store(10, Ordering::Relaxed);
                own.0.wake_by(Instant::from_nanos(10));
            });
            let (sleep, deadline) = &*shared;
            // Once it is seen the sleep would end with it.
            let is_seen = || deadline.load(Ordering::Relaxed) == 10;
            while !is_seen() {
                sleep.sleep(|| match is_seen() {
                    true => Instant::from_nanos(0),
                    false => Instant::NEVER,
                });
            }
            setter.join().unwrap();
        });
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;
    use std::time::Duration;

    const LONG: Duration = Duration::from_secs(1000);

    #[test]
    fn it_ends_at_its_deadline() {
        let sleep = DeadlineSleep::new();
        let deadline = Instant::now() + Duration::from_millis(2);
        while Instant::now() < deadline {
            sleep.sleep(|| deadline);
        }
        // One that has passed is not slept for.
        sleep.sleep(|| deadline);
    }

    #[test]
    fn another_thread_brings_it_forward_or_ends_it() {
        let (sleep, ends) = (DeadlineSleep::new(), AtomicBool::new(false));
        let (until, is_set) = (AtomicU64::new(u64::MAX), AtomicBool::new(false));
        std::thread::scope(|threads| {
            threads.spawn(|| {
                let soon = Instant::now() + Duration::from_millis(2);
                until.store((soon + LONG).as_nanos(), Ordering::Relaxed);
                sleep.wake_by(soon + LONG);
                until.store(soon.as_nanos(), Ordering::Relaxed);
                sleep.wake_by(soon);
                while !is_set.load(Ordering::Acquire) {
                    std::thread::yield_now();
                }
                ends.store(true, Ordering::Relaxed);
                sleep.wake_by(Instant::from_nanos(0));
            });
            while !ends.load(Ordering::Relaxed) {
                sleep.sleep(|| match ends.load(Ordering::Relaxed) {
                    true => Instant::from_nanos(0),
                    false => Instant::from_nanos(until.load(Ordering::Relaxed)),
                });
                if Instant::now().as_nanos() >= until.load(Ordering::Relaxed) {
                    until.store(u64::MAX, Ordering::Relaxed);
                    is_set.store(true, Ordering::Release);
                }
            }
        });
    }
}

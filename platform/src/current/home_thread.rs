//! The OS priority that a home's thread was lent by those for whom its processes work.

use crate::backend::boost::{self, Scheduling};
use crate::lock::PiLock;
use crate::path::{self, Call};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// The highest priority of the real-time policies.
const HIGHEST: u8 = 99;

/// How many boosts the system has refused, and the first of them: its priority and what the system said.
static REFUSED: AtomicU32 = AtomicU32::new(0);
static FIRST_REFUSED: AtomicU32 = AtomicU32::new(0);

/// A home's thread, which can be lent priorities above its own.
///
/// # Invariants
///
/// The thread runs at the highest priority that is counted in `lent`, or at its own if none is, whenever the lock is free; unless the
/// system has refused, or the home has been left.
pub(super) struct HomeThread {
    own: Scheduling,
    lent: PiLock<LentThread>,
    now: AtomicU8,
}

/// What is counted under the home's lock.
pub(super) struct LentThread {
    counts: [u32; HIGHEST as usize + 1],
    /// Which of them are not 0.
    lent: u128,
    /// What the thread has been told to run at; 0 is its own.
    applied: u8,
    left: bool,
}

impl LentThread {
    /// Counts a priority that is lent, or given back.
    pub(super) fn count(&mut self, priority: u8, more: bool) {
        let priority = priority.min(HIGHEST);
        let count = &mut self.counts[usize::from(priority)];
        *count = if more {
            count.saturating_add(1)
        } else {
            count.saturating_sub(1)
        };
        let bit = 1 << priority;
        self.lent = if *count == 0 {
            self.lent & !bit
        } else {
            self.lent | bit
        };
    }

    fn highest(&self) -> u8 {
        127_u32.saturating_sub(self.lent.leading_zeros()) as u8
    }
}

impl HomeThread {
    /// The calling thread, which becomes a home.
    pub(super) fn new() -> Arc<Self> {
        let thread = Arc::new(Self {
            own: boost::scheduling(),
            lent: PiLock::new(LentThread {
                counts: [0; HIGHEST as usize + 1],
                lent: 0,
                applied: 0,
                left: false,
            }),
            now: AtomicU8::new(0),
        });
        // A thread's first lock asks the system for the thread's number: here, so that none on the real-time path has to.
        drop(thread.lent.lock());
        thread
    }

    /// The highest priority that is lent; 0 if none is.
    #[inline]
    pub(super) fn lent(&self) -> u8 {
        self.now.load(Ordering::Relaxed)
    }

    /// Changes what is lent under the home's lock, and tells the system if the highest is another by that: under the lock too, since two
    /// that told it at once could leave the thread at the wrong one of theirs.
    pub(super) fn change(&self, change: impl FnOnce(&mut LentThread)) {
        let mut lent = self.lent.lock();
        change(&mut lent);
        self.apply(&mut lent);
    }

    /// The home is left: its thread ends, or does other things. It gets its own priority back, and is never told another one, since its number
    /// may be another thread's then.
    pub(super) fn leave(&self) {
        let mut lent = self.lent.lock();
        if lent.applied != 0 {
            path::expected(Call::Boost, || boost::restore(&self.own));
            lent.applied = 0;
        }
        lent.left = true;
    }

    fn apply(&self, lent: &mut LentThread) {
        let highest = lent.highest();
        self.now.store(highest, Ordering::Relaxed);
        if highest == lent.applied || lent.left {
            return;
        }
        if highest == 0 {
            path::expected(Call::Boost, || boost::restore(&self.own));
        } else if let Err(refusal) =
            path::expected(Call::Boost, || boost::boost(&self.own, highest))
        {
            if REFUSED.fetch_add(1, Ordering::Relaxed) == 0 {
                FIRST_REFUSED.store(
                    u32::from(highest) | refusal.unsigned_abs() << 8,
                    Ordering::Relaxed,
                );
            }
            return;
        }
        lent.applied = highest;
    }
}

/// What has come of threads that were to inherit a priority and were refused it.
#[cfg(not(loom))]
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct RefusedBoosts {
    /// How often it happened.
    pub count: u32,
    /// The first of them.
    pub first: crate::shortfall::Shortfall,
}

/// Whether the system has refused to let a thread inherit a priority, which is no error: the process then works at its thread's own. Reads
/// files; not for the real-time path.
///
/// ```
/// // Nobody has been refused, since nobody has inherited.
/// assert_eq!(luna_platform::current::refused_boosts(), None);
/// ```
#[cfg(not(loom))]
pub fn refused_boosts() -> Option<RefusedBoosts> {
    let count = REFUSED.load(Ordering::Relaxed);
    (count > 0).then(|| {
        let first = FIRST_REFUSED.load(Ordering::Relaxed);
        let asked = (first & 0xff) as u8;
        RefusedBoosts {
            count,
            first: crate::shortfall::Shortfall::Inheritance {
                asked,
                why: boost::why_refused(asked, (first >> 8) as i32),
            },
        }
    })
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::thread::{Policy, current_policy};

    #[test]
    fn a_thread_runs_at_what_is_lent_or_the_refusal_is_told() {
        let own = current_policy();
        let thread = HomeThread::new();
        for (priority, more, highest) in [
            (50, true, 50),
            (30, true, 50),
            (50, false, 30),
            (60, true, 60),
            (60, false, 30),
            (30, false, 0),
        ] {
            thread.change(|lent| lent.count(priority, more));
            assert_eq!(thread.lent(), highest);
            let now = current_policy();
            match refused_boosts() {
                None if highest == 0 => assert_eq!(now, own),
                None => assert_eq!(now, Policy::fifo(highest)),
                Some(refused) => {
                    assert_eq!(now, own);
                    let text = refused.first.to_string();
                    assert!(text.starts_with("no inherited priority 50: "), "{text}");
                }
            }
        }
        thread.change(|lent| lent.count(50, true));
        thread.leave();
        assert_eq!(current_policy(), own);
        thread.change(|lent| lent.count(60, true));
        assert_eq!(
            current_policy(),
            own,
            "a home that was left is told nothing"
        );
    }
}

//! What a process was lent, and what it waits for: see [`Heir`](super::Heir).

use super::heir::Lent;
use super::home_thread::HomeThread;
use super::process::LEVELS;
use crate::wait_list::WaitList;
use std::cell::UnsafeCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

pub(super) const LEVEL: u8 = LEVELS - 1;
/// Beside the level: the process was lent its thread's priority.
const THREAD: u8 = 1 << 7;

/// The level that a process runs at: its own, or the highest that it was lent. Beside what each of its turns touches.
pub(super) struct LevelNow(AtomicU8);

/// What a process was lent.
///
/// # Invariants
///
/// `counts` and `waits` are touched under the lock of `home` alone.
pub(super) struct Inheritance {
    /// None for a process outside of any home, which is lent nothing.
    pub(super) home: Option<Arc<HomeThread>>,
    /// What the process waits for while somebody else holds it: see [`Heir::begin_wait`].
    pub(super) waits: UnsafeCell<WaitList>,
    counts: UnsafeCell<Counts>,
}

struct Counts {
    levels: [u16; LEVELS as usize],
    /// Which of them are not 0.
    lent: u32,
    threads: u16,
}

impl LevelNow {
    pub(super) fn new(own: u8) -> Self {
        Self(AtomicU8::new(own & LEVEL))
    }

    #[inline]
    pub(super) fn get(&self) -> u8 {
        self.0.load(Ordering::Relaxed) & LEVEL
    }

    /// The priority of the process' thread, which is `own` if nothing was lent.
    #[inline]
    pub(super) fn thread(&self, own: u8, inheritance: &Inheritance) -> u8 {
        if self.0.load(Ordering::Relaxed) & THREAD == 0 {
            return own;
        }
        let home = inheritance.home.as_ref();
        home.map_or(own, |thread| own.max(thread.lent()))
    }
}

impl Drop for Inheritance {
    fn drop(&mut self) {
        if let Some(home) = self.home.take() {
            super::give_back_home_thread(home);
        }
    }
}

impl Inheritance {
    pub(super) fn new(home: Option<Arc<HomeThread>>) -> Self {
        Self {
            home,
            waits: UnsafeCell::new(WaitList::new()),
            counts: UnsafeCell::new(Counts {
                levels: [0; LEVELS as usize],
                lent: 0,
                threads: 0,
            }),
        }
    }

    /// See [`Process::count_lent`](super::Process::count_lent); of the process at level `now`, whose own is `own`.
    ///
    /// # Safety
    ///
    /// The home's lock is held.
    pub(super) unsafe fn count(&self, now: &LevelNow, own: u8, lent: Lent, more: bool) -> bool {
        // SAFETY: the contract.
        let counts = unsafe { &mut *self.counts.get() };
        let count = match lent {
            Lent::Nothing => return false,
            Lent::Level(level) => &mut counts.levels[usize::from(level & LEVEL)],
            Lent::Thread(_) => &mut counts.threads,
        };
        let changed = if more {
            count.checked_add(1)
        } else {
            count.checked_sub(1)
        };
        let Some(changed) = changed else {
            return false;
        };
        *count = changed;
        if let Lent::Level(level) = lent {
            let bit = 1 << (level & LEVEL);
            counts.lent = if changed == 0 {
                counts.lent & !bit
            } else {
                counts.lent | bit
            };
        }
        let highest = if counts.threads > 0 {
            THREAD | LEVEL
        } else {
            // 0 if none is lent, which is no more than its own.
            (own & LEVEL).max(31_u32.saturating_sub(counts.lent.leading_zeros()) as u8)
        };
        now.0.store(highest, Ordering::Relaxed);
        true
    }
}

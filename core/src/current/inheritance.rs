//! The boosts and waits of a process: see [`Inheritor`](super::Inheritor).

use super::LEVELS;
use super::executor_thread::ExecutorThread;
use super::inheritor::Boost;
use crate::wait_list::WaitList;
use alloc::sync::Arc;
use core::cell::UnsafeCell;
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, Ordering};

pub(super) const LEVEL: u8 = LEVELS - 1;

/// The level that a process runs at: its own, or its highest boost. It lies beside the fields of
/// each turn.
pub(crate) struct LevelNow {
    level: AtomicU8,
    /// The boost is the priority of the thread.
    has_thread_boost: AtomicBool,
}

/// The boosts of a process.
///
/// # Invariants
///
/// `counts` and `waits` are accessed under the lock of `thread` alone. `thread` is null, or owns a
/// reference to the thread of the process' executor; it is set once, on that thread.
pub(crate) struct Inheritance {
    /// Set for the first [`Inheritor`](super::Inheritor) of the process, since most have none.
    thread: AtomicPtr<ExecutorThread>,
    /// The waits of the process for objects with a holder: see
    /// [`Inheritor::begin_wait`](super::Inheritor::begin_wait).
    pub(super) waits: UnsafeCell<WaitList>,
    /// To each level; as one level more, those of its thread.
    counts: UnsafeCell<Counts<{ LEVELS as usize + 1 }>>,
}

/// How many boosts there are to each rank from 1 to `N - 1`, and the highest of them.
///
/// # Invariants
///
/// `highest` is the highest rank with a count other than 0, or 0.
pub(super) struct Counts<const N: usize> {
    counts: [u16; N],
    highest: u8,
}

impl<const N: usize> Counts<N> {
    pub(super) const fn new() -> Self {
        Self {
            counts: [0; N],
            highest: 0,
        }
    }

    /// Counts the begin or the end of a boost to `rank`. O(1), or O(N) at the end of the highest.
    /// `false`: there are too many, and it was not counted.
    pub(super) fn count(&mut self, rank: u8, more: bool) -> bool {
        let Some(count) = self.counts.get_mut(usize::from(rank)) else {
            return false;
        };
        let changed = match more {
            true => count.checked_add(1),
            false => count.checked_sub(1),
        };
        let Some(changed) = changed else {
            return false;
        };
        *count = changed;
        self.highest = self.highest.max(rank);
        while self.highest > 0 && self.counts[usize::from(self.highest)] == 0 {
            self.highest -= 1;
        }
        true
    }

    pub(super) fn highest(&self) -> u8 {
        self.highest
    }
}

impl LevelNow {
    pub(crate) fn new(own: u8) -> Self {
        Self {
            level: AtomicU8::new(own & LEVEL),
            has_thread_boost: AtomicBool::new(false),
        }
    }

    #[inline]
    pub(crate) fn get(&self) -> u8 {
        self.level.load(Ordering::Relaxed)
    }

    /// The priority of the process' thread, which is `own` without a boost.
    #[inline]
    pub(crate) fn thread(&self, own: u8, inheritance: &Inheritance) -> u8 {
        if !self.has_thread_boost.load(Ordering::Relaxed) {
            return own;
        }
        let thread = inheritance.thread();
        thread.map_or(own, |thread| own.max(thread.boost()))
    }
}

impl Drop for Inheritance {
    fn drop(&mut self) {
        let thread = *self.thread.get_mut();
        if !thread.is_null() {
            // SAFETY: by the invariant it owns a reference, which ends here.
            drop(unsafe { Arc::from_raw(thread) });
        }
    }
}

impl Inheritance {
    #[inline]
    pub(crate) fn new() -> Self {
        Self {
            thread: AtomicPtr::new(ptr::null_mut()),
            waits: UnsafeCell::new(WaitList::new()),
            counts: UnsafeCell::new(Counts::new()),
        }
    }

    /// The thread of its executor, if the process was ever an inheritor.
    #[inline]
    pub(super) fn thread(&self) -> Option<&ExecutorThread> {
        // Acquire: pairs with the store in `take_thread`. SAFETY: by the invariant it is null, or
        // that of a thread to which this owns a reference.
        unsafe { self.thread.load(Ordering::Acquire).as_ref() }
    }

    /// Whether the process has the thread of its executor, which is the calling one: from the first
    /// call on, if that is an executor's.
    #[inline]
    pub(super) fn has_thread(&self) -> bool {
        self.thread().is_some() || self.take_thread()
    }

    /// Keeps a reference to the calling thread, which is that of the process' executor. Returns
    /// whether the thread is an executor's; that succeeds once at most.
    #[cold]
    fn take_thread(&self) -> bool {
        let Some(thread) = super::cpu::executor_thread() else {
            return false;
        };
        // A second store would leak the first reference, and give `counts` another lock.
        debug_assert!(self.thread().is_none(), "the thread is set once");
        let thread = Arc::into_raw(thread).cast_mut();
        self.thread.store(thread, Ordering::Release);
        true
    }

    /// See [`Process::count_boost`](super::Process::count_boost); of the process at level `now`,
    /// with its own level `own`.
    ///
    /// # Safety
    ///
    /// The lock of the executor's boosts is held.
    pub(crate) unsafe fn count(&self, now: &LevelNow, own: u8, boost: Boost, more: bool) -> bool {
        let level = match boost {
            Boost::Nothing => return false,
            Boost::Level(level) => level & LEVEL,
            Boost::Thread(_) => LEVELS,
        };
        // SAFETY: the caller holds the lock of the executor's boosts, which guards the counts.
        let counts = unsafe { &mut *self.counts.get() };
        let is_counted = counts.count(level, more);
        let highest = counts.highest().max(own & LEVEL);
        now.level.store(highest.min(LEVEL), Ordering::Relaxed);
        now.has_thread_boost
            .store(highest == LEVELS, Ordering::Relaxed);
        is_counted
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    /// Compared with a list of all boosts.
    #[test]
    fn it_runs_at_its_highest_boost_or_its_own_level() {
        for own in [0, 7, 16, LEVEL - 1, LEVEL] {
            let (now, inheritance) = (LevelNow::new(own), Inheritance::new());
            let mut boosts: Vec<u8> = Vec::new();
            let mut state = 1_u64;
            for _ in 0..4000 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let (more, level) = (state >> 63 == 0, (state >> 40) as u8 & LEVEL);
                let level = match more {
                    true => {
                        boosts.push(level);
                        level
                    }
                    false if boosts.is_empty() => continue,
                    false => boosts.swap_remove(usize::from(level) % boosts.len()),
                };
                // SAFETY: no other code has access to it, so no lock is needed.
                let is_counted = unsafe { inheritance.count(&now, own, Boost::Level(level), more) };
                assert!(is_counted);
                let highest = boosts.iter().copied().max().unwrap_or(0).max(own);
                assert_eq!(now.get(), highest);
            }
        }
    }
}

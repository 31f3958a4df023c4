//! The boosts and waits of a process: see [`Inheritor`](super::Inheritor).

use super::LEVELS;
use super::executor_thread::ExecutorThread;
use super::inheritor::Boost;
use crate::wait_list::WaitList;
use alloc::boxed::Box;
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
    counts: UnsafeCell<Counts>,
}

/// The number of boosts to each level above its own: lower ones do not raise it, and are not
/// counted.
struct Counts {
    /// The levels with a boost, one bit each.
    boosts: u32,
    threads: u16,
    /// Of the upper half.
    high: [u16; HALF as usize],
    /// Of the lower half, for a process with its own level there: most have not. Made with the
    /// process, since a boost must not allocate.
    low: Option<Box<[u16; HALF as usize]>>,
}

/// The levels of each half.
const HALF: u8 = LEVELS / 2;

impl Counts {
    /// For a process of this own level.
    #[inline]
    fn new(own: u8) -> Self {
        Self {
            boosts: 0,
            threads: 0,
            high: [0; HALF as usize],
            low: (own < HALF - 1).then(|| Box::new([0; HALF as usize])),
        }
    }

    /// The count of `level`, if it is above the process' own.
    fn of(&mut self, level: u8, own: u8) -> Option<&mut u16> {
        match level {
            _ if level <= own => None,
            HALF.. => self.high.get_mut(usize::from(level - HALF)),
            _ => self.low.as_mut()?.get_mut(usize::from(level)),
        }
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
    /// Of a process at level `own`. Allocates, if that is in the lower half.
    #[inline]
    pub(crate) fn new(own: u8) -> Self {
        Self {
            thread: AtomicPtr::new(ptr::null_mut()),
            waits: UnsafeCell::new(WaitList::new()),
            counts: UnsafeCell::new(Counts::new(own & LEVEL)),
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
        let Some(thread) = super::EXECUTOR_THREAD.with(|slot| slot.borrow().clone()) else {
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
        // SAFETY: the caller holds the lock of the executor's boosts, which guards the counts.
        let counts = unsafe { &mut *self.counts.get() };
        let own = own & LEVEL;
        let count = match boost {
            Boost::Nothing => return false,
            Boost::Level(level) => match counts.of(level & LEVEL, own) {
                Some(count) => count,
                // Its own level is at least that.
                None => return true,
            },
            Boost::Thread(_) => &mut counts.threads,
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
        if let Boost::Level(level) = boost {
            let bit = 1 << (level & LEVEL);
            counts.boosts = if changed == 0 {
                counts.boosts & !bit
            } else {
                counts.boosts | bit
            };
        }
        let has_thread_boost = counts.threads > 0;
        let highest = match has_thread_boost {
            true => LEVEL,
            // 0 without a boost, which is no more than its own.
            false => own.max(31_u32.saturating_sub(counts.boosts.leading_zeros()) as u8),
        };
        now.level.store(highest, Ordering::Relaxed);
        now.has_thread_boost
            .store(has_thread_boost, Ordering::Relaxed);
        true
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    /// Compared with a list of all boosts.
    #[test]
    fn it_runs_at_its_highest_boost_or_its_own_level() {
        for own in [0, 7, HALF - 2, HALF - 1, HALF, LEVEL - 1, LEVEL] {
            let (now, inheritance) = (LevelNow::new(own), Inheritance::new(own));
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

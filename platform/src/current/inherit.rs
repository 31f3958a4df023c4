//! Inheriting a priority: a process that works for another one is as urgent as that one.
//!
//! Who receives on behalf of others names itself as an [`Heir`] before it waits, so that whoever hands it work can lend it a priority in
//! the same step, before it is readied. A process of the same OS priority is lent a *level*: it is queued there from its next wake on. One
//! whose thread is below is lent its thread's priority too: see [`HomeThread`](super::home_thread::HomeThread).
//!
//! Priorities are lent and given back in any order and from any thread, so what is lent is counted: O(1) each, under the lock of the
//! process' home.

use super::home_thread::HomeThread;
use super::process::{LEVELS, Priority, Process};
use super::wakeup::Reference;
use super::{home, process};
use std::cell::UnsafeCell;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

const LEVEL: u8 = LEVELS - 1;
/// Beside the level: the process was lent its thread's priority.
const THREAD: u8 = 1 << 7;

/// What a process was lent, and the level that it runs at for that.
///
/// # Invariants
///
/// `counts` are touched under the lock of `thread` alone. `now` is the process' own level, or the highest that it was lent.
pub(super) struct Inheritance {
    now: AtomicU8,
    own: u8,
    counts: UnsafeCell<Counts>,
    /// None for a process outside of any home, which is lent nothing.
    thread: Option<Arc<HomeThread>>,
}

struct Counts {
    levels: [u16; LEVELS as usize],
    /// Which of them are not 0.
    lent: u32,
    threads: u16,
}

impl Inheritance {
    pub(super) fn new(own: u8, thread: Option<Arc<HomeThread>>) -> Self {
        Self {
            now: AtomicU8::new(own & LEVEL),
            own: own & LEVEL,
            counts: UnsafeCell::new(Counts {
                levels: [0; LEVELS as usize],
                lent: 0,
                threads: 0,
            }),
            thread,
        }
    }

    #[inline]
    pub(super) fn level(&self) -> u8 {
        self.now.load(Ordering::Relaxed) & LEVEL
    }

    /// The priority of the process' thread, which is `own` if nothing was lent.
    #[inline]
    pub(super) fn thread(&self, own: u8) -> u8 {
        if self.now.load(Ordering::Relaxed) & THREAD == 0 {
            return own;
        }
        self.thread
            .as_ref()
            .map_or(own, |thread| own.max(thread.lent()))
    }

    /// Changes what is counted for `lent`, by one more or one less. `false`: there are too many to be counted, and nothing has changed.
    ///
    /// # Safety
    ///
    /// The home's lock is held.
    unsafe fn count(&self, lent: Lent, more: bool) -> bool {
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
        let now = if counts.threads > 0 {
            THREAD | LEVEL
        } else {
            // 0 if none is lent, which is no more than its own.
            self.own
                .max(31_u32.saturating_sub(counts.lent.leading_zeros()) as u8)
        };
        self.now.store(now, Ordering::Relaxed);
        true
    }
}

/// What an heir was lent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lent {
    Nothing,
    Level(u8),
    Thread(u8),
}

/// A process that works for another one, and what it was lent for that. Dropped, it gives it back, on any thread.
///
/// It keeps the memory of the process, not the process: of one that has ended, lending raises its thread alone, and of one whose home was left,
/// nothing.
pub struct Heir {
    reference: Reference,
    lent: Lent,
}

impl Heir {
    /// The current process, or its branch that is being polled; none outside of any.
    #[inline]
    pub fn current() -> Option<Heir> {
        process(|process| {
            let process = process?;
            process.can_inherit().then(|| Heir {
                reference: Reference::to_current(process),
                lent: Lent::Nothing,
            })
        })
    }

    /// Whether it is the current process.
    #[inline]
    pub fn is_current(&self) -> bool {
        process(|process| {
            process.is_some_and(|process| std::ptr::eq(process, self.reference.process()))
        })
    }

    /// Lends it the priority of who it works for, if that is above its own, in place of what it was lent already.
    ///
    /// From any thread. Real-time path: yes; O(1), a priority-inheriting lock if there is something to lend or to give back, and one system call if the
    /// priority of its thread changes by that.
    #[inline]
    pub fn lend(&mut self, priority: Priority) {
        let (process, lowered) = (self.reference.process(), self.reference.lowered());
        let own = process.own_priority();
        let lent = if priority.thread > own.thread {
            Lent::Thread(priority.thread)
        } else if priority.thread == own.thread && priority.level + lowered > own.level {
            // The branch is polled below its process, which is to be that much above.
            Lent::Level((priority.level + lowered).min(LEVEL))
        } else {
            Lent::Nothing
        };
        self.exchange(lent);
    }

    /// Takes what it was lent. As [`lend`](Self::lend) otherwise; it can be lent something again.
    #[inline]
    pub fn give_back(&mut self) {
        self.exchange(Lent::Nothing);
    }

    #[inline]
    fn exchange(&mut self, lent: Lent) {
        if lent != self.lent {
            self.exchange_other(lent);
        }
    }

    /// In one step, so that its thread is not told to go down and up again.
    #[cold]
    fn exchange_other(&mut self, lent: Lent) {
        let inheritance = self.reference.process().inheritance();
        let Some(thread) = &inheritance.thread else {
            return;
        };
        thread.change(|state| {
            let mut change = |lent, more| {
                // SAFETY: the home's lock is held.
                let is_counted = unsafe { inheritance.count(lent, more) };
                if let (Lent::Thread(priority), true) = (lent, is_counted) {
                    state.count(priority, more);
                }
                is_counted
            };
            // The new one first, so that nobody sees the process at its own level in between. One too many to be counted lends nothing.
            let now = if change(lent, true) {
                lent
            } else {
                Lent::Nothing
            };
            change(self.lent, false);
            self.lent = now;
        });
    }
}

impl Drop for Heir {
    #[inline]
    fn drop(&mut self) {
        self.give_back();
    }
}

impl fmt::Debug for Heir {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Heir")
            .field("process", self.reference.process())
            .field("lent", &self.lent)
            .finish()
    }
}

impl Process {
    /// Whether it can be lent a priority: it is referred to by counting, and has a home.
    #[inline]
    fn can_inherit(&self) -> bool {
        self.is_counted() && self.inheritance().thread.is_some() && home() == Some(self.home())
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::super::{Home, Lone, ProcessId, enter_home, priority, with_process};
    use super::*;
    use crate::timer_queue::TimerQueue;
    use std::task::Waker;

    /// Calls `f` within a process of this level.
    fn within(level: u8, f: impl FnOnce()) {
        let home = Home::new();
        let _home = enter_home(home, crate::sync::Arc::new(TimerQueue::new()), true);
        let process = Lone::new(ProcessId::new(), home, 0, level, Waker::noop().clone());
        // SAFETY: this thread is the home, and the process lives.
        unsafe { with_process(&process, f) };
    }

    fn at(level: u8) -> Priority {
        Priority { thread: 0, level }
    }

    #[test]
    fn the_highest_that_is_lent_counts_in_whatever_order_they_go() {
        within(5, || {
            let mut heirs: Vec<Heir> = [9, 20, 9, 3]
                .into_iter()
                .map(|level| {
                    let mut heir = Heir::current().unwrap();
                    heir.lend(at(level));
                    heir
                })
                .collect();
            assert_eq!(priority(), at(20));
            drop(heirs.remove(0));
            assert_eq!(priority(), at(20));
            drop(heirs.remove(0));
            assert_eq!(priority(), at(9));
            drop(heirs.remove(0));
            assert_eq!(priority(), at(5), "a lower one is not inherited");
            heirs[0].lend(at(31));
            assert_eq!(priority(), at(31));
            heirs[0].lend(at(7));
            assert_eq!(priority(), at(7));
            heirs.clear();
            assert_eq!(priority(), at(5));
        });
    }

    #[test]
    fn a_branch_is_lent_what_its_process_is_above_it() {
        within(10, || {
            let mut heir = super::super::with_branch_below(false, 3, Heir::current).unwrap();
            heir.lend(at(20));
            super::super::with_branch_below(false, 3, || assert_eq!(priority(), at(20)));
            heir.lend(at(8));
            super::super::with_branch_below(false, 3, || assert_eq!(priority(), at(8)));
            drop(heir);
            assert_eq!(priority(), at(10));
        });
    }

    #[test]
    fn it_is_given_back_on_another_thread_and_after_the_process() {
        within(5, || {
            let mut heir = Heir::current().unwrap();
            heir.lend(at(9));
            std::thread::scope(|scope| {
                scope.spawn(move || drop(heir));
            });
            assert_eq!(priority(), at(5));
        });
        let mut outlives = None;
        within(5, || outlives = Heir::current());
        let mut heir = outlives.unwrap();
        heir.lend(Priority {
            thread: 50,
            level: 0,
        });
        assert!(!heir.is_current());
    }

    #[test]
    fn nobody_inherits_outside_of_a_process() {
        assert!(Heir::current().is_none());
    }
}

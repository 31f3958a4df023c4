//! Priority inheritance: a process that works for another one is as urgent as that one.
//!
//! A receiver that acts for others registers as an [`Inheritor`] before it waits. A process that
//! hands it work can then boost it in the same step, before it is readied. Between processes of the
//! same OS priority the boost is a *level*: the receiver is queued there from its next wake on. If
//! the receiver's thread has a lower OS priority, the thread is boosted too: see
//! [`ExecutorThread`](super::executor_thread::ExecutorThread).
//!
//! The holder of a lock, or of anything else that processes wait for, is an inheritor too; a plain
//! thread can be one. The waits of a process are listed with it, so that a priority can be passed
//! on along a chain of holders. Only the code that lists a wait knows what the chain consists of.
//!
//! Boosts begin and end in any order and on any thread, so they are counted by their ranks, under
//! the lock of the process' executor. A list of the boosts would have to lie in the inheritors; but
//! these move with what holds them, for instance with an accepted call.

use super::executor_thread::{self, Boosts, ExecutorThread};
use super::inheritance::LEVEL;
use super::wake_handle::Reference;
use super::{Here, PlainTurn, Priority, executor_id, process};
use crate::wait_list::{WaitList, WaitNode};
use alloc::sync::Arc;
use core::cmp::Ordering;
use core::fmt;
use core::ptr::NonNull;

/// The boost of an inheritor; a greater one raises it further.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Boost {
    Nothing,
    Level(u8),
    Thread(u8),
}

/// A process that works for another one, or holds what it waits for, with its boost; or a plain
/// thread that does. Dropping it ends the boost, on any thread.
///
/// It keeps the memory of the process, not the process. If the process has ended, a boost raises
/// its thread alone; if its executor has gone, a boost has no effect.
pub struct Inheritor {
    to: To,
    boost: Boost,
}

enum To {
    Process(Reference),
    Thread(Arc<ExecutorThread>),
}

impl Inheritor {
    /// The current process, or its branch that is being polled; none outside of any.
    #[inline]
    pub fn current() -> Option<Inheritor> {
        process(|process| {
            let process = process?;
            // It can be boosted if it is counted by references, and its executor is this thread.
            let can_inherit = process.is_counted()
                && executor_id() == Some(process.executor_id())
                && process.inheritance().has_thread();
            can_inherit.then(|| Inheritor::to(To::Process(Reference::to_current(process))))
        })
    }

    /// As [`current`](Self::current), of the process in its plain turn.
    #[inline(always)]
    pub fn of_plain_turn(turn: PlainTurn<'_>) -> Option<Inheritor> {
        let has_thread = turn.process().inheritance().has_thread();
        has_thread.then(|| Inheritor::to(To::Process(Reference::of_plain_turn(turn))))
    }

    /// The current process; outside of any, the calling thread itself: for holders that need not be
    /// a process.
    ///
    /// The first call on a plain thread allocates, and makes a few system calls; later ones are
    /// O(1). None while the thread ends.
    #[inline]
    pub fn current_or_thread() -> Option<Inheritor> {
        Inheritor::current()
            .or_else(|| super::cpu::this_thread().map(|thread| Inheritor::to(To::Thread(thread))))
    }

    /// Takes it out to be dropped, unless it is that of a process of this thread, without a boost:
    /// then it ends here, by a few instructions, and may do so under a lock.
    #[inline(always)]
    pub fn end(place: &mut Option<Inheritor>, here: Here<'_>) -> Option<Inheritor> {
        let inheritor = place.as_ref()?;
        if let To::Process(reference) = &inheritor.to
            && inheritor.boost == Boost::Nothing
            && reference.process().executor_number() == here.executor_number()
            && reference.process().remove_unless_ended()
        {
            // SAFETY: it was counted off, so what lies there is overwritten, not dropped.
            unsafe { core::ptr::write(place, None) };
        }
        place.take()
    }

    fn to(to: To) -> Inheritor {
        Inheritor {
            to,
            boost: Boost::Nothing,
        }
    }

    /// Another inheritor for the same process or thread, without a boost. From any thread; O(1).
    pub fn copy(&self) -> Inheritor {
        Inheritor::to(match &self.to {
            To::Process(reference) => To::Process(reference.copy()),
            To::Thread(thread) => To::Thread(thread.clone()),
        })
    }

    /// Whether both are the same process, or the same thread.
    pub fn is_same(&self, other: &Inheritor) -> bool {
        match (&self.to, &other.to) {
            (To::Process(own), To::Process(other)) => core::ptr::eq(own.process(), other.process()),
            (To::Thread(own), To::Thread(other)) => Arc::ptr_eq(own, other),
            _ => false,
        }
    }

    /// Whether it is the current process.
    #[inline]
    pub fn is_current(&self) -> bool {
        match &self.to {
            To::Process(reference) => process(|process| {
                process.is_some_and(|process| core::ptr::eq(process, reference.process()))
            }),
            To::Thread(_) => false,
        }
    }

    /// The current priority. For a process, at the level of the branch that it was made for. A
    /// thread counts as level 0, and as the highest level while it inherits.
    pub fn priority(&self) -> Priority {
        match &self.to {
            To::Process(reference) => reference.process().lowered_priority(reference.lowered()),
            To::Thread(thread) => {
                let (own, boost) = (thread.own_rank(), thread.boost());
                Priority {
                    thread: own.max(boost),
                    level: if boost > own { LEVEL } else { 0 },
                }
            }
        }
    }

    /// As [`priority`](Self::priority), of the caller itself, before it blocks: the priority of a
    /// plain thread is read from the system, which takes two system calls.
    pub fn priority_before_blocking(&self) -> Priority {
        if let To::Thread(thread) = &self.to {
            thread.refresh();
        }
        self.priority()
    }

    /// Boosts it to the priority of the process that it works for, if that is above its own.
    /// Replaces the previous boost. Returns how the new boost compares with the previous one.
    ///
    /// From any thread. Real-time path: yes; O(1), a priority-inheriting lock if that changes
    /// something, and one system call if the priority of its thread changes by that (three for a
    /// plain thread).
    #[inline]
    pub fn inherit(&mut self, priority: Priority) -> Ordering {
        // A branch is polled below the level of its process, so the process needs a level that is
        // higher by the difference.
        let lowered = match &self.to {
            To::Process(reference) => reference.lowered(),
            To::Thread(_) => 0,
        };
        self.boost_above(priority, lowered)
    }

    /// As [`inherit`](Self::inherit), but for the process as a whole: a branch of it then runs as
    /// far below as it ever does. For inheritors that may wait for each other through other
    /// branches: with `inherit`, each round would raise the boost further.
    #[inline]
    pub fn boost_whole(&mut self, priority: Priority) -> Ordering {
        self.boost_above(priority, 0)
    }

    #[inline]
    fn boost_above(&mut self, priority: Priority, lowered: u8) -> Ordering {
        let (before, boost) = (self.boost, self.boost_for(priority, lowered));
        if boost != before {
            self.change(boost);
        }
        self.boost.cmp(&before)
    }

    /// Ends the boost; returns whether there was one.
    #[inline]
    pub fn give_back(&mut self) -> bool {
        let was_boosted = self.boost != Boost::Nothing;
        if was_boosted {
            self.change(Boost::Nothing);
        }
        was_boosted
    }

    /// Sets the thread's priority once more if the system has refused the last change. Linux does
    /// (EBUSY) as long as a thread of a deadline policy waits for a lock that the thread holds. To
    /// be called without a lock. One load if nothing was refused.
    #[inline]
    pub fn catch_up(&self) {
        if let Some(thread) = self.thread() {
            thread.catch_up();
        }
    }

    #[inline]
    fn boost_for(&self, priority: Priority, lowered: u8) -> Boost {
        let thread = executor_thread::boost_from(priority.thread);
        match &self.to {
            To::Process(reference) => {
                let own = reference.process().own_priority();
                let level = priority.level + lowered;
                if thread > own.thread {
                    Boost::Thread(thread)
                } else if priority.thread == own.thread && level > own.level {
                    Boost::Level(level.min(LEVEL))
                } else {
                    Boost::Nothing
                }
            }
            To::Thread(inheritor) => {
                // The own priority of a plain thread is read when it is boosted.
                let own = if inheritor.is_plain() {
                    0
                } else {
                    inheritor.own_rank()
                };
                if thread > own {
                    Boost::Thread(thread)
                } else {
                    Boost::Nothing
                }
            }
        }
    }

    fn thread(&self) -> Option<&ExecutorThread> {
        match &self.to {
            To::Process(reference) => reference.process().inheritance().thread(),
            To::Thread(thread) => Some(thread),
        }
    }

    #[cold]
    fn change(&mut self, to: Boost) {
        let before = core::mem::replace(&mut self.boost, Boost::Nothing);
        let Some(thread) = self.thread() else {
            return;
        };
        let mut counted = false;
        thread.change(|state| {
            // Count the new boost first, so that the thread is never without either. SAFETY: the
            // lock of the executor's boosts is held.
            counted = unsafe { self.count(state, to, true) };
            if before != Boost::Nothing {
                // SAFETY: the lock of the executor's boosts is held.
                unsafe { self.count(state, before, false) };
            }
        });
        if counted {
            self.boost = to;
        }
    }

    /// # Safety
    ///
    /// `state` is that of the executor, and its lock is held.
    unsafe fn count(&self, state: &mut Boosts, boost: Boost, more: bool) -> bool {
        let count_process = |more| match &self.to {
            // SAFETY: the caller holds the lock of the executor, which guards the counts.
            To::Process(reference) => unsafe { reference.process().count_boost(boost, more) },
            To::Thread(_) => boost != Boost::Nothing,
        };
        if !count_process(more) {
            return false;
        }
        if let Boost::Thread(priority) = boost
            && !state.count(priority, more)
        {
            count_process(!more);
            return false;
        }
        true
    }

    /// Lets a ready process run at its new boost: it may be queued at a lower level. A waiting
    /// process is polled once without need.
    ///
    /// From any thread, without a lock that a waker may take. O(1), and a system call if its thread
    /// is elsewhere and sleeps.
    pub fn move_up(&self) {
        let To::Process(reference) = &self.to else {
            return;
        };
        // A process that is alone on its thread has no queue.
        if reference.process().is_owned() && !self.is_current() {
            reference.wake();
        }
    }

    /// Lists `node` among the waits of the process (or the thread), where it is found when the
    /// priority changes. O(1), under the lock of its executor.
    ///
    /// # Safety
    ///
    /// `node` is in no list, stays where it is, and is removed by [`end_wait`](Self::end_wait) of
    /// an inheritor of the same process before it is freed. The callbacks of
    /// [`next_wait`](Self::next_wait) may use it in the meantime.
    pub unsafe fn begin_wait(&self, node: NonNull<WaitNode>) {
        // SAFETY: the caller promises that the node is in no list and stays valid until `end_wait`;
        // the lock is held. All nodes have the same priority, so this is O(1).
        self.with_waits(|waits| unsafe { waits.insert(node, Priority::default(), None) });
    }

    /// Removes what [`begin_wait`](Self::begin_wait) listed. O(1).
    ///
    /// # Safety
    ///
    /// It was listed for this process (or thread).
    pub unsafe fn end_wait(&self, node: NonNull<WaitNode>) {
        // SAFETY: the caller promises that the node is in this list; the lock is held.
        self.with_waits(|waits| unsafe { waits.remove(node) });
    }

    /// Calls `found` with the wait at the lowest address above `address`, if there is one, under
    /// the lock of the inheritor's executor. An iteration by address finds every wait, even if
    /// others begin and end in between. O(waits); there are as many as there are waiting branches.
    pub fn next_wait<R>(
        &self,
        address: usize,
        found: impl FnOnce(NonNull<WaitNode>) -> R,
    ) -> Option<R> {
        self.with_waits(|waits| {
            let further = waits.nodes().filter(|node| node.addr().get() > address);
            further.min_by_key(|node| node.addr()).map(found)
        })
        .flatten()
    }

    fn with_waits<R>(&self, look: impl FnOnce(&mut WaitList) -> R) -> Option<R> {
        Some(self.thread()?.with(|state| match &self.to {
            To::Process(reference) => {
                let waits = reference.process().inheritance().waits.get();
                // SAFETY: the lock of the executor's boosts is held, which guards the list.
                look(unsafe { &mut *waits })
            }
            To::Thread(_) => look(&mut state.waits),
        }))
    }
}

impl Drop for Inheritor {
    #[inline]
    fn drop(&mut self) {
        self.give_back();
    }
}

impl fmt::Debug for Inheritor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut inheritor = f.debug_struct("Inheritor");
        match &self.to {
            To::Process(reference) => inheritor.field("process", reference.process()),
            To::Thread(_) => inheritor.field("thread", &self.priority()),
        };
        inheritor.field("boost", &self.boost).finish()
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::super::{Alone, ExecutorId, ProcessId, enter_executor, priority, with_process};
    use super::*;
    use crate::timer_queue::TimerQueue;
    use core::task::Waker;

    /// Calls `f` within a process of this level.
    fn within(level: u8, f: impl FnOnce()) {
        let executor_id = ExecutorId::new();
        let _entered = enter_executor(
            executor_id,
            luna_platform::sync::Arc::new(TimerQueue::new()),
            true,
        );
        let process = Alone::new(ProcessId::new(), 0, level, Waker::noop().clone());
        // SAFETY: this thread is the executor's, and the process is alive.
        unsafe { with_process(&process, f) };
    }

    fn at(level: u8) -> Priority {
        Priority { thread: 0, level }
    }

    #[test]
    fn the_highest_boost_counts_in_whatever_order_they_end() {
        within(5, || {
            let mut inheritors: Vec<Inheritor> = [9, 20, 9, 3]
                .into_iter()
                .map(|level| {
                    let mut inheritor = Inheritor::current().unwrap();
                    inheritor.inherit(at(level));
                    inheritor
                })
                .collect();
            assert_eq!(priority(), at(20));
            drop(inheritors.remove(0));
            assert_eq!(priority(), at(20));
            drop(inheritors.remove(0));
            assert_eq!(priority(), at(9));
            drop(inheritors.remove(0));
            assert_eq!(priority(), at(5), "a lower one is not inherited");
            inheritors[0].inherit(at(31));
            assert_eq!(priority(), at(31));
            inheritors[0].inherit(at(7));
            assert_eq!(priority(), at(7));
            inheritors.clear();
            assert_eq!(priority(), at(5));
        });
    }

    #[test]
    fn a_branch_inherits_what_its_process_has_above_it() {
        within(10, || {
            let mut inheritor =
                super::super::with_branch_below(false, 3, 0, Inheritor::current).unwrap();
            inheritor.inherit(at(20));
            super::super::with_branch_below(false, 3, 0, || assert_eq!(priority(), at(20)));
            inheritor.inherit(at(8));
            super::super::with_branch_below(false, 3, 0, || assert_eq!(priority(), at(8)));
            drop(inheritor);
            assert_eq!(priority(), at(10));
        });
    }

    #[test]
    fn a_process_inherits_as_a_whole_and_its_branch_is_below_that() {
        within(10, || {
            let mut inheritor =
                super::super::with_branch_below(false, 3, 0, Inheritor::current).unwrap();
            assert_eq!(inheritor.boost_whole(at(10)), Ordering::Equal);
            inheritor.boost_whole(at(20));
            assert_eq!(priority(), at(20));
            assert_eq!(inheritor.priority(), at(17));
        });
    }

    #[test]
    fn it_is_given_back_on_another_thread_and_after_the_process() {
        within(5, || {
            let mut inheritor = Inheritor::current().unwrap();
            inheritor.inherit(at(9));
            std::thread::scope(|scope| {
                scope.spawn(move || drop(inheritor));
            });
            assert_eq!(priority(), at(5));
        });
        let mut outlives = None;
        within(5, || outlives = Inheritor::current());
        let mut inheritor = outlives.unwrap();
        inheritor.inherit(Priority {
            thread: 50,
            level: 0,
        });
        assert!(!inheritor.is_current());
    }

    #[test]
    fn lending_says_whether_it_is_more_or_less() {
        within(5, || {
            let mut inheritor = Inheritor::current().unwrap();
            assert_eq!(inheritor.inherit(at(3)), Ordering::Equal);
            assert_eq!(inheritor.inherit(at(9)), Ordering::Greater);
            assert_eq!(inheritor.inherit(at(9)), Ordering::Equal);
            assert_eq!(inheritor.inherit(at(7)), Ordering::Less);
            assert_eq!(inheritor.copy().priority(), at(7));
            assert!(inheritor.give_back() && !inheritor.give_back());
            assert_eq!(inheritor.priority(), at(5));
        });
    }

    #[test]
    fn waits_are_found_one_by_one_also_from_elsewhere() {
        within(5, || {
            let inheritor = Inheritor::current().unwrap();
            let mut nodes: [WaitNode; 3] = core::array::from_fn(|_| WaitNode::new());
            let nodes = nodes.each_mut().map(NonNull::from);
            // SAFETY: the nodes are in this list alone, and are removed below.
            unsafe {
                for n in [2, 0, 1] {
                    inheritor.begin_wait(nodes[n]);
                }
            }
            std::thread::scope(|scope| {
                let copy = inheritor.copy();
                scope.spawn(move || {
                    let mut above = 0;
                    let mut found = 0;
                    while let Some(at) = copy.next_wait(above, |node| node.addr().get()) {
                        assert!(at > above);
                        (above, found) = (at, found + 1);
                    }
                    assert_eq!(found, 3);
                });
            });
            // SAFETY: the nodes were listed above.
            unsafe {
                for node in nodes {
                    inheritor.end_wait(node);
                }
            }
            assert_eq!(inheritor.next_wait(0, |_| ()), None);
        });
    }

    #[test]
    fn a_plain_thread_inherits_and_gets_its_own_back() {
        let own = luna_platform::thread::current_policy();
        let mut inheritor = Inheritor::current_or_thread().unwrap();
        let before = inheritor.priority_before_blocking();
        let thread = before.thread + 7;
        let boost = inheritor.inherit(Priority { thread, level: 3 });
        assert_eq!(boost, Ordering::Greater);
        assert_eq!(inheritor.priority(), Priority { thread, level: 31 });
        if super::super::refused_boosts().is_none() {
            assert_eq!(
                luna_platform::thread::current_policy(),
                luna_platform::thread::Policy::fifo(thread)
            );
        }
        // A process on this thread counts with the boost of the thread.
        within(5, || {
            let mut of_process = Inheritor::current().unwrap();
            of_process.inherit(Priority {
                thread: thread + 1,
                level: 0,
            });
            assert_eq!(inheritor.priority().thread, thread + 1);
        });
        assert_eq!(inheritor.priority().thread, thread);
        drop(inheritor);
        assert_eq!(luna_platform::thread::current_policy(), own);
    }

    #[test]
    fn nobody_inherits_outside_of_a_process() {
        assert!(Inheritor::current().is_none());
    }
}

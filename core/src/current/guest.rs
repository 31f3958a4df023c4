//! Several executors that take turns on one thread: for code that runs all executors of a system in
//! an order of its own.
//!
//! An executor id stays unique (`entered`), and while an executor is not the present one nothing of
//! it runs. So operations without atomics are still done by one thread, in one order. A wake from
//! one of these executors to another is a remote wake. A lock that is biased to one of them is left
//! before another has its turn, since a critical section does not await.

use super::executor_thread::ExecutorThread;
use super::{
    EXECUTOR_THREAD, ExecutorId, RunQueue, THREAD, entered, executor_id, set_timers, take_timers,
};
use crate::timer_queue::TimerQueue;
use core::marker::PhantomData;
use luna_platform::inside::Inside;
use luna_platform::sync::Arc;

/// An executor that shares its thread with others. It is the thread's executor between
/// [`enter`](Self::enter) and [`leave`](Self::leave); its processes may not block.
///
/// No thread is boosted through it: it has none for itself.
///
/// ```
/// use luna_core::current::{self, Guest, ExecutorId};
/// use luna_platform::sync::Arc;
/// use luna_core::timer_queue::TimerQueue;
///
/// let ids = [ExecutorId::new(), ExecutorId::new()];
/// let mut guests = ids.map(|id| Guest::new(id, Arc::new(TimerQueue::new())));
/// for (guest, executor_id) in guests.iter_mut().zip(ids) {
///     guest.enter();
///     assert_eq!(current::executor_id(), Some(executor_id));
///     guest.leave();
/// }
/// assert_eq!(current::executor_id(), None);
/// ```
pub struct Guest {
    executor_id: ExecutorId,
    /// Stored here while it is not the thread's executor, as are the next two: moved, so that a
    /// turn counts no references.
    timers: Option<Arc<TimerQueue>>,
    queue: RunQueue,
    thread: Option<alloc::sync::Arc<ExecutorThread>>,
    stays_on_its_thread: PhantomData<*const ()>,
}

impl Guest {
    /// Makes `executor_id` one of the calling thread's executors.
    ///
    /// # Panics
    ///
    /// Panics if another thread is this executor, or this one already.
    pub fn new(executor_id: ExecutorId, timers: Arc<TimerQueue>) -> Self {
        entered::enter(executor_id);
        luna_platform::fence::prepare();
        Self {
            executor_id,
            timers: Some(timers),
            queue: RunQueue::new(),
            thread: Some(ExecutorThread::unboosted()),
            stays_on_its_thread: PhantomData,
        }
    }

    /// The levels with a ready process, one bit each, while it is not the thread's executor.
    #[inline]
    pub fn ready_levels(&self) -> u32 {
        self.queue.bits()
    }

    /// Makes this the thread's executor.
    ///
    /// # Panics
    ///
    /// Panics if the thread has another executor, or this one already.
    pub fn enter(&mut self) {
        assert!(
            executor_id().is_none(),
            "this thread runs processes already"
        );
        THREAD.with(|thread| {
            thread.executor_id.set(Some(self.executor_id));
            thread.thread_id.set(Inside::id_of_this_thread());
            thread.may_block.set(false);
            thread.queue.take_over(&self.queue);
        });
        if let Some(timers) = self.timers.take() {
            set_timers(timers);
        }
        EXECUTOR_THREAD.with(|slot| *slot.borrow_mut() = self.thread.take());
    }

    /// The thread has no executor any more, until the next one is entered.
    ///
    /// # Panics
    ///
    /// Panics if the thread's executor is not this one.
    pub fn leave(&mut self) {
        assert!(
            executor_id() == Some(self.executor_id),
            "this thread is another executor"
        );
        THREAD.with(|thread| {
            self.queue.take_over(&thread.queue);
            thread.executor_id.set(None);
            thread.may_block.set(true);
        });
        self.timers = take_timers();
        self.thread = EXECUTOR_THREAD.with(|slot| slot.borrow_mut().take());
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        if executor_id() == Some(self.executor_id) {
            self.leave();
        }
        entered::leave(self.executor_id);
    }
}

luna_platform::debug_fields!(Guest, |guest| executor_id: guest.executor_id);

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::biased_lock::BiasedLock;
    use crate::current::{Alone, LEVELS, ProcessId, enter_executor, with_process};
    use core::task::Waker;

    fn guest() -> Guest {
        Guest::new(ExecutorId::new(), Arc::new(TimerQueue::new()))
    }

    #[test]
    #[should_panic(expected = "runs processes already")]
    fn one_at_a_time() {
        let (mut one, mut other) = (guest(), guest());
        one.enter();
        other.enter();
    }

    #[test]
    #[should_panic(expected = "another thread is this executor")]
    fn its_executor_id_is_taken_also_between_its_turns() {
        let executor_id = ExecutorId::new();
        let _guest = Guest::new(executor_id, Arc::new(TimerQueue::new()));
        let _second = enter_executor(executor_id, Arc::new(TimerQueue::new()), false);
    }

    #[test]
    fn a_lock_biased_to_one_is_taken_by_another_of_the_same_thread() {
        let (mut one, mut other) = (guest(), guest());
        let lock = BiasedLock::new(0);
        one.enter();
        (0..100).for_each(|_| *lock.lock() += 1);
        let was_favouring = lock.is_biased();
        one.leave();
        other.enter();
        (0..100).for_each(|_| *lock.lock() += 1);
        other.leave();
        one.enter();
        assert_eq!(*lock.lock(), 200);
        assert!(!(was_favouring && lock.is_biased()));
    }

    #[test]
    fn each_has_timers_and_the_present_process_of_its_own() {
        let (mut one, mut other) = (guest(), guest());
        one.enter();
        let ours = super::super::timers().unwrap();
        let process = Alone::new(ProcessId::new(), 7, LEVELS - 1, Waker::noop().clone());
        // SAFETY: this thread is the executor's, and the process lives.
        let seen = unsafe { with_process(&process, super::super::priority) };
        assert_eq!((seen.thread, seen.level), (7, LEVELS - 1));
        one.leave();
        other.enter();
        assert!(!Arc::ptr_eq(&ours, &super::super::timers().unwrap()));
        assert!(!super::super::may_block());
        other.leave();
        assert!(super::super::may_block());
    }
}

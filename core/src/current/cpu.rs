//! The executor that a thread is, with all that belongs to it: exchanged as a whole where several
//! executors take turns on one thread, in an order of their own.
//!
//! An executor id is unique (`entered`), and while an executor is not the present one nothing of it
//! runs. So operations without atomics are still done by one thread, in one order. A wake from one
//! of these executors to another is a remote wake. A lock that is biased to one of them is left
//! before another has its turn, since a critical section does not await.

use super::executor_thread::{self, ExecutorThread};
use super::{ExecutorId, RunQueue, THREAD, executor_id, set_on_path};
#[cfg(not(loom))]
use crate::arc_cache::ArcCache;
use crate::model_local::model_local;
#[cfg(not(loom))]
use crate::process::Processes;
use crate::timer_queue::TimerQueue;
use alloc::sync::Arc as StdArc;
use core::cell::RefCell;
use core::marker::PhantomData;
use core::mem;
#[cfg(not(loom))]
use core::mem::ManuallyDrop;
use luna_platform::clock::Instant;
use luna_platform::inside::Inside;
use luna_platform::sync::Arc;

/// What a thread has of the executor that it is, beside what each turn uses.
struct Own {
    timers: Option<Arc<TimerQueue>>,
    thread: Option<StdArc<ExecutorThread>>,
    #[cfg(not(loom))]
    processes: Processes,
}

impl Own {
    const fn nothing() -> Self {
        Self {
            timers: None,
            thread: None,
            #[cfg(not(loom))]
            processes: Processes::new(),
        }
    }
}

model_local! {
    static OWN: RefCell<Own> = const { RefCell::new(Own::nothing()) };
    /// References to the thread's timers, kept from sleeps that have ended, as long as the thread
    /// is an executor: so nothing is left to be dropped with the thread. A model counts each.
    #[cfg(not(loom))]
    static SPARE_TIMERS: ManuallyDrop<ArcCache<TimerQueue>> =
        const { ManuallyDrop::new(ArcCache::new()) };
}

/// An executor on its thread. It is the thread's executor between [`enter`](Self::enter) and
/// [`leave`](Self::leave), and until it is dropped: on the same thread, so it is not `Send`.
///
/// ```
/// use luna_core::current::{self, Cpu, ExecutorId};
/// use luna_platform::sync::Arc;
/// use luna_core::timer_queue::TimerQueue;
///
/// let ids = [ExecutorId::new(), ExecutorId::new()];
/// let mut cpus = ids.map(|id| Cpu::sharing(id, Arc::new(TimerQueue::new())));
/// for (cpu, executor_id) in cpus.iter_mut().zip(ids) {
///     cpu.enter();
///     assert_eq!(current::executor_id(), Some(executor_id));
///     cpu.leave();
/// }
/// assert_eq!(current::executor_id(), None);
/// ```
///
/// ```compile_fail,E0277
/// fn can_be_sent(_: impl Send) {}
/// use luna_core::{current, timer_queue::TimerQueue};
/// use luna_platform::sync::Arc;
/// let (executor, timers) = (current::ExecutorId::new(), Arc::new(TimerQueue::new()));
/// can_be_sent(current::enter_executor(executor, timers, false));
/// ```
#[must_use = "the thread stops being an executor when this is dropped"]
pub struct Cpu {
    executor_id: ExecutorId,
    may_block: bool,
    /// Both lie here while it is not the thread's executor.
    queue: RunQueue,
    own: Own,
    stays_on_its_thread: PhantomData<*const ()>,
}

/// Marks this thread as the executor `executor_id` with its `timers` until the result is dropped.
/// `may_block`: its processes may make blocking calls, since it runs a single one.
///
/// # Panics
///
/// Panics if another thread is this executor: operations without atomics rely on there being one.
/// Panics if the thread is an executor already: a process must not run a system or an executor
/// inside itself, since that would block its own. Check [`executor_id`] first if that depends on
/// the caller.
pub fn enter_executor(executor_id: ExecutorId, timers: Arc<TimerQueue>, may_block: bool) -> Cpu {
    assert!(
        self::executor_id().is_none(),
        "this thread runs processes already"
    );
    // The boosts of a plain thread count while it is an executor too: two records of one thread
    // would each restore what the other had set.
    let thread = || match executor_thread::known_plain() {
        Some(plain) => {
            plain.refresh();
            plain
        }
        None => ExecutorThread::new(),
    };
    let mut cpu = Cpu::new(executor_id, timers, may_block, thread);
    cpu.enter();
    cpu
}

impl Cpu {
    /// One that shares the calling thread with others; its processes may not block. No thread is
    /// boosted through it: it has none for itself.
    ///
    /// # Panics
    ///
    /// Panics if another thread is this executor, or this one already.
    pub fn sharing(executor_id: ExecutorId, timers: Arc<TimerQueue>) -> Self {
        Self::new(executor_id, timers, false, ExecutorThread::unboosted)
    }

    fn new(
        executor_id: ExecutorId,
        timers: Arc<TimerQueue>,
        may_block: bool,
        thread: impl FnOnce() -> StdArc<ExecutorThread>,
    ) -> Self {
        entered::enter(executor_id);
        luna_platform::fence::prepare();
        Self {
            executor_id,
            may_block,
            queue: RunQueue::new(),
            own: Own {
                timers: Some(timers),
                thread: Some(thread()),
                ..Own::nothing()
            },
            stays_on_its_thread: PhantomData,
        }
    }

    /// The levels with a ready process, one bit each, while it is not the thread's executor.
    #[inline]
    pub fn ready_levels(&self) -> u32 {
        self.queue.bits()
    }

    /// How many processes it has, while it is not the thread's executor.
    #[cfg(not(loom))]
    #[cfg_attr(not(feature = "std"), allow(dead_code, reason = "for simulations"))]
    pub(crate) fn process_count(&self) -> usize {
        self.own.processes.count()
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
            thread.may_block.set(self.may_block);
            thread.queue.take_over(&self.queue);
        });
        #[cfg(not(loom))]
        if let Some(timers) = &self.own.timers {
            SPARE_TIMERS.with(|spare| spare.keep(timers));
        }
        self.exchange();
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
        set_on_path(false);
        #[cfg(not(loom))]
        SPARE_TIMERS.with(|spare| spare.release());
        self.exchange();
    }

    fn exchange(&mut self) {
        OWN.with(|own| mem::swap(&mut *own.borrow_mut(), &mut self.own));
    }
}

impl Drop for Cpu {
    fn drop(&mut self) {
        if executor_id() == Some(self.executor_id) {
            self.leave();
        }
        if let Some(thread) = self.own.thread.take()
            && !thread.is_plain()
        {
            thread.leave();
        }
        entered::leave(self.executor_id);
    }
}

luna_platform::debug_fields!(Cpu, |cpu| executor_id: cpu.executor_id);

/// The processes of this thread's executor.
#[cfg(not(loom))]
pub(crate) fn with_processes<R>(f: impl FnOnce(&mut Processes) -> R) -> R {
    OWN.with(|own| f(&mut own.borrow_mut().processes))
}

/// The calling thread, with its own boosts: as an executor's, or as a plain one. None while it
/// ends, and in a model.
pub(super) fn this_thread() -> Option<StdArc<ExecutorThread>> {
    #[cfg(not(loom))]
    return OWN
        .try_with(|own| own.borrow().thread.clone())
        .ok()?
        .or_else(executor_thread::plain);
    #[cfg(loom)]
    None
}

/// The calling thread as an executor's, with its boosts.
pub(super) fn executor_thread() -> Option<StdArc<ExecutorThread>> {
    OWN.with(|own| own.borrow().thread.clone())
}

fn with_timers<R>(f: impl FnOnce(Option<&Arc<TimerQueue>>) -> R) -> R {
    OWN.with(|own| f(own.borrow().timers.as_ref()))
}

/// The timers of this thread, if it runs processes.
#[inline]
pub fn timers() -> Option<Arc<TimerQueue>> {
    #[cfg(not(loom))]
    if let Some(timers) = SPARE_TIMERS.with(|spare| spare.kept()) {
        return Some(timers);
    }
    with_timers(|timers| timers.cloned())
}

/// Returns a reference of [`timers`] that is not needed any more.
#[inline]
pub(crate) fn give_back_timers(timers: Arc<TimerQueue>) {
    #[cfg(not(loom))]
    SPARE_TIMERS.with(move |spare| spare.give_back(timers));
    #[cfg(loom)]
    drop(timers);
}

/// Makes this thread's executor read the clock before its next poll.
pub fn ask_look() {
    with_timers(|timers| {
        if let Some(timers) = timers {
            timers.ask_look();
        }
    });
}

/// Whether no deadline of this thread's processes comes within `time`. A clock reading if there is
/// any deadline.
pub(crate) fn has_no_deadline_within(time: core::time::Duration) -> bool {
    let next = with_timers(|timers| timers.map(|timers| timers.next_deadline()));
    let next = next.unwrap_or(Instant::NEVER);
    next == Instant::NEVER || Instant::now() + time < next
}

/// Whether this thread runs processes and its timers are other ones than `timers`.
#[inline]
pub(crate) fn has_other_timers(timers: &Arc<TimerQueue>) -> bool {
    #[cfg(not(loom))]
    if SPARE_TIMERS.with(|spare| spare.keeps(timers)) {
        return false;
    }
    with_timers(|own| own.is_some_and(|own| !Arc::ptr_eq(own, timers)))
}

/// The executors that threads are now.
#[cfg(not(loom))]
mod entered {
    use super::ExecutorId;
    use alloc::vec::Vec;
    use luna_platform::lock::PiLock;

    static ENTERED: PiLock<Vec<ExecutorId>> = PiLock::new(Vec::new());

    pub(super) fn enter(executor_id: ExecutorId) {
        let mut entered = ENTERED.lock();
        let is_free = !entered.contains(&executor_id);
        if is_free {
            entered.push(executor_id);
        }
        drop(entered);
        assert!(is_free, "another thread is this executor");
    }

    pub(super) fn leave(executor_id: ExecutorId) {
        ENTERED.lock().retain(|&other| other != executor_id);
    }
}

/// A model runs many times, with an executor of its own each time.
#[cfg(loom)]
mod entered {
    pub(super) fn enter(_: super::ExecutorId) {}

    pub(super) fn leave(_: super::ExecutorId) {}
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use crate::biased_lock::BiasedLock;
    use crate::current::{Alone, LEVELS, ProcessId, enter_executor, with_process};
    use core::task::Waker;

    fn cpu() -> Cpu {
        Cpu::sharing(ExecutorId::new(), Arc::new(TimerQueue::new()))
    }

    #[test]
    #[should_panic(expected = "runs processes already")]
    fn one_at_a_time() {
        let (mut one, mut other) = (cpu(), cpu());
        one.enter();
        other.enter();
    }

    #[test]
    #[should_panic(expected = "another thread is this executor")]
    fn its_executor_id_is_taken_also_between_its_turns() {
        let executor_id = ExecutorId::new();
        let _cpu = Cpu::sharing(executor_id, Arc::new(TimerQueue::new()));
        let _second = enter_executor(executor_id, Arc::new(TimerQueue::new()), false);
    }

    #[test]
    fn a_lock_biased_to_one_is_taken_by_another_of_the_same_thread() {
        let (mut one, mut other) = (cpu(), cpu());
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
        let (mut one, mut other) = (cpu(), cpu());
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

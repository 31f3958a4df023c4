//! The processes and threads of one system: how many processes live, and whether all threads sleep
//! for good.

use super::{ExecutorId, Process, ProcessHandle, ProcessRef};
use crate::path::{self, Call};
use crate::quiescence::{Look, Sleeper, Stretch, look, watch_all};
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::mem;
use core::ptr::{self, NonNull};
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::sync::plain::{AtomicPtr, AtomicU64, AtomicUsize, Ordering};

/// Counts the processes that have not ended, so that one thread can wait for the last. It also has
/// their threads, to detect that none of them will ever wake by itself.
///
/// # Invariants
///
/// `ended` is null, or `CLOSED`, or leads along the records' `next` to null: each pointer of this
/// chain was that of a `ProcessRef`, which is owned by its place in it.
pub struct ProcessRegistry {
    count: AtomicUsize,
    changes: Futex,
    /// Number of hurried ends.
    hurried: AtomicU64,
    /// Number of threads that wait and are woken by any end.
    watchful: AtomicUsize,
    /// Number of threads that wait and are not woken by an unhurried end.
    resting: AtomicUsize,
    /// The listed processes that have ended, the last one first.
    ended: AtomicPtr<Process>,
    /// The threads that live, in the order of their start. Threads take the lock as they
    /// start and end, off the path.
    threads: PiLock<Vec<(ExecutorId, Arc<dyn Sleeper>)>>,
}

/// All threads of a [`ProcessRegistry`] slept at one instant, without deadlines, files, calls on
/// the pool or wakes under way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Quiescent(Vec<(ExecutorId, Stretch)>);

/// The list is closed: ended processes are no longer collected.
const CLOSED: *mut Process = ptr::without_provenance_mut(1);

impl ProcessRegistry {
    /// An empty registry.
    pub fn new() -> Self {
        Self {
            count: AtomicUsize::new(0),
            changes: Futex::new(0),
            hurried: AtomicU64::new(0),
            watchful: AtomicUsize::new(0),
            resting: AtomicUsize::new(0),
            ended: AtomicPtr::new(ptr::null_mut()),
            threads: PiLock::new(Vec::new()),
        }
    }

    /// Number of processes that have not ended.
    pub fn count(&self) -> usize {
        self.count.load(Ordering::Acquire)
    }

    /// Number of processes that have ended and are not [unhurried](crate::ProcessSpec::unhurried).
    /// A thread that reads the number sees their ends.
    pub fn hurried(&self) -> u64 {
        self.hurried.load(Ordering::Acquire)
    }

    /// A number that changes whenever a process ends, [`announce`](Self::announce) is called, or a
    /// thread becomes quiescent and [`quiescent`](Self::quiescent) or [`watch`](Self::watch) waits
    /// for that.
    pub fn changes(&self) -> u32 {
        self.changes.word().load(Ordering::Acquire)
    }

    /// Sleeps until the number is no longer `seen`, or until `deadline`. May return without a
    /// cause.
    pub fn wait(&self, seen: u32, deadline: Instant) {
        self.wait_as(&self.watchful, seen, deadline);
    }

    /// As [`wait`](Self::wait), but the end of an unhurried process
    /// ([`ProcessSpec::unhurried`](crate::ProcessSpec::unhurried)) does not end the sleep, unless
    /// it is the last that lives. For a caller that has just handled such ends and looks again soon
    /// anyway. So many ends in a row cost no system call.
    pub fn rest(&self, seen: u32, deadline: Instant) {
        self.wait_as(&self.resting, seen, deadline);
    }

    fn wait_as(&self, waiting: &AtomicUsize, seen: u32, deadline: Instant) {
        // In one order with `change`: either the thread that changes the number sees this waiter,
        // or this waiter sees the change.
        waiting.fetch_add(1, Ordering::SeqCst);
        if self.changes.word().load(Ordering::SeqCst) == seen {
            self.changes.wait(seen, deadline);
        }
        waiting.fetch_sub(1, Ordering::Relaxed);
    }

    /// Wakes the waiting threads. Makes a system call only if there is one.
    pub fn announce(&self) {
        self.change(true);
    }

    fn change(&self, in_a_hurry: bool) {
        self.changes.word().fetch_add(1, Ordering::SeqCst);
        let is_awaited = self.watchful.load(Ordering::SeqCst) > 0
            || in_a_hurry && self.resting.load(Ordering::SeqCst) > 0;
        if is_awaited {
            path::expected(Call::Wake, || self.changes.wake_all());
        }
    }

    /// Passes the processes that have ended since the last call to `each`, in the order of their
    /// ends; only those that are to be [listed](crate::ProcessSpec::listed). O(their
    /// number). It may free memory, so it is not for the real-time path.
    pub fn take_ended(&self, each: impl FnMut(ProcessHandle)) {
        self.exchange_ended(ptr::null_mut(), each);
    }

    /// As [`take_ended`](Self::take_ended), for the last time: processes that end later are not
    /// listed. To be called at the end by what has listed processes: those that were listed and not
    /// taken keep this registry, by their executor, and are never freed.
    pub fn close_ended(&self, each: impl FnMut(ProcessHandle)) {
        self.exchange_ended(CLOSED, each);
    }

    /// Passes on what is listed, unless the list is closed, and leaves `rest`.
    fn exchange_ended(&self, rest: *mut Process, each: impl FnMut(ProcessHandle)) {
        let taken = self
            .ended
            .fetch_update(Ordering::Acquire, Ordering::Relaxed, |newest| {
                (newest != rest && newest != CLOSED).then_some(rest)
            });
        if let Ok(newest) = taken {
            // SAFETY: it was just taken out, by one thread.
            unsafe { pass_on(newest, each) };
        }
    }

    /// Lists a process that has ended, unless the list is closed.
    fn list(&self, process: ProcessRef) {
        let pointer = process.0.as_ptr();
        // Release: the thread that takes it sees how the process ended.
        let listed = self
            .ended
            .fetch_update(Ordering::Release, Ordering::Relaxed, |newest| {
                let is_open = newest != CLOSED;
                process.record.next.store(newest, Ordering::Relaxed);
                is_open.then_some(pointer)
            });
        if listed.is_ok() {
            // The list has it.
            mem::forget(process);
        }
    }

    /// Whether there was an instant during this call at which all threads slept with nothing of
    /// their own to wake them: no deadline, no file that is waited for, no call on the pool under
    /// way, and no wake under way from one to another. If not, the number of
    /// [`changes`](Self::changes) changes as soon as it is worth another look.
    ///
    /// Threads that have ended do not count; one that blocks within a poll, as in a blocking
    /// receive, counts as busy. What other threads do meanwhile (plain ones, those of other
    /// systems) may end the quiescence at any time: [`is_yet`](Self::is_yet). Not for the real-time
    /// path: O(threads), and it allocates.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// use luna_core::{Executor, ProcessRegistry, ProcessSpec};
    /// use luna_platform::{clock::Instant, thread::Attributes};
    /// use std::sync::Arc;
    ///
    /// let registry = Arc::new(ProcessRegistry::new());
    /// let executor = Executor::start_counted(Attributes::new("main"), registry.clone())?;
    /// let stuck = executor.spawn(ProcessSpec::new("stuck"), || std::future::pending());
    /// executor.release();
    /// let quiescence = loop {
    ///     let seen = registry.changes();
    ///     if let Some(quiescence) = registry.quiescent() {
    ///         break quiescence;
    ///     }
    ///     registry.wait(seen, Instant::NEVER); // until it is worth another look
    /// };
    /// assert!(registry.is_yet(&quiescence) && registry.count() == 1);
    /// stuck.cancel();
    /// stuck.wait();
    /// assert!(!registry.is_yet(&quiescence));
    /// # Ok(()) }
    /// ```
    pub fn quiescent(&self) -> Option<Quiescent> {
        let threads = self.threads.lock();
        match look(&sleepers(&threads)) {
            Look::Quiescent(stretches) => {
                let executor_ids = threads.iter().map(|(executor_id, _)| *executor_id);
                Some(Quiescent(executor_ids.zip(stretches).collect()))
            }
            Look::Stirring => None,
            Look::Unclear => {
                drop(threads);
                self.announce();
                None
            }
        }
    }

    /// Whether the threads have slept on since `quiescence`, that is, no wake has reached any of
    /// them. Not for the real-time path: O(threads).
    pub fn is_yet(&self, quiescent: &Quiescent) -> bool {
        let threads = self.threads.lock();
        let now = threads.iter().map(|(executor_id, thread)| {
            let stretch = thread.quiescence().stretch();
            (*executor_id, stretch.filter(|_| !thread.is_woken()))
        });
        now.eq(quiescent
            .0
            .iter()
            .map(|&(executor_id, stretch)| (executor_id, Some(stretch))))
    }

    /// From now on the next time that a thread falls still changes the number of
    /// [`changes`](Self::changes), once for each thread.
    pub fn watch(&self) {
        watch_all(&sleepers(&self.threads.lock()));
    }

    /// Counts a thread in until the guard is dropped.
    pub(crate) fn enroll(
        self: &Arc<Self>,
        executor_id: ExecutorId,
        thread: Arc<dyn Sleeper>,
    ) -> Enrolled {
        // The thread that waits for another look may not know of this one yet.
        thread.quiescence().watch();
        self.threads.lock().push((executor_id, thread));
        Enrolled {
            registry: self.clone(),
            executor_id,
        }
    }

    #[inline]
    pub(super) fn enter(&self) {
        self.count.fetch_add(1, Ordering::AcqRel);
    }

    /// Counts out a process that has ended, and lists it if it is given. The end of an unhurried
    /// process is reported only to threads that wait for any end or for the last one.
    pub(super) fn leave(&self, listed: Option<ProcessRef>, in_a_hurry: bool) {
        if let Some(process) = listed {
            self.list(process);
        }
        if in_a_hurry {
            self.hurried.fetch_add(1, Ordering::Release);
        }
        let was_last = self.count.fetch_sub(1, Ordering::AcqRel) == 1;
        self.change(in_a_hurry || was_last);
    }
}

/// Passes the processes of a chain on, the oldest first.
///
/// # Safety
///
/// It was taken out of the list of a registry, by the caller alone.
unsafe fn pass_on(newest: *mut Process, mut each: impl FnMut(ProcessHandle)) {
    // By the registry's invariant each pointer was that of a reference, owned by its place in the
    // chain, which the caller has taken out. A panic in `each` leaks the rest.
    let (mut next, mut oldest) = (NonNull::new(newest), ptr::null_mut());
    while let Some(process) = next {
        // SAFETY: as above, so it is live.
        let link = &unsafe { process.as_ref() }.record.next;
        next = NonNull::new(link.load(Ordering::Relaxed));
        link.store(oldest, Ordering::Relaxed);
        oldest = process.as_ptr();
    }
    let mut next = NonNull::new(oldest);
    while let Some(process) = next {
        let process = ProcessRef(process);
        next = NonNull::new(process.record.next.load(Ordering::Relaxed));
        each(ProcessHandle(process));
    }
}

fn sleepers(threads: &[(ExecutorId, Arc<dyn Sleeper>)]) -> Vec<&dyn Sleeper> {
    threads.iter().map(|(_, thread)| &**thread).collect()
}

/// A thread that is counted in.
pub(crate) struct Enrolled {
    registry: Arc<ProcessRegistry>,
    executor_id: ExecutorId,
}

impl Drop for Enrolled {
    fn drop(&mut self) {
        let gone = {
            let mut threads = self.registry.threads.lock();
            let place = threads
                .iter()
                .position(|(executor_id, _)| *executor_id == self.executor_id);
            place.map(|place| threads.remove(place))
        };
        drop(gone);
        // It may have been the only thread that was not still.
        self.registry.announce();
    }
}

luna_platform::debug_fields!(ProcessRegistry, |registry| count: registry.count());

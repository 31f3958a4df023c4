//! The processes and threads of one system: how many processes live, and whether all threads sleep
//! for good.

use super::ProcessHandle;
use super::record::{Record, RecordRef};
use crate::current::ExecutorId;
use crate::deferred_free::Retired;
use crate::path::{self, Call};
use crate::quiescence::{Look, Sleeper, Stretch, look, watch_all};
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::cell::Cell;
use core::ptr::{self, NonNull};
use luna_platform::clock::Instant;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use luna_platform::on_drop::OnDrop;
use luna_platform::sync::plain::{AtomicBool, AtomicPtr, AtomicU64, AtomicUsize, Ordering};

/// Counts the processes that have not ended, so that one thread can wait for the last. It also has
/// their threads, to detect that none of them will ever wake by itself.
///
/// # Invariants
///
/// `ended` is a chain of records, each of which is owned by its place there; or `CLOSED`. A chain
/// leads along the records' links, whose pointers are those of `RecordRef`s.
pub struct ProcessRegistry {
    count: AtomicUsize,
    changes: Futex,
    /// Number of hurried ends.
    hurried: AtomicU64,
    /// Number of threads that wait and are woken by any end.
    watchful: AtomicUsize,
    /// Number of threads that wait and are not woken by an unhurried end.
    resting: AtomicUsize,
    /// Whether the next end counts as hurried in any case.
    is_urgent: AtomicBool,
    /// The listed processes that have ended, the last one first.
    ended: AtomicPtr<Retired>,
    /// The threads that live, in the order of their start. Threads take the lock as they
    /// start and end, off the path.
    threads: PiLock<Vec<(ExecutorId, Arc<dyn Sleeper>)>>,
}

/// The largest batch of ends that an executor's thread keeps.
const MAX_KEPT: usize = 32;

/// The ends of unhurried processes that this thread has not reported yet: see
/// [`ProcessRegistry::keep_ends`].
///
/// # Invariants
///
/// While `of` is not null it is live. `newest` leads to `oldest` as a chain of records, each owned
/// by its place there.
struct Kept {
    of: Cell<*const ProcessRegistry>,
    /// Number of processes that have ended and still count as living. The next process made on this
    /// thread takes the place of one of them in the count.
    counted: Cell<usize>,
    newest: Cell<*mut Retired>,
    oldest: Cell<*mut Retired>,
    listed: Cell<usize>,
}

luna_platform::local! {
    static KEPT: Kept = const {
        Kept {
            of: Cell::new(ptr::null()),
            counted: Cell::new(0),
            newest: Cell::new(ptr::null_mut()),
            oldest: Cell::new(ptr::null_mut()),
            listed: Cell::new(0),
        }
    };
}

impl Kept {
    #[inline]
    fn is_of(&self, registry: &ProcessRegistry) -> bool {
        ptr::eq(self.of.get(), registry)
    }

    fn is_full(&self) -> bool {
        self.counted.get() >= MAX_KEPT || self.listed.get() >= MAX_KEPT
    }

    fn list(&self, record: RecordRef) {
        let record = record.into_raw();
        let before = self.newest.replace(record.as_ptr().cast());
        // SAFETY: it is owned, and in no chain yet.
        unsafe { record.as_ref() }
            .link()
            .store(before, Ordering::Relaxed);
        if before.is_null() {
            self.oldest.set(record.as_ptr().cast());
        }
        self.listed.set(self.listed.get() + 1);
    }

    /// Takes the chain, which begins at the newest, out.
    fn take(&self) -> *mut Retired {
        self.listed.set(0);
        self.newest.replace(ptr::null_mut())
    }
}

/// All threads of a [`ProcessRegistry`] slept at one instant, without deadlines, files, calls on
/// the pool or wakes under way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Quiescent(Vec<(ExecutorId, Stretch)>);

/// The list is closed: ended processes are no longer collected.
const CLOSED: *mut Retired = ptr::without_provenance_mut(1);

impl ProcessRegistry {
    /// An empty registry.
    pub fn new() -> Self {
        Self {
            count: AtomicUsize::new(0),
            changes: Futex::new(0),
            hurried: AtomicU64::new(0),
            watchful: AtomicUsize::new(0),
            resting: AtomicUsize::new(0),
            is_urgent: AtomicBool::new(false),
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
    ///
    /// An executor may report such ends in a batch: when it has nothing to do, or when there are 32
    /// of them; at once if it sees that a thread [waits](Self::wait) for any end.
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

    /// Makes the next end a hurried one: see [`rest`](Self::rest). A process that is about to end
    /// calls this for its own end. If another process ends first, that end is reported in its
    /// place, and the resting thread looks again soon.
    pub fn announce_next(&self) {
        self.is_urgent.store(true, Ordering::Relaxed);
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
    #[inline]
    pub fn take_ended(&self, mut each: impl FnMut(ProcessHandle)) {
        for record in self.take_reported() {
            each(ProcessHandle(record));
        }
        let own = KEPT.with(|kept| match kept.is_of(self) {
            true => kept.take(),
            false => ptr::null_mut(),
        });
        // SAFETY: by the invariant of `Kept` it is null or begins a chain of owned records, and it
        // was just taken out, so no other code has it.
        for record in unsafe { Chain::reversed(own) } {
            each(ProcessHandle(record));
        }
    }

    /// The ends reported since the last call, in order.
    fn take_reported(&self) -> Chain {
        let mut ended = self.ended.load(Ordering::Relaxed);
        loop {
            if ended.is_null() || ended == CLOSED {
                return Chain(None);
            }
            let taken = self.ended.compare_exchange_weak(
                ended,
                ptr::null_mut(),
                Ordering::Acquire,
                Ordering::Relaxed,
            );
            match taken {
                // SAFETY: by the invariant of `ended` it begins a chain of owned records, which this
                // exchange has taken out.
                Ok(_) => return unsafe { Chain::reversed(ended) },
                Err(now) => ended = now,
            }
        }
    }

    /// As [`take_ended`](Self::take_ended), for the last time: processes that end later are not
    /// listed.
    pub fn close_ended(&self, mut each: impl FnMut(ProcessHandle)) {
        let ended = self.ended.swap(CLOSED, Ordering::Acquire);
        if ended != CLOSED {
            // SAFETY: by the invariant of `ended` it is null or begins a chain of owned records,
            // which the exchange has taken out.
            for record in unsafe { Chain::reversed(ended) } {
                each(ProcessHandle(record));
            }
        }
    }

    /// Lists the records of a chain from the newest to the oldest.
    ///
    /// # Safety
    ///
    /// It is a chain of records that are owned by their places in it. The caller gives up its
    /// ownership.
    pub(super) unsafe fn list_chain(&self, newest: *mut Retired, oldest: *mut Retired) {
        let mut first = self.ended.load(Ordering::Relaxed);
        while first != CLOSED {
            // SAFETY: the caller owns the records of the chain by their places, so the oldest is
            // live; it gives them up only by an exchange that succeeds.
            unsafe { (*oldest).link().store(first, Ordering::Relaxed) };
            // Release: the thread that takes the record sees how the process ended.
            match self.ended.compare_exchange_weak(
                first,
                newest,
                Ordering::Release,
                Ordering::Relaxed,
            ) {
                Ok(_) => return,
                Err(now) => first = now,
            }
        }
        // SAFETY: no exchange has succeeded, so the chain is still the caller's, and its oldest
        // record is live. It is given up here.
        unsafe {
            (*oldest).link().store(ptr::null_mut(), Ordering::Relaxed);
            drop(Chain::reversed(newest));
        }
    }

    /// Until the guard is dropped the calling thread, an executor's, batches the ends of its
    /// unhurried processes. It reports them in [`report_kept`](Self::report_kept), which it calls
    /// before it sleeps, so a waiter waits no longer than the executor works.
    pub(crate) fn keep_ends(self: &Arc<Self>) -> OnDrop<impl FnMut() + use<>> {
        KEPT.with(|kept| kept.of.set(Arc::as_ptr(self)));
        let registry = self.clone();
        OnDrop::new(move || {
            registry.report_kept();
            KEPT.with(|kept| kept.of.set(ptr::null()));
        })
    }

    /// Reports the ends that this thread has batched. Real-time path: yes; O(1).
    #[inline]
    pub(crate) fn report_kept(&self) {
        KEPT.with(|kept| {
            if kept.is_of(self) && (kept.counted.get() > 0 || !kept.newest.get().is_null()) {
                self.report(kept);
            }
        });
    }

    #[cold]
    fn report(&self, kept: &Kept) {
        let newest = kept.take();
        if !newest.is_null() {
            // SAFETY: by the invariant of `Kept` the newest leads to the oldest, each owned by its
            // place; the chain was just taken out, so no other code has it.
            unsafe { self.list_chain(newest, kept.oldest.get()) };
        }
        let ended = kept.counted.take();
        let are_last = ended > 0 && self.count.fetch_sub(ended, Ordering::AcqRel) == ended;
        self.change(are_last);
    }

    /// Adds the end of a process to this thread's batch, with its record if that is to be listed;
    /// O(1). `Err`: it is in a hurry, or the thread keeps no batch.
    #[inline]
    pub(super) fn keep(
        &self,
        record: Option<RecordRef>,
        in_a_hurry: bool,
    ) -> Result<(), Option<RecordRef>> {
        KEPT.with(|kept| {
            // An announced end is reported at once, and with it all earlier ones, so that the order
            // stays.
            if in_a_hurry || !kept.is_of(self) || self.is_urgent.load(Ordering::Relaxed) {
                return Err(record);
            }
            if let Some(record) = record {
                kept.list(record);
            }
            kept.counted.set(kept.counted.get() + 1);
            if kept.is_full() || self.watchful.load(Ordering::Relaxed) > 0 {
                self.report(kept);
            }
            Ok(())
        })
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
        let is_counted = KEPT.with(|kept| {
            let counted = kept.counted.get();
            let is_counted = counted > 0 && kept.is_of(self);
            if is_counted {
                kept.counted.set(counted - 1);
            }
            is_counted
        });
        if !is_counted {
            self.count.fetch_add(1, Ordering::AcqRel);
        }
    }

    /// Counts out a process that has ended. The end of an unhurried process is reported only to
    /// threads that wait for any end or for the last one.
    pub(super) fn leave(&self, in_a_hurry: bool) {
        if in_a_hurry {
            self.hurried.fetch_add(1, Ordering::Release);
        }
        let was_last = self.count.fetch_sub(1, Ordering::AcqRel) == 1;
        let was_announced =
            self.is_urgent.load(Ordering::Relaxed) && self.is_urgent.swap(false, Ordering::Relaxed);
        self.change(in_a_hurry || was_last || was_announced);
    }
}

impl Drop for ProcessRegistry {
    fn drop(&mut self) {
        self.close_ended(|_| ());
    }
}

/// A chain of records that was taken out, as an iterator of them.
///
/// # Invariants
///
/// Each record of it is owned by its place in it.
struct Chain(Option<NonNull<Record>>);

impl Chain {
    /// Reverses the chain that begins at `first`, the oldest of which has no link.
    ///
    /// # Safety
    ///
    /// It is null, or begins a chain of records that are owned by their places in it. The caller
    /// gives up its ownership.
    #[inline]
    unsafe fn reversed(first: *mut Retired) -> Self {
        let mut behind = ptr::null_mut();
        let mut next = NonNull::new(first);
        while let Some(record) = next {
            // SAFETY: a chain's records are owned by it, and this one was given away, as is demanded
            // here.
            let link = unsafe { record.as_ref() }.link();
            next = NonNull::new(link.load(Ordering::Relaxed));
            link.store(behind, Ordering::Relaxed);
            behind = record.as_ptr();
        }
        Self(NonNull::new(behind.cast()))
    }
}

impl Iterator for Chain {
    type Item = RecordRef;

    #[inline]
    fn next(&mut self) -> Option<RecordRef> {
        // SAFETY: by the invariant a reference is owned by the first place, of which the pointer
        // is. It leaves the chain below.
        let record = unsafe { RecordRef::from_raw(self.0?) };
        self.0 = NonNull::new(record.link().load(Ordering::Relaxed).cast());
        Some(record)
    }
}

impl Drop for Chain {
    #[inline]
    fn drop(&mut self) {
        self.for_each(drop);
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

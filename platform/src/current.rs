//! The current process: the contract between channels and executors.
//!
//! Whoever runs processes sets a thread-local *current process* around each poll. Whoever makes processes wait (channels, barriers,
//! timers) reads it: to order waiting lists by priority, and to ready a process without cloning its waker. On a thread that runs no
//! process of LUNA (a plain thread, tokio, smol) it is absent: priority is then the lowest, and wakers do the waking.

use crate::sync::Arc;
use crate::timer_queue::TimerQueue;
use std::cell::{Cell, RefCell, UnsafeCell};
use std::fmt;
use std::num::NonZeroU32;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use std::task::{Context, Waker};

/// The number of priority levels within one executor: 0 (lowest) to 31.
pub const LEVELS: u8 = 32;

/// How many operations one poll may complete without waiting before the process lets others run.
///
/// A process whose operations always find a partner would else keep its executor from its timers and from wakes from elsewhere.
pub const OPERATIONS_PER_POLL: u32 = 64;

/// A process' number, unique within this program's run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessId(NonZeroU32);

impl ProcessId {
    /// A number not given out before. Wraps after four thousand million processes.
    #[expect(clippy::new_without_default, reason = "each call gives another value")]
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(1);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self(NonZeroU32::new(number).unwrap_or(NonZeroU32::MIN))
    }

    /// The number itself.
    pub fn get(self) -> u32 {
        self.0.get()
    }
}

impl fmt::Display for ProcessId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// One thread that runs processes: an executor's, or that of an OS-thread process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Home(NonZeroU32);

impl Home {
    /// A home not given out before.
    #[expect(clippy::new_without_default, reason = "each call gives another value")]
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(1);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self(NonZeroU32::new(number).unwrap_or(NonZeroU32::MIN))
    }
}

/// How urgent a process is: the priority of its OS thread first, then its level on the executor. Greater is more urgent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Priority {
    /// 0 for threads without a real-time policy, else their SCHED_FIFO or SCHED_RR priority.
    pub thread: u8,
    /// The level within the executor, 0 to 31.
    pub level: u8,
}

/// What the framework knows of a process that runs or waits. It lies at one address for the process' whole life.
///
/// # Invariants
///
/// `waker` and `owner` are written before the process is polled for the first time and the waker after it has ended; in between they are
/// only read. `ready_here` can be called on the home's thread as long as the process lives.
pub struct Process {
    id: ProcessId,
    home: Home,
    thread_priority: u8,
    level: AtomicU8,
    waker: UnsafeCell<Option<Waker>>,
    /// What to call `ready_here` with.
    owner: Cell<*const ()>,
    ready_here: unsafe fn(*const (), Place),
}

/// Where in the queue of its level a process is put.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Before the others: it only let more urgent ones run.
    First,
    /// Behind the others.
    Last,
}

// SAFETY: by the invariant `waker` and `owner` do not change while others can see them; all else is atomic or constant.
unsafe impl Sync for Process {}

impl fmt::Debug for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Process").field("id", &self.id).field("priority", &self.priority()).finish_non_exhaustive()
    }
}

impl Process {
    /// A process of `home`, whose thread has the real-time priority `thread_priority` (0: none), at `level`.
    ///
    /// # Safety
    ///
    /// `ready_here` may be called, on the home's thread and until the process has ended, with the owner that
    /// [`set_waker`](Self::set_waker) is given.
    pub unsafe fn new(
        id: ProcessId,
        home: Home,
        thread_priority: u8,
        level: u8,
        ready_here: unsafe fn(*const (), Place),
    ) -> Self {
        Self {
            owner: Cell::new(std::ptr::null()),
            ready_here,
            id,
            home,
            thread_priority,
            level: AtomicU8::new(level),
            waker: UnsafeCell::new(None),
        }
    }

    /// Sets the waker that readies this process from anywhere, and what readies it on its home's thread.
    ///
    /// # Safety
    ///
    /// The process has not been polled yet, and nobody uses this value at the same time.
    pub unsafe fn set_waker(&self, waker: Waker, owner: *const ()) {
        self.owner.set(owner);
        // SAFETY: the contract makes this the only access.
        unsafe { *self.waker.get() = Some(waker) };
    }

    /// Takes the waker out, which breaks the circle of a process that holds a reference to itself.
    ///
    /// # Safety
    ///
    /// The process has ended: nobody uses this value at the same time, or calls anything of it afterwards.
    pub unsafe fn take_waker(&self) -> Option<Waker> {
        // SAFETY: the contract makes this the only access.
        unsafe { (*self.waker.get()).take() }
    }

    /// The waker that readies this process from anywhere.
    #[inline]
    pub fn waker(&self) -> Option<&Waker> {
        // SAFETY: by the type's invariant it does not change between the first poll and the end, and before and after nobody asks.
        unsafe { (*self.waker.get()).as_ref() }
    }

    /// Readies the process without its waker.
    ///
    /// # Safety
    ///
    /// The process has not ended, and this is its home's thread.
    #[inline]
    unsafe fn ready_here(&self, place: Place) {
        // SAFETY: the contract is that of `new`.
        unsafe { (self.ready_here)(self.owner.get(), place) };
    }

    /// The process' number.
    pub fn id(&self) -> ProcessId {
        self.id
    }

    /// The level that the process runs at.
    #[inline]
    pub fn level(&self) -> u8 {
        self.level.load(Ordering::Relaxed)
    }

    /// How urgent the process is.
    #[inline]
    pub fn priority(&self) -> Priority {
        Priority { thread: self.thread_priority, level: self.level() }
    }
}

/// What a thread that runs processes keeps beside the current one.
struct Thread {
    process: Cell<Option<NonNull<Process>>>,
    home: Cell<Option<Home>>,
    ready_levels: Cell<u32>,
    operations_left: Cell<u32>,
    branch_failed: Cell<bool>,
    may_block: Cell<bool>,
    on_path: Cell<bool>,
}

thread_local! {
    static THREAD: Thread = const {
        Thread {
            process: Cell::new(None),
            home: Cell::new(None),
            ready_levels: Cell::new(0),
            operations_left: Cell::new(0),
            branch_failed: Cell::new(false),
            may_block: Cell::new(true),
            on_path: Cell::new(false),
        }
    };
    static TIMERS: RefCell<Option<Arc<TimerQueue>>> = const { RefCell::new(None) };
}

/// Marks this thread as `home` with its `timers` until the guard is dropped. `may_block`: its processes may make blocking calls,
/// since it runs one alone.
///
/// # Panics
///
/// If the thread is a home already: a process must not run a system or an executor inside itself, since that would block its own.
/// Ask [`home`] first where the outside decides.
pub fn enter_home(home: Home, timers: Arc<TimerQueue>, may_block: bool) -> HomeGuard {
    assert!(self::home().is_none(), "this thread runs processes already");
    THREAD.with(|thread| {
        thread.home.set(Some(home));
        thread.may_block.set(may_block);
    });
    TIMERS.with(|slot| *slot.borrow_mut() = Some(timers));
    HomeGuard { _private: () }
}

/// Ends what [`enter_home`] began.
#[derive(Debug)]
#[must_use = "the thread stops being a home when the guard is dropped"]
pub struct HomeGuard {
    _private: (),
}

impl Drop for HomeGuard {
    fn drop(&mut self) {
        THREAD.with(|thread| {
            thread.home.set(None);
            thread.may_block.set(true);
            thread.ready_levels.set(0);
            thread.on_path.set(false);
        });
        TIMERS.with(|slot| slot.borrow_mut().take());
    }
}

/// The home that this thread is, if it runs processes.
#[inline]
pub fn home() -> Option<Home> {
    THREAD.with(|thread| thread.home.get())
}

/// Whether a blocking call on this thread holds up nobody else: not on an executor's thread.
pub fn may_block() -> bool {
    THREAD.with(|thread| thread.may_block.get())
}

/// The timers of this thread, if it runs processes.
pub fn timers() -> Option<Arc<TimerQueue>> {
    TIMERS.with(|slot| slot.borrow().clone())
}

/// Runs `poll` with `process` as the current one.
#[inline]
pub fn with_process<R>(process: &Process, poll: impl FnOnce() -> R) -> R {
    struct Restore {
        process: Option<NonNull<Process>>,
        branch_failed: bool,
    }
    impl Drop for Restore {
        #[inline]
        fn drop(&mut self) {
            THREAD.with(|thread| {
                thread.process.set(self.process);
                thread.branch_failed.set(self.branch_failed);
            });
        }
    }
    let _restore = THREAD.with(|thread| {
        thread.operations_left.set(OPERATIONS_PER_POLL);
        Restore {
            process: thread.process.replace(Some(NonNull::from(process))),
            branch_failed: thread.branch_failed.replace(false),
        }
    });
    poll()
}

/// Calls `f` with the current process, if there is one.
#[inline]
pub fn process<R>(f: impl FnOnce(Option<&Process>) -> R) -> R {
    // SAFETY: `with_process` sets the pointer from a reference that lives until it restores the one before, and the closure
    // cannot keep what it is lent.
    THREAD.with(|thread| f(thread.process.get().map(|process| unsafe { process.as_ref() })))
}

/// How urgent the current process is; the lowest priority where there is none.
#[inline]
pub fn priority() -> Priority {
    process(|process| process.map(Process::priority).unwrap_or_default())
}

/// The levels at which this thread's executor has a ready process, one bit each. Written by its run queue.
#[inline]
pub fn ready_levels() -> u32 {
    THREAD.with(|thread| thread.ready_levels.get())
}

/// Says at which levels this thread's executor has a ready process.
#[inline]
pub fn set_ready_levels(bits: u32) {
    THREAD.with(|thread| thread.ready_levels.set(bits));
}

/// Whether a process of higher level than the current one is ready on its executor: then a completed communication lets it run.
#[inline]
pub fn is_outranked() -> bool {
    THREAD.with(|thread| {
        thread.process.get().is_some_and(|process| {
            // SAFETY: as in `process`.
            let level = unsafe { process.as_ref() }.level();
            // Two shifts, since a shift by 32 is none.
            (thread.ready_levels.get() >> level) >> 1 != 0
        })
    })
}

/// Readies the current process again, at `place` among those of its level; more urgent ones run before it in any case. The caller
/// returns `Pending`. Where no process of LUNA runs, or a combinator within it polls, the waker is woken.
#[inline]
pub fn ready_again(cx: &Context<'_>, place: Place) {
    match &Wakeup::of(cx).0 {
        // SAFETY: it is the current process, so it lives, and this is its home's thread.
        Inner::Process(process) => unsafe { process.as_ref().ready_here(place) },
        Inner::Waker(waker) => waker.wake_by_ref(),
    }
}

/// Counts an operation that completed without waiting; `false` when this poll has used up [`OPERATIONS_PER_POLL`].
///
/// Always `true` where no process of LUNA runs: other runtimes have means of their own.
#[inline]
pub fn count_operation() -> bool {
    THREAD.with(|thread| {
        if thread.process.get().is_none() {
            return true;
        }
        let left = thread.operations_left.get();
        thread.operations_left.set(left.saturating_sub(1));
        left != 0
    })
}

/// Whether a sibling of the branch that is being polled has failed, so that its operations fail as poisoned.
#[inline]
pub fn branch_failed() -> bool {
    THREAD.with(|thread| thread.branch_failed.get())
}

/// Polls a branch of a parallel construct, telling it whether a sibling `failed`. Failure reaches nested constructs too.
#[inline]
pub fn with_branch<R>(failed: bool, poll: impl FnOnce() -> R) -> R {
    struct Restore(bool);
    impl Drop for Restore {
        #[inline]
        fn drop(&mut self) {
            THREAD.with(|thread| thread.branch_failed.set(self.0));
        }
    }
    let _restore = THREAD.with(|thread| {
        let before = thread.branch_failed.get();
        thread.branch_failed.set(before || failed);
        Restore(before)
    });
    poll()
}

/// Whether this thread is on the real-time path: it runs the bodies of processes, or schedules them.
#[inline]
pub fn on_path() -> bool {
    // An allocator asks this too, also while the thread's locals are being torn down.
    THREAD.try_with(|thread| thread.on_path.get()).unwrap_or(false)
}

/// Says whether this thread is on the real-time path from now on; gives what was said before.
pub fn set_on_path(on_path: bool) -> bool {
    THREAD.with(|thread| thread.on_path.replace(on_path))
}

/// How a waiting operation is woken: stored in its node, under the lock of what it waits for.
///
/// # Invariants
///
/// A `Process` pointer was taken from the current process while the operation was polled by it. The operation lies in that
/// process' future, so the process lives at least as long as the node is linked.
#[derive(Debug)]
pub struct Wakeup(Inner);

#[derive(Debug)]
enum Inner {
    Process(NonNull<Process>),
    Waker(Waker),
}

// SAFETY: what is behind the pointer is `Sync`; the pointer is followed only in `take`, whose contract says when.
unsafe impl Send for Wakeup {}
// SAFETY: as above.
unsafe impl Sync for Wakeup {}

impl Wakeup {
    /// How to wake who polls with `cx`: without its waker if that is the current process itself, and not a combinator
    /// with wakers of its own within it.
    #[inline]
    pub fn of(cx: &Context<'_>) -> Wakeup {
        process(|process| match process {
            Some(process) if process.waker().is_some_and(|waker| waker.will_wake(cx.waker())) => {
                Wakeup(Inner::Process(NonNull::from(process)))
            }
            _ => Wakeup(Inner::Waker(cx.waker().clone())),
        })
    }

    /// Whether it wakes the same as `cx` would.
    #[inline]
    pub fn is_of(&self, cx: &Context<'_>) -> bool {
        match &self.0 {
            Inner::Waker(waker) => waker.will_wake(cx.waker()),
            Inner::Process(pointer) => process(|process| {
                process.is_some_and(|process| {
                    NonNull::from(process) == *pointer
                        && process.waker().is_some_and(|waker| waker.will_wake(cx.waker()))
                })
            }),
        }
    }

    /// Makes ready to wake after the lock is released.
    ///
    /// A process of this thread needs nothing more; of one elsewhere a reference is taken, since as soon as its outcome can be
    /// seen it may go on, end, and be freed.
    ///
    /// # Safety
    ///
    /// The operation that made this is still pending (its node was linked until now, under the lock that is still held), and the
    /// result is used or dropped before this thread polls another process.
    #[inline]
    pub unsafe fn take(self) -> Ready {
        match self.0 {
            Inner::Waker(waker) => Ready(Readying::Elsewhere(waker)),
            Inner::Process(pointer) => {
                // SAFETY: the operation is pending, so by the type's invariant the process lives.
                let process = unsafe { pointer.as_ref() };
                if home() == Some(process.home) {
                    Ready(Readying::Here(pointer))
                } else {
                    match process.waker() {
                        Some(waker) => Ready(Readying::Elsewhere(waker.clone())),
                        None => Ready(Readying::Nobody),
                    }
                }
            }
        }
    }
}

/// A wake that is due. Carry it out with [`wake`](Self::wake) after releasing locks.
#[derive(Debug)]
#[must_use = "the process stays asleep until `wake` is called"]
pub struct Ready(Readying);

#[derive(Debug)]
enum Readying {
    Here(NonNull<Process>),
    Elsewhere(Waker),
    Nobody,
}

impl Ready {
    /// Nobody to wake.
    pub const NOBODY: Ready = Ready(Readying::Nobody);

    /// Readies the process. O(1); a system call only if it is elsewhere and its thread sleeps.
    #[inline]
    pub fn wake(self) {
        match self.0 {
            // SAFETY: `take` saw the process alive on this thread, its home's, and nothing has been polled here since.
            Readying::Here(process) => unsafe { process.as_ref().ready_here(Place::Last) },
            Readying::Elsewhere(waker) => waker.wake(),
            Readying::Nobody => {}
        }
    }
}

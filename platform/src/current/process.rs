//! What the framework knows of a process.

use super::inheritance::Inheritance;
use super::lone;
use super::references::References;
use std::cell::UnsafeCell;
use std::fmt;
use std::num::{NonZeroU32, NonZeroU64};
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::task::Waker;

/// The number of priority levels within one executor: 0 (lowest) to 31.
pub const LEVELS: u8 = 32;

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

    /// The process of this number; none is 0.
    pub fn from_number(number: u32) -> Option<Self> {
        NonZeroU32::new(number).map(Self)
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

/// Who uses a channel, or waits for something.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum User {
    /// A thread that runs no process of LUNA: a plain one, or another runtime's.
    Outside,
    /// This process.
    Process(ProcessId),
}

/// One thread that runs processes: an executor's, or that of an OS-thread process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Home(NonZeroU64);

impl Home {
    /// A home not given out before.
    #[expect(clippy::new_without_default, reason = "each call gives another value")]
    pub fn new() -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(1);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        // 64 bits do not wrap, and homes must differ: what is counted without atomics relies on it.
        Self(NonZeroU64::new(number).unwrap_or(NonZeroU64::MIN))
    }
}

/// How urgent a process is: the priority of its OS thread first, then its level on the executor. Greater is more urgent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Priority {
    /// 0 for threads without a real-time policy, else their SCHED_FIFO or SCHED_RR priority; 100 under SCHED_DEADLINE.
    pub thread: u8,
    /// The level within the executor, 0 to 31.
    pub level: u8,
}

/// Where in the queue of its level a process is put.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Before the others: it only let more urgent ones run.
    First,
    /// Behind the others.
    Last,
}

/// What an executor does for its processes. All are given the owner that the process was made with.
#[derive(Debug)]
pub struct Methods {
    /// Readies the process without its waker, on its home's thread, at this level. If it is ready at a lower one, it is moved up, also
    /// when the place is the last. It may have ended: then this does nothing.
    pub ready_here: unsafe fn(NonNull<()>, u8, Place),
    /// Readies the process without its waker, at this level, on any other thread. It must not rely on another wake to go on.
    pub ready_elsewhere: unsafe fn(NonNull<()>, u8),
    /// Frees the owner, on any thread: the process has ended, and nobody refers to it any more.
    pub free: unsafe fn(NonNull<()>),
}

/// What the framework knows of a process that runs or waits. It lies at one address for the process' whole life.
///
/// # Invariants
///
/// `waker` is written before the process is polled for the first time and when it is freed; in between it is only read. `owner` with
/// its methods is there for the processes of executors; it stays valid until `free` was called.
#[repr(align(64))]
pub struct Process {
    id: ProcessId,
    home: Home,
    thread_priority: u8,
    own_level: u8,
    waker: UnsafeCell<Option<Waker>>,
    owner: UnsafeCell<Option<(NonNull<()>, &'static Methods)>>,
    pub(super) references: References,
    inheritance: Inheritance,
}

// SAFETY: by the invariant `waker` and `owner` do not change while others can see them; `references` says itself who may do what.
unsafe impl Sync for Process {}
// SAFETY: as above; a pointer may go anywhere.
unsafe impl Send for Process {}

impl Process {
    /// A process of `home`, whose thread has the real-time priority `thread_priority` (0: none), at `level`.
    pub fn new(id: ProcessId, home: Home, thread_priority: u8, level: u8) -> Self {
        Self {
            id,
            home,
            thread_priority,
            own_level: level,
            waker: UnsafeCell::new(None),
            owner: UnsafeCell::new(None),
            references: References::new(),
            inheritance: Inheritance::new(level, super::home_thread_of(home)),
        }
    }

    /// Sets the waker that readies this process from anywhere.
    ///
    /// # Safety
    ///
    /// The process has not been polled yet, and nobody uses this value at the same time.
    pub unsafe fn set_waker(&self, waker: Waker) {
        // SAFETY: the contract makes this the only access.
        unsafe { *self.waker.get() = Some(waker) };
    }

    /// Says how to ready this process without its waker, and how to free it: for processes that share their thread.
    ///
    /// # Safety
    ///
    /// As for [`set_waker`](Self::set_waker). The methods may be called with `owner` as [`Methods`] says, until `free` was called;
    /// until then this value stays where it is. [`end`](Self::end) is called once.
    pub unsafe fn set_owner(&self, owner: NonNull<()>, methods: &'static Methods) {
        // SAFETY: the contract makes this the only access.
        unsafe { *self.owner.get() = Some((owner, methods)) };
    }

    /// Takes the waker out, which breaks the circle of a process that holds a reference to itself.
    ///
    /// # Safety
    ///
    /// Called by the owner's `free`: nobody uses this value at the same time, or calls anything of it afterwards.
    pub unsafe fn take_waker(&self) -> Option<Waker> {
        // SAFETY: the contract makes this the only access.
        unsafe { (*self.waker.get()).take() }
    }

    /// Says that the process has ended. Its owner is freed as soon as nobody refers to it: here, or where the last wakeup goes.
    ///
    /// # Safety
    ///
    /// This is the home's thread; the process is not polled again, and this is the only call. The value may be gone afterwards.
    pub unsafe fn end(this: NonNull<Process>) {
        // SAFETY: the contract: the value lives until it is freed below, if at all.
        unsafe {
            if this.as_ref().references.end() {
                Self::free(this);
            }
        }
    }

    /// # Safety
    ///
    /// The references said that nobody refers to the process any more.
    pub(super) unsafe fn free(this: NonNull<Process>) {
        // SAFETY: the contract, and that of `set_owner`.
        unsafe {
            if let Some((owner, methods)) = *this.as_ref().owner.get() {
                (methods.free)(owner);
            }
        }
    }

    /// The waker that readies this process from anywhere.
    #[inline]
    pub fn waker(&self) -> Option<&Waker> {
        // SAFETY: by the type's invariant it does not change between the first poll and the freeing, and before and after nobody asks.
        unsafe { (*self.waker.get()).as_ref() }
    }

    /// Whether it can be readied without its waker.
    #[inline]
    pub(super) fn is_owned(&self) -> bool {
        // SAFETY: by the type's invariant it does not change once the process is polled.
        unsafe { *self.owner.get() }.is_some_and(|(_, methods)| !ptr::eq(methods, &lone::METHODS))
    }

    /// Whether references to it are counted, and keep its memory.
    #[inline]
    pub(super) fn is_counted(&self) -> bool {
        // SAFETY: as above.
        unsafe { *self.owner.get() }.is_some()
    }

    pub(super) fn inheritance(&self) -> &Inheritance {
        &self.inheritance
    }

    /// Readies the process without its waker, if it can be, that many levels below its own.
    ///
    /// # Safety
    ///
    /// This is the home's thread.
    #[inline]
    pub(super) unsafe fn ready_here(&self, lowered: u8, place: Place) {
        // SAFETY: the contract, and that of `set_owner`.
        unsafe {
            if let Some((owner, methods)) = *self.owner.get() {
                (methods.ready_here)(owner, self.lowered_priority(lowered).level, place);
            }
        }
    }

    /// Readies the process without its waker, if it can be, that many levels below its own.
    ///
    /// # Safety
    ///
    /// The process is referred to by counting, and this is not its home's thread.
    #[inline]
    pub(super) unsafe fn ready_elsewhere(&self, lowered: u8) {
        // SAFETY: the contract, and that of `set_owner`.
        unsafe {
            if let Some((owner, methods)) = *self.owner.get() {
                (methods.ready_elsewhere)(owner, self.lowered_priority(lowered).level);
            }
        }
    }

    /// The process' number.
    pub fn id(&self) -> ProcessId {
        self.id
    }

    /// Where the process runs.
    #[inline]
    pub fn home(&self) -> Home {
        self.home
    }

    /// The level that the process runs at: its own, or a higher one that it [inherits](super::Heir).
    #[inline]
    pub fn level(&self) -> u8 {
        self.inheritance.level()
    }

    /// How urgent the process is while it inherits nothing.
    #[inline]
    pub(super) fn own_priority(&self) -> Priority {
        Priority {
            thread: self.thread_priority,
            level: self.own_level,
        }
    }

    /// How urgent the process is. One that inherits from a thread of higher priority counts as of the highest level there.
    #[inline]
    pub fn priority(&self) -> Priority {
        self.lowered_priority(0)
    }

    /// How urgent a branch of the process is that runs that many levels below it.
    #[inline]
    pub(super) fn lowered_priority(&self, lowered: u8) -> Priority {
        Priority {
            thread: self.inheritance.thread(self.thread_priority),
            level: self.level().saturating_sub(lowered),
        }
    }
}

impl fmt::Debug for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Process")
            .field("id", &self.id)
            .field("priority", &self.priority())
            .finish_non_exhaustive()
    }
}

//! The process control block.

mod identity;
mod turn;

pub use identity::{ExecutorId, Priority, ProcessId, QueueEnd, User};
pub(super) use turn::state;
pub use turn::{AfterTurn, fail_current};

use crate::current::inheritance::{Inheritance, LevelNow};
use crate::current::inheritor::Boost;
use crate::current::lone;
use crate::current::references::References;
use crate::current::run_queue::Link;
use crate::events;
use core::any::Any;
use core::cell::{Cell, UnsafeCell};
use core::ops::Range;
use core::ptr::{self, NonNull};
use core::task::{Context, Waker};
use luna_platform::sync::plain::{AtomicPtr, AtomicU8, AtomicU64, Ordering};

/// The number of priority levels within one executor: 0 (lowest) to 31.
pub const LEVELS: u8 = 32;

/// An executor's operations on its processes. All take the owner that the process was made with.
#[derive(Debug)]
pub struct Methods {
    /// Readies the process without its waker, at this level, on a thread other than its executor's.
    /// It must not rely on another wake to go on.
    pub ready_elsewhere: unsafe fn(NonNull<()>, u8),
    /// Frees the owner, on any thread: the process has ended, and there is no reference to it any
    /// more.
    pub free: unsafe fn(NonNull<()>),
    /// Polls the body of a process that was taken from the run queue, in its turn, and marks the
    /// process if its body has ended ([`Process::set_ended`]).
    pub poll: Poll,
    /// As `poll`, for a process with [notices](Process::notices): its executor looks at them.
    pub poll_attentively: Poll,
    /// The addresses of the body and its captures. The owner is live; its body may have ended.
    pub body: unsafe fn(NonNull<()>) -> Range<usize>,
    /// Rare operations of an executor on processes of this kind; the executor knows the type.
    pub seldom: Option<&'static (dyn Any + Send + Sync)>,
}

/// Polls a process in its turn: see [`Methods::poll`].
pub type Poll = unsafe fn(NonNull<()>, &mut Context<'_>);

/// What a process is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ProcessState {
    /// Made, and not started yet.
    Created,
    /// Able to run, and waiting for its executor.
    Ready,
    /// Running.
    Running,
    /// Waiting for a communication, a deadline, or another event.
    Waiting,
    /// Ended, in any way.
    Ended,
}

/// How a process is woken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// By its waker alone; there are no references to it.
    Bare,
    /// By its waker alone; references to it are counted and keep its memory ([`lone`]).
    Lone,
    /// It shares its thread with others, and is queued in the run queue there.
    Owned,
    /// As `Owned`, and its [events](crate::events) are traced. It uses separate functions, so
    /// that the common ones need no test.
    Traced,
}

/// The control block of a process. It stays at one address for the process' whole life.
///
/// # Invariants
///
/// `waker` is written before the first poll, and taken out when the process has ended and there is
/// no reference to it; in between it is only read. `methods` and `kind` are set for processes of
/// executors and for those that are alone, before another thread knows the process. Their owner
/// lies where the process lies, at a multiple of [`ALIGN`](Process::ALIGN); its address is exposed,
/// and it stays valid until `free` was called. `link` and `state` are written by the executor's
/// thread alone. While the link is in the run queue, the state has `QUEUED`. A process that was
/// popped keeps this bit until its turn begins or it ends.
///
/// The fields of each turn and each wake come first: 96 bytes at most, which lie on two cache lines
/// wherever [`ALIGN`](Process::ALIGN) puts them.
#[repr(C)]
pub struct Process {
    /// First, so that a pointer to it is one to the process.
    link: Link,
    state: AtomicU8,
    /// Bits that its executor is to look at before the next poll; their meaning is the executor's.
    notices: AtomicU8,
    kind: Cell<Kind>,
    thread_priority: u8,
    own_level: u8,
    level: LevelNow,
    id: ProcessId,
    executor_id: ExecutorId,
    pub(super) references: References,
    waker: UnsafeCell<Option<Waker>>,
    polls: AtomicU64,
    /// [`Methods::poll`], or with notices `poll_attentively`: so a turn need not look at them. Null
    /// without an owner.
    poll: AtomicPtr<()>,
    methods: Cell<Option<&'static Methods>>,
    inheritance: Inheritance,
}

#[cfg(all(not(loom), target_pointer_width = "64"))]
const _: () = assert!(core::mem::offset_of!(Process, methods) <= 96);

// SAFETY: the fields that are neither constant nor atomic:
// - `kind`, `methods`: the thread that makes the process writes them, before any other thread knows
//   the process. Other threads only read them.
// - `waker`: by the invariant it is written before the first poll, and taken out after the end,
//   when there is no reference any more. In between it is only read.
// - `link`: the executor's thread alone reads and writes it.
// - `references`: the executor's thread alone accesses its `Cell`; the other count is atomic.
// - `inheritance`: `counts` and `waits` are accessed under the lock of its `thread` alone.
unsafe impl Sync for Process {}
// SAFETY: the rules above say which thread accesses a field at what time, and none depends on the
// thread that has the value. Its drop accesses neither the `link` nor the counts of `references`.
unsafe impl Send for Process {}

impl Process {
    /// Alignment of a process that is counted by references. A reference keeps the levels of a
    /// branch in the address bits below.
    pub const ALIGN: usize = LEVELS as usize;

    /// A process of the executor `executor_id`, the thread of which has the real-time priority
    /// `thread_priority` (0: none), at `level`.
    #[inline(always)]
    pub fn new(id: ProcessId, executor_id: ExecutorId, thread_priority: u8, level: u8) -> Self {
        Self {
            link: Link::new(),
            state: AtomicU8::new(state::NEW),
            notices: AtomicU8::new(0),
            kind: Cell::new(Kind::Bare),
            thread_priority,
            own_level: level,
            level: LevelNow::new(level),
            id,
            executor_id,
            references: References::new(),
            waker: UnsafeCell::new(None),
            polls: AtomicU64::new(0),
            poll: AtomicPtr::new(ptr::null_mut()),
            methods: Cell::new(None),
            inheritance: Inheritance::new(),
        }
    }

    /// Sets the waker that readies this process from any thread.
    ///
    /// # Safety
    ///
    /// The process has not been polled yet, and no other code uses this value at the same time.
    #[inline]
    pub unsafe fn set_waker(&self, waker: Waker) {
        // SAFETY: the caller promises that no other code uses this value, so this is the only
        // access.
        unsafe { *self.waker.get() = Some(waker) };
    }

    /// Sets the owner and its operations, before the first notice. For a process that shares its
    /// thread, which is readied without its waker, and for one that is [alone](super::Lone) on it,
    /// which its waker readies.
    ///
    /// # Safety
    ///
    /// As for [`set_waker`](Self::set_waker). `owner` lies where this value lies, as its first
    /// part, at a multiple of [`ALIGN`](Self::ALIGN). The methods may be called with `owner` as
    /// [`Methods`] says, until `free` was called; until then this value stays where it is.
    /// [`end`](Self::end) is called once.
    #[inline]
    pub unsafe fn set_owner(&self, owner: NonNull<()>, methods: &'static Methods) {
        let is_lone = ptr::eq(methods, &lone::METHODS);
        self.kind
            .set(if is_lone { Kind::Lone } else { Kind::Owned });
        debug_assert_eq!(owner.addr().get(), ptr::from_ref(self).addr());
        debug_assert_eq!(owner.addr().get() % Self::ALIGN, 0);
        // Exposed: the owner is recovered from the process' own address.
        owner.expose_provenance();
        self.methods.set(Some(methods));
        self.poll.store(methods.poll as *mut (), Ordering::Relaxed);
    }

    /// How the process is polled in its turn.
    ///
    /// # Safety
    ///
    /// [`set_owner`](Self::set_owner) was called.
    #[inline(always)]
    pub unsafe fn poll(&self) -> Poll {
        // Acquire: pairs with the store of a notice.
        let poll = self.poll.load(Ordering::Acquire);
        // SAFETY: `set_owner`, which the caller promises, and `notify` store functions of this
        // type.
        unsafe { core::mem::transmute::<*mut (), Poll>(poll) }
    }

    /// The operations of its executor.
    ///
    /// # Safety
    ///
    /// [`set_owner`](Self::set_owner) was called.
    #[inline(always)]
    pub unsafe fn methods(&self) -> &'static Methods {
        // SAFETY: the caller promises that `set_owner` was called, which set the methods.
        unsafe { self.methods.get().unwrap_unchecked() }
    }

    /// Traces the events of this process, if those of its thread are traced. Each turn needs
    /// [`keep_traced`](Self::keep_traced) again.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, which has an owner for it ([`set_owner`](Self::set_owner))
    /// and has not readied it yet.
    pub unsafe fn set_traced(&self) {
        debug_assert!(self.is_owned());
        self.kind.set(Kind::Traced);
        // SAFETY: the caller promises that this is the executor's thread.
        unsafe { self.keep_traced() };
    }

    /// Marks a process as [traced](Self::set_traced) at the beginning of a turn: the store that
    /// begins a turn clears the mark.
    ///
    /// # Safety
    ///
    /// This is the executor's thread. On another thread this could lose a concurrent change of the
    /// state, and the process would be queued twice.
    #[inline]
    pub unsafe fn keep_traced(&self) {
        let now = self.state.load(Ordering::Relaxed);
        self.state.store(now | state::TRACED, Ordering::Relaxed);
        super::THREAD.with(|thread| {
            if thread.process.get() == Some(NonNull::from(self)) {
                thread.plain.set(ptr::null());
            }
        });
    }

    /// Takes the waker out, which breaks the cycle of a process that holds a reference to itself.
    ///
    /// # Safety
    ///
    /// The process has ended and there is no reference to it; no other code reads the waker at the
    /// same time or afterwards.
    pub unsafe fn take_waker(&self) -> Option<Waker> {
        // SAFETY: the caller promises that no other code reads the waker, so this is the only
        // access.
        unsafe { (*self.waker.get()).take() }
    }

    /// Marks the process as ended. Its owner is freed when there is no reference to it: here, or
    /// when the last wake handle is dropped.
    ///
    /// # Safety
    ///
    /// This is the executor's thread; the process is not polled again, and this is the only call.
    /// The value may be freed afterwards.
    pub unsafe fn end(this: NonNull<Process>) {
        // SAFETY: the value lives until it is freed below, if at all; the caller promises that this
        // is the only call.
        unsafe {
            this.as_ref().state.store(state::ENDED, Ordering::Relaxed);
            if this.as_ref().references.end() {
                Self::free(this);
            }
        }
    }

    /// Whether there is no reference to a process that is not polled any more: then there will be
    /// none, and its owner may be freed without [`end`](Self::end).
    ///
    /// # Safety
    ///
    /// This is the executor's thread, and `end` was not called.
    pub unsafe fn is_unreferenced(&self) -> bool {
        self.references.are_none()
    }

    /// # Safety
    ///
    /// The reference count says that there is no reference to the process any more.
    pub(super) unsafe fn free(this: NonNull<Process>) {
        // SAFETY: the caller promises that there is no reference any more, which is so once. So the
        // owner is live until `free` is called here, as the caller of `set_owner` has allowed.
        unsafe {
            let this = this.as_ref();
            if let Some(methods) = this.methods.get() {
                (methods.free)(this.owner());
            }
        }
    }

    /// The waker that readies this process from any thread.
    #[inline]
    pub fn waker(&self) -> Option<&Waker> {
        // SAFETY: by the type's invariant it does not change between the first poll and its being
        // taken out, and it is not read before or after.
        unsafe { (*self.waker.get()).as_ref() }
    }

    /// Where its waker lies: an executor polls it with that one.
    #[inline(always)]
    pub(super) fn waker_address(&self) -> *const Waker {
        self.waker.get().cast_const().cast()
    }

    /// As [`waker_address`](Self::waker_address), if its turns are plain ones: it can be readied
    /// without its waker, and its events are not traced.
    #[inline]
    pub(super) fn waker_of_plain_turns(&self) -> Option<*const Waker> {
        (self.kind.get() == Kind::Owned).then(|| self.waker_address())
    }

    /// The id of its executor. If it has none, it was made with an id that no thread has.
    #[inline]
    pub fn executor_number(&self) -> u64 {
        self.executor_id.number()
    }

    /// Whether `cx` has the process' own waker; its address is almost always the same.
    #[inline]
    pub(super) fn is_polled_with(&self, cx: &Context<'_>) -> bool {
        ptr::eq(self.waker_address(), cx.waker())
            || self
                .waker()
                .is_some_and(|waker| waker.will_wake(cx.waker()))
    }

    /// Whether it can be readied without its waker.
    #[inline]
    pub(super) fn is_owned(&self) -> bool {
        matches!(self.kind.get(), Kind::Owned | Kind::Traced)
    }

    /// Whether references to it are counted, and keep its memory.
    #[inline]
    pub(super) fn is_counted(&self) -> bool {
        self.kind.get() != Kind::Bare
    }

    pub(super) fn inheritance(&self) -> &Inheritance {
        &self.inheritance
    }

    /// Counts one boost `boost` more or less. `false`: the count would overflow, and nothing has
    /// changed.
    ///
    /// # Safety
    ///
    /// The lock of the executor's boosts is held.
    pub(super) unsafe fn count_boost(&self, boost: Boost, more: bool) -> bool {
        let before = events::is_on().then(|| self.level.get());
        // SAFETY: the caller holds the lock of the executor's boosts, which guards the counts.
        let is_counted = unsafe {
            self.inheritance
                .count(&self.level, self.own_level, boost, more)
        };
        if let Some(before) = before
            && self.level.get() != before
        {
            let levels = || [before.into(), self.level.get().into()];
            events::report(events::code::PRIORITY, self.id.get(), levels);
        }
        is_counted
    }

    /// The owner that was set.
    ///
    /// # Safety
    ///
    /// [`set_owner`](Self::set_owner) was called.
    #[inline(always)]
    pub unsafe fn owner(&self) -> NonNull<()> {
        NonNull::with_exposed_provenance(NonNull::from(self).addr())
    }

    /// The number of counted polls.
    pub fn polls(&self) -> u64 {
        self.polls.load(Ordering::Relaxed)
    }

    /// Sets bits that its executor looks at from the next poll on. They are never cleared. From any
    /// thread that holds a reference.
    pub fn notify(&self, bits: u8) {
        // Release, here and below: a reader of the notice sees what was written before it.
        self.notices.fetch_or(bits, Ordering::Release);
        if let Some(methods) = self.methods.get() {
            let poll = methods.poll_attentively as *mut ();
            self.poll.store(poll, Ordering::Release);
        }
    }

    /// The notices. On the executor's thread.
    #[inline]
    pub fn notices(&self) -> u8 {
        self.notices.load(Ordering::Acquire)
    }

    /// The id of the process.
    pub fn id(&self) -> ProcessId {
        self.id
    }

    /// The executor of the process.
    #[inline]
    pub fn executor_id(&self) -> ExecutorId {
        self.executor_id
    }

    /// The level that the process runs at: its own, or a higher one that it
    /// [inherits](super::Inheritor).
    #[inline]
    pub fn level(&self) -> u8 {
        self.level.get()
    }

    /// The priority of the process without a boost.
    #[inline]
    pub(super) fn own_priority(&self) -> Priority {
        Priority {
            thread: self.thread_priority,
            level: self.own_level,
        }
    }

    /// The priority of the process. While it inherits from a thread of higher priority, it counts
    /// as of the highest level there.
    #[inline]
    pub fn priority(&self) -> Priority {
        self.lowered_priority(0)
    }

    /// The priority of a branch that runs `lowered` levels below the process.
    #[inline]
    pub(super) fn lowered_priority(&self, lowered: u8) -> Priority {
        Priority {
            thread: self.level.thread(self.thread_priority, &self.inheritance),
            level: self.level().saturating_sub(lowered),
        }
    }
}

luna_platform::debug_fields!(Process, |process| id: process.id, priority: process.priority());

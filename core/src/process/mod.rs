//! A process: its control block, what others see of it, and its body, in one allocation.
//!
//! ```text
//!              waker or handle, from elsewhere      +--> slot and signal (inbound), then as below
//!             /                                     |
//!   waiting -<--------------------------------------+
//!             \                                     |
//!              waker or handle, on this thread      +--> run queue --> run --> Body::poll
//! ```
//!
//! On the executor's own thread a wake is a flag and a push, without atomics. A process that wakes
//! itself is pushed when its turn is over, but in a branch at once. From another thread a wake is a
//! fixed number of instructions, none of which relies on another waker to continue
//! ([`remote_wakes`](crate::remote_wakes)). A waker that is preempted half-way blocks no other
//! thread.
//!
//! A process is made with what builds its body, on any thread (`spawn`). It is built, polled, and
//! its body dropped, on its executor's thread alone (`run`). It has ended when its body has; from
//! then on it is in no queue. Its memory is freed when no reference to it remains: pending wakes,
//! handles and wakers have one each ([`references`]). Memory that becomes free on the real-time
//! path is freed off it (deferred free), except by a spawn: it frees the memory of the processes
//! that have ended, as it allocates that of the new one.

mod identity;
mod references;
mod turn;

#[cfg(not(loom))]
mod body;
#[cfg(not(loom))]
mod end;
#[cfg(not(loom))]
mod handle;
#[cfg(not(loom))]
mod join;
#[cfg(not(loom))]
mod monitor;
#[cfg(not(loom))]
mod name;
#[cfg(not(loom))]
mod record;
#[cfg(not(loom))]
mod registry;
#[cfg(not(loom))]
mod run;
#[cfg(not(loom))]
mod spawn;
#[cfg(not(loom))]
mod waker;

pub use identity::{ExecutorId, Priority, ProcessId, QueueEnd, User};
pub(crate) use turn::state;
pub use turn::{AfterTurn, fail_current};
#[cfg(not(loom))]
pub use {
    end::ExitValue,
    handle::{Exit, ProcessHandle, ProcessSpec, panic_message},
    join::Join,
    monitor::{PollMonitor, Verdict, poll_monitor},
    name::Name,
    record::Alone,
    registry::{ProcessRegistry, Quiescent},
};
#[cfg(not(loom))]
pub(crate) use {
    monitor::{is_monitored, prepare as prepare_thread},
    record::ProcessRef,
    registry::Enrolled,
    run::{Processes, count, end_all, end_turns, queue_woken, records, run, turns},
    spawn::Unbuilt,
};

use crate::current::inheritance::{Inheritance, LevelNow};
use crate::current::inheritor::Boost;
use crate::current::run_queue::Link;
use crate::events;
#[cfg(not(loom))]
use core::any::TypeId;
use core::cell::{Cell, UnsafeCell};
use core::mem::ManuallyDrop;
#[cfg(not(loom))]
use core::ops::Range;
use core::ptr::{self, NonNull};
use core::task::{Context, Waker};
use luna_platform::sync::plain::{AtomicPtr, AtomicU8, AtomicU64, Ordering};
use references::References;

/// The number of priority levels within one executor: 0 (lowest) to 31.
pub const LEVELS: u8 = 32;

/// What is done with a process according to its kind: its only table of functions. All take the
/// process, by a pointer that may be used for all of its memory.
#[derive(Debug)]
pub struct Methods {
    /// Readies the process without its waker, at this level, on a thread other than its executor's.
    /// It must not rely on another wake to go on. The caller has a reference.
    ready_elsewhere: unsafe fn(NonNull<Process>, u8),
    /// Frees it, on any thread: it has ended, and there is no reference to it any more.
    free: unsafe fn(NonNull<Process>),
    /// Polls the body in the process' turn, on its executor's thread. The body is built, and has
    /// not ended.
    poll: Poll,
    #[cfg(not(loom))]
    of_body: OfBody,
}

/// What is seldom done with a body, according to its type.
#[cfg(not(loom))]
#[derive(Debug)]
struct OfBody {
    /// Builds it, on its executor's thread, once. If that panics, nothing of the builder is left.
    build: unsafe fn(NonNull<Process>),
    /// Drops the builder of one that is not built.
    clear: unsafe fn(NonNull<Process>),
    /// Ends one that has not completed, as `poll` ends one that does.
    abandon: unsafe fn(NonNull<Process>, end::Abandoned),
    /// Where it lies, with its captures, behind the process.
    range: Range<usize>,
    /// The type of its exit value.
    value: fn() -> TypeId,
    /// Moves its exit value out. It has ended, and the caller alone takes it, once.
    take_value: unsafe fn(NonNull<Process>, *mut ()),
}

impl Methods {
    /// Those of a process whose body is polled by other code.
    pub const fn without_body(
        ready_elsewhere: unsafe fn(NonNull<Process>, u8),
        free: unsafe fn(NonNull<Process>),
    ) -> Self {
        Self {
            ready_elsewhere,
            free,
            poll: |_, _| {},
            #[cfg(not(loom))]
            of_body: OfBody {
                build: |_| {},
                clear: |_| {},
                abandon: |_, _| {},
                range: 0..0,
                value: TypeId::of::<()>,
                take_value: |_, _| {},
            },
        }
    }
}

/// Polls a process in its turn.
type Poll = unsafe fn(NonNull<Process>, &mut Context<'_>);

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

/// Causes for an executor to look at a process before it polls it: bits of
/// [`notices`](Process::notices).
pub(crate) struct Notice;

impl Notice {
    /// It is to be ended.
    pub(crate) const CANCELLED: u8 = 1;
    /// Something is done around each of its polls.
    pub(crate) const TIMED: u8 = 2;
    /// The channel ends that go with its body are to poison their channels.
    pub(crate) const POISONED: u8 = 4;
    /// Its turns are traced: see [`events`].
    pub(crate) const TRACED: u8 = 8;
}

/// How a process is woken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// By its waker alone; there are no references to it.
    Bare,
    /// By its waker alone; references to it are counted and keep its memory ([`Alone`]).
    Alone,
    /// It shares its thread with others, and is queued in the run queue there.
    Owned,
    /// As `Owned`, and its [events](crate::events) are traced. It uses separate functions, so
    /// that the common ones need no test.
    Traced,
}

/// A process. It stays at one address for its whole life; its body, if it has one, lies behind it.
///
/// # Invariants
///
/// A process with references lies in memory that its methods free. The address of that memory is
/// exposed, and a pointer to the process that is made from it may be used for all of the memory.
/// `waker` and `methods` are written before another thread knows the process, and before its first
/// poll. `waker` owns nothing: it is valid as long as the process is polled. `kind` is written by
/// the thread that makes the process, and before its first turn by its executor's. `link` is
/// accessed by the executor's thread alone. `state` is written by the executor's thread alone; of a
/// process that is not built by the thread that ends it. While the link is in the run queue, the
/// state has `QUEUED`. A process that was popped keeps this bit until its turn begins. From its end
/// on the state is not written any more.
///
/// The fields of each turn and each wake come first: 96 bytes, on two cache lines.
#[repr(C, align(32))]
pub struct Process {
    /// First, so that a pointer to it is one to the process.
    link: Link,
    state: AtomicU8,
    /// What its executor is to look at before the next poll.
    notices: AtomicU8,
    kind: Cell<Kind>,
    thread_priority: u8,
    own_level: u8,
    level: LevelNow,
    id: ProcessId,
    executor_id: ExecutorId,
    pub(crate) references: References,
    waker: UnsafeCell<ManuallyDrop<Option<Waker>>>,
    polls: AtomicU64,
    /// [`Methods::poll`], or with notices one that looks at them: so a turn need not.
    poll: AtomicPtr<()>,
    methods: Cell<&'static Methods>,
    inheritance: Inheritance,
    #[cfg(not(loom))]
    record: record::Record,
}

#[cfg(all(not(loom), target_pointer_width = "64"))]
const _: () = assert!(core::mem::offset_of!(Process, methods) <= 96);

// SAFETY: the fields that are neither constant nor atomic, by the type's invariants:
// - `kind`, `methods`, `waker` are written before any other thread knows the process, `kind` also
//   by its executor's thread, which alone reads it from then on. Others only read them.
// - `link`: the executor's thread alone reads and writes it.
// - `references`: the executor's thread alone accesses its `Cell`; the other count is atomic.
// - `inheritance`: `counts` and `waits` are accessed under the lock of its `thread` alone.
unsafe impl Sync for Process {}
// SAFETY: the rules above say which thread accesses a field at what time, and none depends on the
// thread that has the value. Its drop accesses neither the `link` nor the counts of `references`.
unsafe impl Send for Process {}

impl Process {
    /// Alignment of a process. A reference keeps the levels of a branch in the address bits below.
    pub const ALIGN: usize = LEVELS as usize;

    /// A process of the executor `executor_id`, the thread of which has the real-time priority
    /// `thread_priority` (0: none), at `level`. It has no body, and there may be no references to
    /// it until its [methods](Self::set_methods) are set.
    #[inline(always)]
    pub fn new(id: ProcessId, executor_id: ExecutorId, thread_priority: u8, level: u8) -> Self {
        Self::with_record(
            id,
            executor_id,
            thread_priority,
            level,
            #[cfg(not(loom))]
            record::Record::named(Name::default()),
        )
    }

    #[inline(always)]
    fn with_record(
        id: ProcessId,
        executor_id: ExecutorId,
        thread_priority: u8,
        level: u8,
        #[cfg(not(loom))] record: record::Record,
    ) -> Self {
        static NONE: Methods = Methods::without_body(|_, _| {}, |_| {});
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
            waker: UnsafeCell::new(ManuallyDrop::new(None)),
            polls: AtomicU64::new(0),
            poll: AtomicPtr::new(NONE.poll as *mut ()),
            methods: Cell::new(&NONE),
            inheritance: Inheritance::new(),
            #[cfg(not(loom))]
            record,
        }
    }

    /// Sets the waker that it is polled with, which readies it from any thread. It is not dropped.
    ///
    /// # Safety
    ///
    /// The process has not been polled yet, and no other code uses this value at the same time.
    #[inline]
    pub unsafe fn set_waker(&self, waker: Waker) {
        // SAFETY: the caller promises that no other code uses this value, so this is the only
        // access.
        unsafe { *self.waker.get() = ManuallyDrop::new(Some(waker)) };
    }

    /// Makes it one that shares its thread, with these methods.
    ///
    /// # Safety
    ///
    /// As for [`set_waker`](Self::set_waker). `this` may be used for all of the memory that the
    /// process lies in, as its first part, until the methods have freed that; until then it stays
    /// where it is. [`end`](Self::end) is called once.
    #[inline]
    pub unsafe fn set_methods(this: NonNull<Process>, methods: &'static Methods) {
        // Exposed: the pointer is recovered from the process' own address.
        this.expose_provenance();
        // SAFETY: the caller promises a process that no other code uses.
        let process = unsafe { this.as_ref() };
        process.kind.set(Kind::Owned);
        process.methods.set(methods);
        process
            .poll
            .store(methods.poll as *mut (), Ordering::Relaxed);
    }

    /// Polls it as its notices say.
    ///
    /// # Safety
    ///
    /// As for [`Methods::poll`]: it has its turn, on its executor's thread; its body is built, and
    /// has not ended.
    #[inline(always)]
    unsafe fn poll(this: NonNull<Process>, cx: &mut Context<'_>) {
        // SAFETY: the caller promises a live process. `set_methods` and `notify` store functions of
        // this type alone, which require what the caller promises. Acquire: pairs with the store of
        // a notice.
        unsafe {
            let poll = this.as_ref().poll.load(Ordering::Acquire);
            core::mem::transmute::<*mut (), Poll>(poll)(this, cx);
        }
    }

    #[inline(always)]
    fn methods(&self) -> &'static Methods {
        self.methods.get()
    }

    /// Traces the events of this process, if those of its thread are traced. Each turn needs
    /// [`keep_traced`](Self::keep_traced) again.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, which has not readied the process yet.
    pub(crate) unsafe fn set_traced(&self) {
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
    pub(crate) unsafe fn keep_traced(&self) {
        let now = self.state.load(Ordering::Relaxed);
        self.state.store(now | state::TRACED, Ordering::Relaxed);
        crate::current::not_plain(self);
    }

    /// Ends the count of references on its own thread. It is freed when there is no reference to
    /// it: here, or when the last one is dropped.
    ///
    /// # Safety
    ///
    /// This is the executor's thread, or the process was never built; it is not polled again, and
    /// this is the only call. The value may be freed afterwards.
    pub unsafe fn end(this: NonNull<Process>) {
        // SAFETY: the process lives until it is freed below, if at all; the caller promises that
        // this is the only call.
        unsafe {
            // Also one whose body was polled by other code.
            this.as_ref().set_ended(state::COMPLETED);
            if this.as_ref().references.end() {
                Self::free(this);
            }
        }
    }

    /// # Safety
    ///
    /// The process has ended, and the count says that there is no reference to it any more. `this`
    /// may be used for all of its memory.
    pub(crate) unsafe fn free(this: NonNull<Process>) {
        // SAFETY: the caller promises that there is no reference any more, which is so once: so the
        // process is live until `free` is called here.
        unsafe { (this.as_ref().methods().free)(this) };
    }

    /// The waker that readies this process from any thread.
    #[inline]
    pub fn waker(&self) -> Option<&Waker> {
        // SAFETY: by the type's invariant it does not change from the first poll on, and is not
        // read before.
        unsafe { (*self.waker.get()).as_ref() }
    }

    /// Where its waker lies: an executor polls it with that one.
    #[inline(always)]
    pub(crate) fn waker_address(&self) -> *const Waker {
        self.waker.get().cast_const().cast()
    }

    /// As [`waker_address`](Self::waker_address), if its turns are plain ones: it can be readied
    /// without its waker, and its events are not traced.
    #[inline]
    pub(crate) fn waker_of_plain_turns(&self) -> Option<*const Waker> {
        (self.kind.get() == Kind::Owned).then(|| self.waker_address())
    }

    /// The id of its executor. If it has none, it was made with an id that no thread has.
    #[inline]
    pub fn executor_number(&self) -> u64 {
        self.executor_id.number()
    }

    /// Whether `cx` has the process' own waker; its address is almost always the same.
    #[inline]
    pub(crate) fn is_polled_with(&self, cx: &Context<'_>) -> bool {
        ptr::eq(self.waker_address(), cx.waker())
            || self
                .waker()
                .is_some_and(|waker| waker.will_wake(cx.waker()))
    }

    /// Whether it can be readied without its waker.
    #[inline]
    pub(crate) fn is_owned(&self) -> bool {
        matches!(self.kind.get(), Kind::Owned | Kind::Traced)
    }

    /// Whether references to it are counted, and keep its memory.
    #[inline]
    pub(crate) fn is_counted(&self) -> bool {
        self.kind.get() != Kind::Bare
    }

    pub(crate) fn inheritance(&self) -> &Inheritance {
        &self.inheritance
    }

    /// Counts one boost `boost` more or less. `false`: the count would overflow, and nothing has
    /// changed.
    ///
    /// # Safety
    ///
    /// The lock of the executor's boosts is held.
    pub(crate) unsafe fn count_boost(&self, boost: Boost, more: bool) -> bool {
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

    /// A pointer to the process that may be used for all of the memory that it lies in.
    #[inline(always)]
    pub(crate) fn whole(&self) -> NonNull<Process> {
        NonNull::with_exposed_provenance(NonNull::from(self).addr())
    }

    /// The number of counted polls.
    pub fn polls(&self) -> u64 {
        self.polls.load(Ordering::Relaxed)
    }

    /// Sets bits that its executor looks at from the next poll on. They are never cleared. From any
    /// thread that holds a reference.
    #[cfg(not(loom))]
    fn notify(&self, bits: u8) {
        // Release, here and below: a reader of the notice sees what was written before it.
        self.notices.fetch_or(bits, Ordering::Release);
        let poll: Poll = run::poll_attentively;
        self.poll.store(poll as *mut (), Ordering::Release);
    }

    /// What its executor is to look at.
    #[cfg(not(loom))]
    #[inline]
    fn has_notice(&self, bits: u8) -> bool {
        self.notices.load(Ordering::Acquire) & bits != 0
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
    /// [inherits](crate::current::Inheritor).
    #[inline]
    pub fn level(&self) -> u8 {
        self.level.get()
    }

    /// The priority of the process without a boost.
    #[inline]
    pub(crate) fn own_priority(&self) -> Priority {
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
    pub(crate) fn lowered_priority(&self, lowered: u8) -> Priority {
        Priority {
            thread: self.level.thread(self.thread_priority, &self.inheritance),
            level: self.level().saturating_sub(lowered),
        }
    }
}

luna_platform::debug_fields!(Process, |process| id: process.id, priority: process.priority());

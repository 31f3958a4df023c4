//! What the framework knows of a process.

use super::inheritance::{Inheritance, LevelNow};
use super::inheritor::Lent;
use super::lone;
use super::references::References;
use super::run_queue::Link;
use crate::events;
use std::any::Any;
use std::cell::{Cell, UnsafeCell};
use std::fmt;
use std::num::{NonZeroU32, NonZeroU64};
use std::ops::Range;
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::task::{Context, Waker};

/// The number of priority levels within one executor: 0 (lowest) to 31.
pub const LEVELS: u8 = 32;

/// A process' number, unique within this program's run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessId(NonZeroU32);

impl ProcessId {
    /// A number not given out before: on one thread mostly the next one. Wraps after four thousand million processes.
    #[expect(clippy::new_without_default, reason = "each call gives another value")]
    pub fn new() -> Self {
        /// How many a thread takes at once, so that it shares a counter with the others seldom.
        const BLOCK: u32 = 64;
        static NEXT: AtomicU32 = AtomicU32::new(1);
        thread_local! {
            /// The next one of this thread's block, and how many are left.
            static OWN: Cell<(u32, u32)> = const { Cell::new((0, 0)) };
        }
        let (next, left) = match OWN.get() {
            (_, 0) => (NEXT.fetch_add(BLOCK, Ordering::Relaxed), BLOCK),
            own => own,
        };
        OWN.set((next.wrapping_add(1), left - 1));
        Self(NonZeroU32::new(next).unwrap_or(NonZeroU32::MIN))
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

    #[inline]
    pub(crate) fn number(self) -> u64 {
        self.0.get()
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
    /// Readies the process without its waker, at this level, on any other thread than its home's. It must not rely on another wake to go on.
    pub ready_elsewhere: unsafe fn(NonNull<()>, u8),
    /// Frees the owner, on any thread: the process has ended, and nobody refers to it any more.
    pub free: unsafe fn(NonNull<()>),
    /// Polls the body of a process that was taken from the run queue, in its turn; `true` if that has ended it. Here, and not in each process, since all of a kind share it: a
    /// turn reads one line of memory less.
    pub poll: unsafe fn(NonNull<()>, &mut Context<'_>) -> bool,
    /// At which addresses the body lies, and its captures with it. The owner is live; its body may
    /// have ended.
    pub body: unsafe fn(NonNull<()>) -> Range<usize>,
    /// What else an executor does with processes of this kind: it knows of which type that is.
    pub seldom: Option<&'static (dyn Any + Send + Sync)>,
}

/// What a process is doing, as bits of one byte that its home's thread writes.
pub(super) mod state {
    /// It is in the run queue.
    pub(in super::super) const QUEUED: u8 = 1;
    /// It is being polled.
    pub(in super::super) const RUNNING: u8 = 2;
    /// It is not polled any more.
    pub(in super::super) const ENDED: u8 = 4;
    /// It was never polled.
    pub(in super::super) const NEW: u8 = 8;
    /// Who readies it tells that.
    pub(in super::super) const RECORDED: u8 = 16;
}

/// What a process is doing, seen from any thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// It was never readied.
    New,
    /// It waits for its turn.
    Ready,
    /// It is being polled.
    Running,
    /// It waits for something else.
    Waiting,
}

/// How a process is woken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// By its waker alone, and it is not referred to.
    Bare,
    /// By its waker alone.
    Lone,
    /// It shares its thread with others, and has a run queue there.
    Owned,
    /// As `Owned`, and its [events](crate::events) are recorded: it does in other functions what the others do, so that these need not ask.
    Recorded,
}

/// What the framework knows of a process that runs or waits. It lies at one address for the process' whole life.
///
/// # Invariants
///
/// `waker` is written before the process is polled for the first time and when it is freed; in between it is only read. `methods` and `kind` are there
/// for the processes of executors and those that are alone; their owner lies where the process lies, at a multiple of [`ALIGN`](Process::ALIGN), its address is exposed, and it
/// stays valid until `free` was called. `link`, `queued_level` and `state` are written by the home's thread alone, and the link is in its run queue exactly while the state says
/// so, at `queued_level`.
///
/// What each turn and each wait touches comes first: 96 bytes at most, which lie on two cache lines wherever [`ALIGN`](Process::ALIGN) puts them.
#[repr(C)]
pub struct Process {
    /// First, so that it leads back to this.
    link: Link,
    state: AtomicU8,
    /// What its executor is to look at before it polls: any bits that it likes.
    notices: AtomicU8,
    queued_level: Cell<u8>,
    kind: Cell<Kind>,
    thread_priority: u8,
    own_level: u8,
    level: LevelNow,
    id: ProcessId,
    home: Home,
    pub(super) references: References,
    waker: UnsafeCell<Option<Waker>>,
    polls: AtomicU64,
    methods: Cell<Option<&'static Methods>>,
    inheritance: Inheritance,
}

#[cfg(all(not(loom), target_pointer_width = "64"))]
const _: () = assert!(std::mem::offset_of!(Process, inheritance) <= 96);

// SAFETY: by the invariant `waker` and `methods` do not change while others can see them; `references` says itself who may do what.
unsafe impl Sync for Process {}
// SAFETY: as above; a pointer may go anywhere.
unsafe impl Send for Process {}

impl Process {
    /// At a multiple of this lies a process that is referred to by counting: below it a reference keeps the levels of a branch.
    pub const ALIGN: usize = LEVELS as usize;

    /// A process of `home`, whose thread has the real-time priority `thread_priority` (0: none), at `level`.
    #[inline]
    pub fn new(id: ProcessId, home: Home, thread_priority: u8, level: u8) -> Self {
        Self {
            link: Link::new(),
            state: AtomicU8::new(state::NEW),
            notices: AtomicU8::new(0),
            queued_level: Cell::new(0),
            kind: Cell::new(Kind::Bare),
            thread_priority,
            own_level: level,
            level: LevelNow::new(level),
            id,
            home,
            references: References::new(),
            waker: UnsafeCell::new(None),
            polls: AtomicU64::new(0),
            methods: Cell::new(None),
            inheritance: Inheritance::new(super::home_thread_of(home), level),
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
    /// As for [`set_waker`](Self::set_waker). `owner` lies where this value lies, as its first part, at a multiple of [`ALIGN`](Self::ALIGN). The methods may be called with `owner` as
    /// [`Methods`] says, until `free` was called; until then this value stays where it is. [`end`](Self::end) is called once.
    pub unsafe fn set_owner(&self, owner: NonNull<()>, methods: &'static Methods) {
        let is_lone = ptr::eq(methods, &lone::METHODS);
        self.kind
            .set(if is_lone { Kind::Lone } else { Kind::Owned });
        debug_assert_eq!(owner.addr().get(), ptr::from_ref(self).addr());
        debug_assert_eq!(owner.addr().get() % Self::ALIGN, 0);
        // It is found again by the process' own address.
        owner.expose_provenance();
        self.methods.set(Some(methods));
    }

    /// What its executor does for it.
    ///
    /// # Safety
    ///
    /// [`set_owner`](Self::set_owner) was called.
    #[inline(always)]
    pub unsafe fn methods(&self) -> &'static Methods {
        // SAFETY: the contract.
        unsafe { self.methods.get().unwrap_unchecked() }
    }

    /// Says that what it does is recorded, if its thread is: from now on, at each [beginning of a turn](Self::keep_recorded) anew.
    ///
    /// # Safety
    ///
    /// This is the home's thread, which has an owner for it ([`set_owner`](Self::set_owner)) and has not readied it yet.
    pub unsafe fn set_recorded(&self) {
        debug_assert!(self.is_owned());
        self.kind.set(Kind::Recorded);
        // SAFETY: by the contract this is the home's thread.
        unsafe { self.keep_recorded() };
    }

    /// Says at the beginning of a turn of a [recorded](Self::set_recorded) process that it is one:
    /// a turn begins with a store that forgets it.
    ///
    /// # Safety
    ///
    /// This is the home's thread: another one could lose a change of the state that is made there,
    /// so that the process would be queued twice.
    #[inline]
    pub unsafe fn keep_recorded(&self) {
        let now = self.state.load(Ordering::Relaxed);
        self.state.store(now | state::RECORDED, Ordering::Relaxed);
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
            this.as_ref().state.store(state::ENDED, Ordering::Relaxed);
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
            let this = this.as_ref();
            if let Some(methods) = this.methods.get() {
                (methods.free)(this.owner());
            }
        }
    }

    /// The waker that readies this process from anywhere.
    #[inline]
    pub fn waker(&self) -> Option<&Waker> {
        // SAFETY: by the type's invariant it does not change between the first poll and the freeing, and before and after nobody asks.
        unsafe { (*self.waker.get()).as_ref() }
    }

    /// Whether `cx` has the very waker of the process: what an executor polls with.
    #[inline(always)]
    pub(super) fn is_polled_by(&self, cx: &Context<'_>) -> bool {
        ptr::eq(self.waker.get().cast_const().cast::<Waker>(), cx.waker())
    }

    /// The number of its home, which is none of a thread without one.
    #[inline]
    pub fn home_number(&self) -> u64 {
        self.home.number()
    }

    /// Whether one of the `ready` levels is above its own.
    #[inline]
    pub(super) fn is_outranked(&self, ready: u32) -> bool {
        // Two shifts, since a shift by 32 is none.
        (ready >> self.level()) >> 1 != 0
    }

    /// Whether `cx` has the process' own waker: almost always the very one.
    #[inline]
    pub(super) fn is_polled_with(&self, cx: &Context<'_>) -> bool {
        self.is_polled_by(cx)
            || self
                .waker()
                .is_some_and(|waker| waker.will_wake(cx.waker()))
    }

    /// Whether it can be readied without its waker.
    #[inline]
    pub(super) fn is_owned(&self) -> bool {
        matches!(self.kind.get(), Kind::Owned | Kind::Recorded)
    }

    /// Whether it can be readied without its waker, and is not [recorded](Self::set_recorded).
    #[inline]
    pub(super) fn is_owned_unrecorded(&self) -> bool {
        self.kind.get() == Kind::Owned
    }

    /// Whether references to it are counted, and keep its memory.
    #[inline]
    pub(super) fn is_counted(&self) -> bool {
        self.kind.get() != Kind::Bare
    }

    pub(super) fn inheritance(&self) -> &Inheritance {
        &self.inheritance
    }

    /// Changes what is counted for `lent`, by one more or one less. `false`: there are too many to be counted, and nothing has changed.
    ///
    /// # Safety
    ///
    /// The home's lock is held.
    pub(super) unsafe fn count_lent(&self, lent: Lent, more: bool) -> bool {
        let before = events::is_on().then(|| self.level.get());
        // SAFETY: the contract.
        let is_counted = unsafe {
            self.inheritance
                .count(&self.level, self.own_level, lent, more)
        };
        if let Some(before) = before
            && self.level.get() != before
        {
            let levels = || [before.into(), self.level.get().into()];
            events::tell(events::code::PRIORITY, self.id.get(), levels);
        }
        is_counted
    }

    /// Readies the process without its waker, that many levels below its own.
    ///
    /// # Safety
    ///
    /// This is the home's thread, the process is one of an executor's, and stays where it is until it was popped.
    #[inline]
    pub(super) unsafe fn ready_here(&self, lowered: u8, place: Place) {
        // SAFETY: the contract.
        unsafe { self.ready_at(self.level().saturating_sub(lowered), place) };
    }

    /// Puts the process into its executor's run queue at `level`, if it is not there at that level or a higher one, and has not ended. O(1), without
    /// atomics.
    ///
    /// # Safety
    ///
    /// This is the home's thread, the process is one of an executor's, and stays where it is until it was popped. `level` is below [`LEVELS`].
    #[inline]
    pub unsafe fn ready_at(&self, level: u8, place: Place) {
        let now = self.state.load(Ordering::Relaxed);
        if now & (state::QUEUED | state::ENDED | state::RECORDED) != 0 {
            // SAFETY: the contract.
            return unsafe { self.ready_more(level, place) };
        }
        // SAFETY: the contract; it is neither queued nor has it ended.
        unsafe { self.queue_at(now, level, place) };
    }

    /// # Safety
    ///
    /// As for [`ready_at`](Self::ready_at), where the state is `now`: neither queued nor ended.
    #[inline(always)]
    unsafe fn queue_at(&self, now: u8, level: u8, place: Place) {
        self.state
            .store(now & !state::NEW | state::QUEUED, Ordering::Relaxed);
        self.queued_level.set(level);
        // SAFETY: the contract.
        let link = unsafe { self.link() };
        // SAFETY: the contract; by the invariant it is in no queue.
        super::ready::with_queue(|queue| unsafe {
            match place {
                Place::First => queue.push_front(level, link),
                Place::Last => queue.push_back(level, link),
            }
        });
    }

    /// # Safety
    ///
    /// As for [`ready_at`](Self::ready_at).
    #[cold]
    unsafe fn ready_more(&self, level: u8, place: Place) {
        let queued = self.queued_level.get();
        let now = self.state.load(Ordering::Relaxed);
        if now & (state::QUEUED | state::ENDED) == 0 {
            events::ready(|| self.id.get());
            // SAFETY: the contract.
            return unsafe { self.queue_at(now, level, place) };
        }
        if now & state::QUEUED != 0 && queued < level {
            // A more urgent branch of it has become ready: the process waits at the level of the most urgent one.
            self.queued_level.set(level);
            // SAFETY: the contract.
            let link = unsafe { self.link() };
            // SAFETY: the contract, and the invariant.
            super::ready::with_queue(|queue| unsafe {
                queue.remove(queued, link);
                match place {
                    Place::First => queue.push_front(level, link),
                    Place::Last => queue.push_back(level, link),
                }
            });
        }
    }

    /// Says that its turn has come. On the home's thread.
    #[inline]
    pub(super) fn begin_turn(&self) {
        self.state.store(state::RUNNING, Ordering::Relaxed);
    }

    /// Counts a poll. On the home's thread.
    #[inline]
    pub fn count_poll(&self) {
        let polls = self.polls.load(Ordering::Relaxed);
        self.polls.store(polls + 1, Ordering::Relaxed);
    }

    /// Says that its turn has ended. On the home's thread.
    #[inline]
    pub(super) fn end_turn(&self) {
        let now = self.state.load(Ordering::Relaxed);
        self.state.store(now & !state::RUNNING, Ordering::Relaxed);
    }

    /// Whether it is in its executor's run queue. On the home's thread.
    #[inline]
    pub fn is_queued(&self) -> bool {
        self.state.load(Ordering::Relaxed) & state::QUEUED != 0
    }

    /// The link, by a pointer that leads back to the owner.
    ///
    /// # Safety
    ///
    /// The process is one of an executor's.
    #[inline(always)]
    unsafe fn link(&self) -> NonNull<Link> {
        // SAFETY: the contract.
        unsafe { self.owner().cast() }
    }

    /// Who was said to be its owner.
    ///
    /// # Safety
    ///
    /// Somebody was.
    #[inline(always)]
    pub unsafe fn owner(&self) -> NonNull<()> {
        NonNull::with_exposed_provenance(NonNull::from(self).addr())
    }

    /// Says that it is not to be readied any more: its body has ended.
    ///
    /// # Safety
    ///
    /// This is the home's thread, as for [`keep_recorded`](Self::keep_recorded).
    pub unsafe fn set_ended(&self) {
        let now = self.state.load(Ordering::Relaxed);
        self.state.store(now | state::ENDED, Ordering::Relaxed);
    }

    /// What it is doing, from any thread that keeps it.
    pub fn activity(&self) -> Activity {
        match self.state.load(Ordering::Relaxed) {
            now if now & state::RUNNING != 0 => Activity::Running,
            now if now & state::QUEUED != 0 => Activity::Ready,
            now if now & state::NEW != 0 => Activity::New,
            _ => Activity::Waiting,
        }
    }

    /// How many polls were counted.
    pub fn polls(&self) -> u64 {
        self.polls.load(Ordering::Relaxed)
    }

    /// Notes what its executor is to look at before it polls it next. From any thread that keeps it.
    pub fn notify(&self, bits: u8) {
        // Release: who finds the notice finds what was said before.
        self.notices.fetch_or(bits, Ordering::Release);
    }

    /// What was noted. On the home's thread.
    #[inline]
    pub fn notices(&self) -> u8 {
        self.notices.load(Ordering::Acquire)
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
            if let Some(methods) = self.methods.get() {
                (methods.ready_elsewhere)(self.owner(), self.lowered_priority(lowered).level);
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

    /// The level that the process runs at: its own, or a higher one that it [inherits](super::Inheritor).
    #[inline]
    pub fn level(&self) -> u8 {
        self.level.get()
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
            thread: self.level.thread(self.thread_priority, &self.inheritance),
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

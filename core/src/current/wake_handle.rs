//! Wake handles, and the rule for user code.
//!
//! # User code
//!
//! This is the one place where the rule stands. User code is the clone, the wake and the drop of a
//! waker that is not a process' own, the drop of a value, and a closure of the user. It may panic.
//! It may call any operation, also on the object that runs it. So:
//!
//! 1. It never runs under a lock. A waker is cloned before the lock is taken
//!    ([`Renewal`](super::Renewal)). Wakes and drops that a critical section leaves are carried out
//!    of it: the caller wakes a [`PendingWake`] and drops a former [`WakeHandle`].
//! 2. It never runs between two steps of a state change. When it runs, the node is unlinked or
//!    listed, the outcome and the operation's own phase are set, and a received value has an owner.
//!    It is the last step, or a guard does the remaining ones, which also runs while a panic
//!    unwinds.
//! 3. A panic reaches the caller of the operation, and no other code. A [`PendingWake`] that is
//!    dropped by the unwinding wakes all the same. A [`PlainPendingWake`] that is dropped loses its
//!    wake, so no user code runs while there is one. While one panic unwinds, a second one is
//!    contained here, since it would end the program. A thread that wakes on behalf of others and
//!    has more to do (the timer manager, for instance) contains all of them:
//!    [`wake_contained`](PendingWake::wake_contained). At a deadline of an executor a panic ends
//!    the executor, which is an emergency.
//!
//! There is one exception: the closure of a `send_with` runs under the locks of the channel, and of
//! the other channels if alternatives meet. The value must exist when the choice is made, and by
//! then the partner has committed. Without the lock, a partner that times out or is dropped
//! meanwhile would have to wait for the closure: no operation waits for another thread to leave
//! an intermediate state. If the closure ran before the commit,
//! it would make a value for a choice that may not be made. A panic in the closure is caught at
//! once, its payload is leaked, and the channel is poisoned: `channels::source`.

use super::{Here, LEVELS, PlainTurn, Process, QueueEnd, executor_id, lowered, process};
use crate::park;
use core::fmt;
use core::mem::{self, ManuallyDrop};
use core::num::NonZeroUsize;
use core::ptr::{self, NonNull};
use core::task::{Context, Waker};

/// The cache lines of a process' memory to prefetch, as offsets in bytes: those behind the fields
/// of a wake.
const FETCHED: [usize; 4] = [128, 192, 256, 320];

/// A counted reference to a process of an executor, and the number of levels below its own at which
/// it is readied: those of the waiting branch.
///
/// # Invariants
///
/// It is counted in the process' references, so the process' memory is valid. The levels are in the
/// pointer's low bits, which are free since a counted [`Process`] is aligned to the number of
/// levels: a wake handle longer than two words makes each wait 15 ns slower.
pub(super) struct Reference(NonNull<Process>);

const LOWERED: usize = Process::ALIGN - 1;
const _: () = assert!(LOWERED + 1 >= LEVELS as usize && Process::ALIGN.is_power_of_two());

// SAFETY: the process is `Sync`, and counting down works on any thread.
unsafe impl Send for Reference {}
// SAFETY: `&Reference` gives `&Process`, which is `Sync`, and copies, which are counted by an
// atomic and may be dropped on any thread.
unsafe impl Sync for Reference {}

impl Reference {
    /// Refers to the current process, at the level of its current branch.
    #[inline]
    pub(super) fn to_current(process: &Process) -> Self {
        process.references.add_here();
        Self(Self::packed(process))
    }

    /// Refers to the current process, in its plain turn.
    #[inline(always)]
    pub(super) fn of_plain_turn(turn: PlainTurn<'_>) -> Self {
        let process = turn.process();
        process.references.add_here();
        Self(NonNull::from(process))
    }

    #[inline]
    fn packed(process: &Process) -> NonNull<Process> {
        NonNull::from(process).map_addr(|address| address | usize::from(lowered()))
    }

    #[inline]
    fn pointer(&self) -> NonNull<Process> {
        // SAFETY: the masked address is that of a process, and no process lies in the first bytes
        // of the address space.
        self.0
            .map_addr(|address| unsafe { NonZeroUsize::new_unchecked(address.get() & !LOWERED) })
    }

    /// The number of levels below its own at which the process is readied.
    #[inline]
    pub(super) fn lowered(&self) -> u8 {
        (self.0.addr().get() & LOWERED) as u8
    }

    #[inline]
    pub(super) fn process(&self) -> &Process {
        // SAFETY: by the type's invariant this reference keeps the process' memory.
        unsafe { self.pointer().as_ref() }
    }

    /// Another reference to the same process. From any thread; one atomic operation.
    pub(super) fn copy(&self) -> Self {
        self.process().references.add_elsewhere();
        Self(self.0)
    }

    #[inline]
    pub(super) fn is_here(&self) -> bool {
        executor_id() == Some(self.process().executor_id())
    }

    /// Readies the process, on this thread or another one.
    #[inline]
    pub(super) fn wake(&self) {
        // SAFETY: the thread was looked at; the reference keeps the process' memory.
        unsafe {
            if self.is_here() {
                self.ready_here(QueueEnd::Back);
            } else {
                self.process().ready_elsewhere(self.lowered());
            }
        }
    }

    /// Readies the process.
    ///
    /// # Safety
    ///
    /// This is the executor's thread.
    #[inline]
    unsafe fn ready_here(&self, place: QueueEnd) -> bool {
        // SAFETY: the caller promises that this is the executor's thread; the reference keeps the
        // process' memory.
        unsafe { self.process().ready_here(self.lowered(), place) }
    }
}

impl Drop for Reference {
    #[inline]
    fn drop(&mut self) {
        let process = self.process();
        if self.is_here() && process.remove_unless_ended() {
            return;
        }
        if process.references.remove_elsewhere() {
            // SAFETY: the count says that this was the last, of a process that has ended.
            unsafe { Process::free(process.whole()) };
        }
    }
}

/// The wake handle of a waiting operation: stored in its node, under the lock of the object that it
/// waits for.
///
/// It keeps the memory of the process that it wakes, but not the process: waking a process that has
/// ended does nothing.
#[derive(Debug)]
pub struct WakeHandle(Inner);

#[derive(Debug)]
enum Inner {
    Process(Reference),
    Waker(Foreign),
}

/// A waker with functions that are user code.
#[derive(Debug)]
struct Foreign(ManuallyDrop<Waker>);

impl Foreign {
    fn new(waker: Waker) -> Self {
        Self(ManuallyDrop::new(waker))
    }

    /// The waker, without running its drop.
    fn into_waker(self) -> Waker {
        let mut this = ManuallyDrop::new(self);
        // SAFETY: taken once, since `this` is not dropped.
        unsafe { ManuallyDrop::take(&mut this.0) }
    }
}

impl Drop for Foreign {
    fn drop(&mut self) {
        // SAFETY: taken once, since this is its drop.
        let waker = unsafe { ManuallyDrop::take(&mut self.0) };
        run_user_code(|| drop(waker));
    }
}

/// Runs user code. A panic in it is propagated, unless one unwinds already.
fn run_user_code(code: impl FnOnce()) {
    match luna_platform::panics::is_panicking() {
        true => contain(code),
        false => code(),
    }
}

/// Runs user code; a panic in it ends here. The panic hook has reported it.
#[cold]
fn contain(code: impl FnOnce()) {
    if let Err(payload) = luna_platform::panics::catch(code) {
        // The drop of the payload is user code too.
        mem::forget(payload);
    }
}

impl fmt::Debug for Reference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.process().fmt(f)
    }
}

impl WakeHandle {
    /// The wake handle for `cx`. It does without the waker if `cx` is that of the current process
    /// itself, the process shares its thread with others, and no combinator with its own wakers is
    /// in between.
    ///
    /// It may clone a waker: do not call it under a lock.
    #[inline]
    pub fn of(cx: &Context<'_>) -> WakeHandle {
        Self::without_waker(cx)
            .unwrap_or_else(|| WakeHandle(Inner::Waker(Foreign::new(cx.waker().clone()))))
    }

    /// As [`of`](Self::of), if that needs no clone of a waker: so it may be called under a lock.
    #[inline]
    pub fn without_waker(cx: &Context<'_>) -> Option<WakeHandle> {
        process(|process| match process {
            Some(process) if process.is_owned() && process.is_polled_with(cx) => {
                Some(WakeHandle(Inner::Process(Reference::to_current(process))))
            }
            _ => None,
        })
    }

    /// The wake handle of the current process, an executor's: so references to it are counted, and
    /// without atomics on this thread.
    #[inline(always)]
    pub fn of_plain_turn(turn: PlainTurn<'_>) -> WakeHandle {
        PlainPendingWake::of_plain_turn(turn).into()
    }

    /// Takes out a handle that wakes a process without a waker; `None` for any other handle, which
    /// stays. One word is moved.
    ///
    /// # Safety
    ///
    /// If it wakes a process, it was made [in a plain turn](Self::of_plain_turn) of this thread.
    #[inline(always)]
    pub unsafe fn take_plain(from: &mut Option<WakeHandle>) -> Option<PlainPendingWake> {
        let Some(WakeHandle(Inner::Process(reference))) = from else {
            return None;
        };
        // SAFETY: the reference is moved: what it lay in is overwritten, not dropped.
        unsafe {
            let reference = ptr::read(reference);
            ptr::write(from, None);
            Some(PlainPendingWake(reference))
        }
    }

    /// Reads a handle that was made [in a plain turn](Self::of_plain_turn). One word is moved.
    ///
    /// # Safety
    ///
    /// There is such a handle at `place`, and it is not used again.
    #[inline(always)]
    pub unsafe fn plain_of(place: *const Option<WakeHandle>) -> PlainPendingWake {
        // SAFETY: the caller promises that a process' handle is at `place`, so the other arm is not
        // reached; and that it is not used again, so the reference that is read has one owner.
        unsafe {
            match &*place {
                Some(WakeHandle(Inner::Process(reference))) => {
                    PlainPendingWake(ptr::read(reference))
                }
                _ => core::hint::unreachable_unchecked(),
            }
        }
    }

    /// Wakes a process of this thread, unless it has ended. That runs no user code and frees
    /// nothing, so it may be done under the lock that guards `stored`. `false`: it is not so, and
    /// nothing has changed; the caller [takes](Self::take) the handle out of the lock.
    #[inline(always)]
    pub fn wake_here(stored: &mut Option<WakeHandle>, here: Here<'_>) -> bool {
        let Some(WakeHandle(Inner::Process(reference))) = stored else {
            return false;
        };
        let process = reference.process();
        if process.executor_number() != here.executor_number() {
            return false;
        }
        // SAFETY: this is the thread of the process' executor; the reference keeps its memory.
        if !unsafe { reference.ready_here(QueueEnd::Back) } {
            return false;
        }
        // One that has not ended. Counted off here; a drop must not count again.
        process.references.remove_here();
        // SAFETY: what lies there is overwritten, not dropped.
        unsafe { ptr::write(stored, None) };
        true
    }

    /// Whether it wakes the same task as `cx`.
    #[inline]
    pub fn is_of(&self, cx: &Context<'_>) -> bool {
        match &self.0 {
            Inner::Waker(waker) => waker.0.will_wake(cx.waker()),
            Inner::Process(reference) => process(|process| {
                process.is_some_and(|process| {
                    Reference::packed(process) == reference.0 && process.is_polled_with(cx)
                })
            }),
        }
    }

    /// Turns the handle into a wake for after the lock is released. O(1): it runs no user code.
    #[inline]
    pub fn take(self) -> PendingWake {
        PendingWake(Some(self.0))
    }

    /// Whether one wake suffices, however many are due: it readies a process of this thread, or is
    /// a foreign waker, which cannot be copied under a lock.
    pub(super) fn is_woken_once(&self) -> bool {
        match &self.0 {
            Inner::Process(reference) => reference.is_here(),
            Inner::Waker(waker) => !park::is_own(&waker.0),
        }
    }

    /// Readies the process, or returns a wake for one that is not [woken
    /// once](Self::is_woken_once).
    pub(super) fn wake_again(&self) -> PendingWake {
        match &self.0 {
            // The waker of a parker: no user code.
            Inner::Waker(waker) => {
                PendingWake(Some(Inner::Waker(Foreign::new((*waker.0).clone()))))
            }
            Inner::Process(reference) => {
                reference.wake();
                PendingWake::NONE
            }
        }
    }
}

/// A pending wake of a process of this thread's executor: see [`WakeHandle::take_plain`]. Dropping
/// it loses the wake, so no user code runs between the taking and the wake.
///
/// # Invariants
///
/// It was made in a plain turn, so it is for the process' own level: the pointer has no low bits.
#[derive(Debug)]
#[must_use = "the process is not woken unless `wake` is called"]
pub struct PlainPendingWake(Reference);

impl PlainPendingWake {
    /// A wake of the current process, from its plain turn.
    #[inline(always)]
    pub(crate) fn of_plain_turn(turn: PlainTurn<'_>) -> Self {
        Self(Reference::of_plain_turn(turn))
    }

    /// The process that it wakes.
    #[inline(always)]
    pub(crate) fn process(&self) -> &Process {
        debug_assert_eq!(self.0.lowered(), 0);
        // SAFETY: by the invariants of both types the pointer is that of the process, and the
        // reference keeps its memory.
        unsafe { self.0.0.as_ref() }
    }

    /// The wake as a pointer, for [`from_pointer`](Self::from_pointer).
    #[inline(always)]
    pub(crate) fn into_pointer(self) -> NonNull<Process> {
        ManuallyDrop::new(self).0.0
    }

    /// The wake that was made a pointer.
    ///
    /// # Safety
    ///
    /// [`into_pointer`](Self::into_pointer) gave the pointer, and this is called once with it.
    #[inline(always)]
    pub(crate) unsafe fn from_pointer(process: NonNull<Process>) -> Self {
        Self(Reference(process))
    }

    /// Prefetches the memory of the process, since it will be polled soon: its executor's data, and
    /// the begin of its body. A few instructions, without waiting.
    #[inline(always)]
    pub fn fetch(&self) {
        fetch_lines(self.0.0.as_ptr().cast(), FETCHED);
    }

    /// Readies the process if it waits, no other one is ready, and the current one need not yield.
    /// Otherwise no state has changed. O(1), without atomics.
    ///
    /// # Errors
    ///
    /// The pending wake, if it is not so.
    ///
    /// # Safety
    ///
    /// As for [`wake`](Self::wake): the wake handle was made in a plain turn on this thread.
    #[inline(always)]
    pub unsafe fn wake_if_none_ready(self, turn: PlainTurn<'_>) -> Result<(), Self> {
        let process = self.process();
        // SAFETY: the caller promises that the handle was made on this thread, which is the
        // executor's. A process that waits is kept by its executor until it was popped.
        unsafe {
            if !process.ready_if_none_ready(turn) {
                return Err(self);
            }
        }
        // One that waits has not ended.
        process.references.remove_here();
        mem::forget(self);
        Ok(())
    }

    /// Readies the process behind the others of its level. O(1), without atomics.
    ///
    /// # Safety
    ///
    /// Its wake handle was made [in a plain turn](WakeHandle::of_plain_turn) on this thread.
    #[inline(always)]
    pub unsafe fn wake(self) {
        let process = self.process();
        // SAFETY: the caller promises that the handle was made on this thread, which is the
        // executor's; the reference keeps the process' memory.
        if unsafe { process.ready_here(0, QueueEnd::Back) } {
            process.references.remove_here();
            // Counted off here; the drop must not count again.
            mem::forget(self);
        }
    }
}

/// Asks the processor to prefetch the lines at these distances in bytes from `start`. A hint:
/// nothing is accessed, so the memory need not exist; on an unknown architecture it does nothing.
#[inline(always)]
fn fetch_lines<const N: usize>(start: *const u8, distances: [usize; N]) {
    for distance in distances {
        fetch_line(start.wrapping_add(distance));
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
#[inline(always)]
fn fetch_line(address: *const u8) {
    use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
    // SAFETY: every processor of this architecture has the instruction, which faults at no address.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
}

#[cfg(not(all(target_arch = "x86_64", not(miri))))]
#[inline(always)]
fn fetch_line(_: *const u8) {}

impl From<PlainPendingWake> for WakeHandle {
    #[inline(always)]
    fn from(wake: PlainPendingWake) -> Self {
        WakeHandle(Inner::Process(wake.0))
    }
}

/// A pending wake. Carry it out with [`wake`](Self::wake) after releasing locks. Dropping it wakes
/// too, so no wake is lost when user code panics before it.
#[derive(Debug)]
#[must_use = "call `wake` after the locks are released; a drop wakes too"]
pub struct PendingWake(Option<Inner>);

impl PendingWake {
    /// No process to wake.
    pub const NONE: PendingWake = PendingWake(None);

    /// Readies the process. O(1); a system call only if it is on another thread that sleeps.
    #[inline(always)]
    pub fn wake(self) {
        let this = ManuallyDrop::new(self);
        // SAFETY: read once, since `this` is not dropped.
        if let Some(handle) = unsafe { ptr::read(&this.0) } {
            handle.wake();
        }
    }

    /// As [`wake`](Self::wake), for a thread that wakes on behalf of others: a panic of a foreign
    /// waker is contained here.
    #[inline]
    pub fn wake_contained(self) {
        match self.0 {
            Some(Inner::Waker(_)) => contain(|| self.wake()),
            _ => self.wake(),
        }
    }

    #[cold]
    fn wake_after_all(&mut self) {
        if let Some(handle) = self.0.take() {
            handle.wake();
        }
    }
}

impl Drop for PendingWake {
    #[inline(always)]
    fn drop(&mut self) {
        if self.0.is_some() {
            self.wake_after_all();
        }
    }
}

impl Inner {
    #[inline]
    fn wake(self) {
        match self {
            Inner::Process(reference) => reference.wake(),
            Inner::Waker(waker) => {
                let waker = waker.into_waker();
                run_user_code(|| waker.wake());
            }
        }
    }
}

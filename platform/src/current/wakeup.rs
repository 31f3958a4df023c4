//! Whom to wake.

use super::process::{Place, Process};
use super::{LEVELS, home, lowered, process};
use crate::fetch;
use std::fmt;
use std::num::NonZeroUsize;
use std::ptr::{self, NonNull};
use std::task::{Context, Waker};

/// Which lines of a process' memory, by their distances in bytes: those behind what makes it ready.
const FETCHED: [usize; 4] = [128, 192, 256, 320];

/// A counted reference to a process of an executor, and how many levels below its own the process is to be readied: those of the
/// branch that waits.
///
/// # Invariants
///
/// It is counted in the process' references, so the process' memory is there. The levels stand in the pointer's low bits, which are free
/// since a counted [`Process`] is aligned to as many as there are levels: a wakeup that is longer than two words makes each wait dearer by 15 ns.
pub(super) struct Reference(NonNull<Process>);

const LOWERED: usize = Process::ALIGN - 1;
const _: () = assert!(LOWERED + 1 >= LEVELS as usize && Process::ALIGN.is_power_of_two());

// SAFETY: what it leads to is `Sync`, and counting down works from any thread.
unsafe impl Send for Reference {}
// SAFETY: as above.
unsafe impl Sync for Reference {}

impl Reference {
    /// Refers to the current process, at the level of its current branch.
    #[inline]
    pub(super) fn to_current(process: &Process) -> Self {
        process.references.add();
        Self(Self::packed(process))
    }

    #[inline]
    fn packed(process: &Process) -> NonNull<Process> {
        NonNull::from(process).map_addr(|address| address | usize::from(lowered()))
    }

    #[inline]
    fn pointer(&self) -> NonNull<Process> {
        // SAFETY: no process lies in the first bytes of the address space.
        self.0
            .map_addr(|address| unsafe { NonZeroUsize::new_unchecked(address.get() & !LOWERED) })
    }

    /// How many levels below its own the process is to be readied.
    #[inline]
    pub(super) fn lowered(&self) -> u8 {
        (self.0.addr().get() & LOWERED) as u8
    }

    #[inline]
    pub(super) fn process(&self) -> &Process {
        // SAFETY: the type's invariant.
        unsafe { self.pointer().as_ref() }
    }

    /// Another one to the same. From any thread; one atomic operation.
    pub(super) fn copy(&self) -> Self {
        self.process().references.add_elsewhere();
        Self(self.0)
    }

    #[inline]
    pub(super) fn is_here(&self) -> bool {
        home() == Some(self.process().home())
    }

    /// Readies the process.
    ///
    /// # Safety
    ///
    /// This is the home's thread.
    #[inline]
    pub(super) unsafe fn ready_here(&self, place: Place) {
        // SAFETY: the contract.
        unsafe { self.process().ready_here(self.lowered(), place) };
    }
}

impl Drop for Reference {
    #[inline]
    fn drop(&mut self) {
        let is_here = self.is_here();
        if self.process().references.remove(is_here) {
            // SAFETY: the count says that this was the last.
            unsafe { Process::free(self.pointer()) };
        }
    }
}

/// How a waiting operation is woken: stored in its node, under the lock of what it waits for.
///
/// It keeps the memory of the process that it wakes, but not the process: waking one that has ended does nothing.
#[derive(Debug)]
pub struct Wakeup(Inner);

enum Inner {
    Process(Reference),
    Waker(Waker),
}

impl fmt::Debug for Reference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.process().fmt(f)
    }
}

impl fmt::Debug for Inner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Inner::Process(reference) => reference.fmt(f),
            Inner::Waker(waker) => waker.fmt(f),
        }
    }
}

impl Wakeup {
    /// How to wake who polls with `cx`: without its waker if that is the current process itself, shares its thread with others, and is
    /// not a combinator with wakers of its own within it.
    #[inline]
    pub fn of(cx: &Context<'_>) -> Wakeup {
        process(|process| match process {
            Some(process) if process.is_owned() && process.is_polled_with(cx) => {
                Wakeup(Inner::Process(Reference::to_current(process)))
            }
            _ => Wakeup(Inner::Waker(cx.waker().clone())),
        })
    }

    /// How to wake the current process, in a [plain turn](super::plain_turn).
    ///
    /// # Safety
    ///
    /// `process` is the current one of this thread, and an executor's: `plain_turn` has given it in
    /// this turn. So references to it are counted, and without atomics on this thread, which is its
    /// home.
    #[inline(always)]
    pub unsafe fn of_plain_turn(process: &Process) -> Wakeup {
        process.references.add();
        Wakeup(Inner::Process(Reference(NonNull::from(process))))
    }

    /// Whether there is one that [`take_plain`](Self::take_plain) takes.
    #[inline(always)]
    pub fn is_plain(wakeup: &Option<Wakeup>) -> bool {
        matches!(wakeup, Some(Wakeup(Inner::Process(_))))
    }

    /// Takes out what was made [of a plain turn](Self::of_plain_turn); `None` for another one, which stays. One word is moved.
    #[inline(always)]
    pub fn take_plain(from: &mut Option<Wakeup>) -> Option<PlainReady> {
        let Some(Wakeup(Inner::Process(reference))) = from else {
            return None;
        };
        // SAFETY: the reference is moved: what it lay in is overwritten, not dropped.
        unsafe {
            let reference = ptr::read(reference);
            ptr::write(from, None);
            Some(PlainReady(reference))
        }
    }

    /// Whether it wakes the same as `cx` would.
    #[inline]
    pub fn is_of(&self, cx: &Context<'_>) -> bool {
        match &self.0 {
            Inner::Waker(waker) => waker.will_wake(cx.waker()),
            Inner::Process(reference) => process(|process| {
                process.is_some_and(|process| {
                    Reference::packed(process) == reference.0 && process.is_polled_with(cx)
                })
            }),
        }
    }

    /// Makes ready to wake after the lock is released. O(1): nothing of another's is called.
    #[inline]
    pub fn take(self) -> Ready {
        Ready(match self.0 {
            Inner::Waker(waker) => Readying::Waker(waker),
            Inner::Process(reference) => Readying::Process(reference),
        })
    }

    /// Whether it readies a process of this thread, without its waker.
    pub(super) fn is_here(&self) -> bool {
        matches!(&self.0, Inner::Process(reference) if reference.is_here())
    }

    /// Readies a process of another thread, or gives what does so with a waker, which is not to be woken under a lock.
    ///
    /// The caller has seen that it is not of this thread ([`is_here`](Self::is_here)).
    pub(super) fn wake_elsewhere(&self) -> Ready {
        match &self.0 {
            Inner::Waker(waker) => Ready(Readying::Waker(waker.clone())),
            Inner::Process(reference) => {
                // SAFETY: the reference keeps the process' memory, and the caller saw that it is not of this thread.
                unsafe { reference.process().ready_elsewhere(reference.lowered()) };
                Ready::NOBODY
            }
        }
    }
}

/// A wake of a process of this thread's home that is due: see [`Wakeup::take_plain`].
#[derive(Debug)]
#[must_use = "the process stays asleep until `wake` is called"]
pub struct PlainReady(Reference);

impl PlainReady {
    /// Has the memory of the process fetched into the cache, since it will be polled soon: what its executor keeps for it, and the begin of its body. A few instructions, which wait
    /// for nothing.
    #[inline(always)]
    pub fn fetch(&self) {
        fetch::lines(self.0.pointer().as_ptr().cast(), FETCHED);
    }

    /// Readies the process behind the others of its level. O(1), without atomics.
    ///
    /// # Safety
    ///
    /// Its wakeup was made [of a plain turn](Wakeup::of_plain_turn) on this thread.
    #[inline(always)]
    pub unsafe fn wake(self) {
        let process = self.0.process();
        // SAFETY: the contract; the reference keeps the process' memory.
        unsafe { process.ready_here(0, Place::Last) };
        if process.references.remove_here() {
            // It is not the last one, and is counted off.
            std::mem::forget(self);
        }
    }
}

/// A wake that is due. Carry it out with [`wake`](Self::wake) after releasing locks.
#[derive(Debug)]
#[must_use = "the process stays asleep until `wake` is called"]
pub struct Ready(Readying);

enum Readying {
    Process(Reference),
    Waker(Waker),
    Nobody,
}

impl fmt::Debug for Readying {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Readying::Process(reference) => reference.fmt(f),
            Readying::Waker(waker) => waker.fmt(f),
            Readying::Nobody => f.write_str("Nobody"),
        }
    }
}

impl Ready {
    /// Nobody to wake.
    pub const NOBODY: Ready = Ready(Readying::Nobody);

    /// Readies the process. O(1); a system call only if it is elsewhere and its thread sleeps.
    #[inline]
    pub fn wake(self) {
        match self.0 {
            Readying::Process(reference) => {
                // SAFETY: in each case the thread is what it must be; the reference keeps the process' memory.
                unsafe {
                    if reference.is_here() {
                        reference.ready_here(Place::Last);
                    } else {
                        reference.process().ready_elsewhere(reference.lowered());
                    }
                }
            }
            Readying::Waker(waker) => waker.wake(),
            Readying::Nobody => {}
        }
    }
}

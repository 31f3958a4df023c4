//! A lock that costs the thread which alone uses it no atomic read-modify-write: what channels are guarded by.
//!
//! Most channels connect processes of one executor. Their lock is taken by one thread for ever, and two compare-and-swaps an operation would be
//! most of what a communication costs. So a lock that one home has taken many times in a row comes to *favour* it: from then on that home's
//! thread says by plain stores that it is inside, and anybody else has to end the favour first, once in the lock's life.
//!
//! ```text
//!   shared --one home alone, 16 times--> favours it --anybody else--> shared, for good
//!     \                                       ^  \
//!      two homes: shared, for good             '---' who only looks (`lock_briefly`) gives the favour back
//! ```
//!
//! # Why it excludes
//!
//! ```text
//!   home, each time                      another thread, once
//!   inside = 1                           (holds `shared`)
//!   -- light fence --                    favoured = nobody
//!   favoured is me? in : out             -- heavy fence --
//!   ...                                  waits while inside = 1
//!   inside = 0
//!   -- light fence --
//!   favoured is me? done : repair
//! ```
//!
//! It is Dekker's pattern: between the two stores and the two loads at least one side sees the other's store, if both have a full fence. The light
//! fence keeps only the compiler from reordering; the heavy one, `membarrier(2)`, makes every running thread of the program execute a full fence, so
//! the home's is there whenever it matters (asymmetric fences: P1202, and biased locks: D. Dice, H. Huang, M. Yang, *Asymmetric Dekker
//! Synchronization*, 2001). What they order they do not exclude: who finds the home inside has to wait. It does so with priority inheritance: `inside` is the word
//! of a priority-inheriting futex, and the home writes its thread's number there, so the kernel knows whom to lend the priority of who waits.
//! Its plain store on leaving may erase the kernel's note that somebody waits, hence the second look at `favoured`, and the
//! repair (`Inside::leave_revoked`).
//!
//! The models of loom check this with full fences on both sides: what the kernel makes of the pair.

use crate::current;
use luna_platform::fence;
use luna_platform::inside::Inside;
use luna_platform::lock::{PiGuard, PiLock};
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU64, Ordering};
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// How often one home takes the lock in a row until it is favoured.
const ALONE: u8 = 16;

/// How often that is in this program.
static USES_ALONE: std::sync::atomic::AtomicU8 = std::sync::atomic::AtomicU8::new(ALONE);

/// Lets locks favour a home after so many uses: for tests that would else be over before any does.
#[doc(hidden)]
pub fn bias_after(uses: u8) {
    USES_ALONE.store(uses, std::sync::atomic::Ordering::Relaxed);
}

#[inline]
fn uses_alone() -> u8 {
    USES_ALONE.load(std::sync::atomic::Ordering::Relaxed)
}

/// Favours nobody; no home has this number.
const NOBODY: u64 = u64::MAX;

/// A lock that costs its favoured home no read-modify-write, and everybody else what a [`PiLock`] costs.
///
/// Real-time path: yes. For the favoured home O(1), a few loads and stores; shared, as for `PiLock`. The first use by another thread while a home is
/// favoured makes one system call (`membarrier(2)`, some microseconds; it interrupts the processors that run threads of this program), and waits for a section of the
/// home that is under way, with priority inheritance. After that nobody is favoured again.
///
/// # Panics
///
/// `lock` panics if the thread that calls it holds the lock already.
///
/// ```
/// use luna_core::biased_lock::BiasedLock;
///
/// let count = BiasedLock::new(0);
/// *count.lock() += 1;
/// assert_eq!(*count.lock(), 1);
/// ```
///
/// # Invariants
///
/// `favoured` is changed by who holds `shared` alone: from `NOBODY` to a home by that home's thread, and back by anybody. `value` is accessed by who holds
/// `shared` while nobody is favoured and `inside` is free after the heavy fence, or by the favoured home's thread while it holds `inside`.
#[repr(C)]
pub struct BiasedLock<T> {
    favoured: AtomicU64,
    inside: Inside,
    shared: PiLock<Uses>,
    value: UnsafeCell<T>,
}

// What it guards begins on the line of its words, and channels count on how much of it is left.
#[cfg(all(target_os = "linux", not(luna_portable), not(loom)))]
const _: () = assert!(std::mem::offset_of!(BiasedLock<u64>, value) == 32);

// SAFETY: the lock hands out access to one thread at a time, so sharing it needs no more than that the value may change threads.
unsafe impl<T: Send> Sync for BiasedLock<T> {}
// SAFETY: a lock that is moved is not borrowed, so nobody holds it; it is as `Send` as its value.
unsafe impl<T: Send> Send for BiasedLock<T> {}

/// Who has used the lock in shared mode lately. Packed, so that the lock's word lies beside `inside`, and leaves more of their line to what the lock guards.
#[derive(Debug, Clone, Copy)]
#[repr(C, packed(4))]
struct Uses {
    /// The home that did last.
    home: u64,
    in_a_row: u8,
    /// A favour was ended by somebody else, or two homes have used it: there will be no other.
    is_shared_for_good: bool,
}

impl Uses {
    #[inline]
    fn count(&mut self, home: u64) {
        if home == 0 {
            // A plain thread: it may have used it when the system was set up.
            self.in_a_row = 0;
            return;
        }
        if self.home != home {
            // Two homes: it will be so again.
            self.is_shared_for_good |= self.home != NOBODY;
            self.home = home;
            self.in_a_row = 0;
        }
        self.in_a_row = self.in_a_row.saturating_add(1);
    }

    #[inline]
    fn earn_favour(&self) -> bool {
        self.in_a_row >= uses_alone() && !self.is_shared_for_good
    }
}

/// Unlocks when dropped. Stays on the thread that locked.
#[must_use = "the lock is released when the guard is dropped"]
pub struct BiasedGuard<'a, T> {
    lock: &'a BiasedLock<T>,
    held: Held<'a>,
    stays_on_its_thread: PhantomData<*const ()>,
}

enum Held<'a> {
    /// By the favoured home, whose number this is.
    Inside(u64),
    Shared(PiGuard<'a, Uses>),
}

impl<T> BiasedLock<T> {
    /// An unlocked lock around `value`, which favours nobody yet.
    pub fn new(value: T) -> Self {
        Self {
            favoured: AtomicU64::new(NOBODY),
            inside: Inside::new(),
            shared: PiLock::new(Uses {
                home: NOBODY,
                in_a_row: 0,
                is_shared_for_good: false,
            }),
            value: UnsafeCell::new(value),
        }
    }

    /// An unlocked lock around `value`, which favours the home that the calling thread is from the start, if it is one: of a thing that
    /// will be used there, and seldom elsewhere.
    #[inline]
    pub fn biased_to_this_executor(value: T) -> Self {
        let lock = Self::new(value);
        let home = current::home_number();
        if home != 0 && fence::is_available() {
            // Who comes to know the lock sees this.
            lock.favoured.store(home, Ordering::Relaxed);
        }
        lock
    }

    /// Locks, waiting as long as another thread holds it.
    #[inline]
    pub fn lock(&self) -> BiasedGuard<'_, T> {
        self.lock_as(current::home_number())
    }

    /// Locks if this thread is the home of that number and the lock favours it: then without any atomic read-modify-write.
    ///
    /// # Safety
    ///
    /// This thread is the home of that number.
    #[inline(always)]
    pub unsafe fn lock_if_favoured(&self, home: u64) -> Option<InsideGuard<'_, T>> {
        // Acquire, here and below: who borrowed the value gave the favour back after it.
        if self.favoured.load(Ordering::Acquire) != home {
            return None;
        }
        self.inside.enter();
        fence::light();
        if self.favoured.load(Ordering::Acquire) == home {
            return Some(InsideGuard {
                lock: self,
                home,
                stays_on_its_thread: PhantomData,
            });
        }
        self.inside.leave();
        self.inside.leave_revoked();
        None
    }

    /// As [`lock_if_favoured`](Self::lock_if_favoured), for who takes several such locks at once and does not know whether two are the same: `None` also if this
    /// thread holds the lock already.
    ///
    /// # Safety
    ///
    /// This thread is the home of that number.
    #[inline(always)]
    pub unsafe fn lock_if_free(&self, home: u64) -> Option<InsideGuard<'_, T>> {
        if self.favoured.load(Ordering::Acquire) != home || self.inside.is_entered() {
            return None;
        }
        // SAFETY: the contract.
        unsafe { self.lock_if_favoured(home) }
    }

    /// The guard that was [kept](InsideGuard::keep).
    ///
    /// # Safety
    ///
    /// This thread, the home of that number, has kept a guard of this lock, and did not call this since.
    #[inline(always)]
    pub unsafe fn kept(&self, home: u64) -> InsideGuard<'_, T> {
        InsideGuard {
            lock: self,
            home,
            stays_on_its_thread: PhantomData,
        }
    }

    /// Favours a home before its first use: of a lock that is made for a thing whose other locks favour that home already.
    ///
    /// # Safety
    ///
    /// This thread is the home of that number, nobody else knows the lock or has used it, and some other lock favours that home.
    #[inline]
    pub unsafe fn favour_from_the_start(&self, home: u64) {
        // The heavy fence is there, or nobody would be favoured. Who comes to know the lock sees this.
        self.favoured.store(home, Ordering::Relaxed);
    }

    /// Locks as [`lock`](Self::lock) does, for a look now and then: who is favoured stays it. Not for what uses the value regularly.
    pub fn lock_briefly(&self) -> BriefGuard<'_, T> {
        let me = current::home_number();
        if self.favoured.load(Ordering::Relaxed) == me {
            return BriefGuard(Brief::Locked(self.lock_as(me)));
        }
        self.inside.assert_not_here();
        let uses = self.shared.lock();
        let home = self.favoured.load(Ordering::Relaxed);
        BriefGuard(if home == NOBODY {
            Brief::Locked(self.guard(Held::Shared(uses)))
        } else {
            self.exclude_home();
            Brief::Borrowed {
                lock: self,
                _uses: uses,
                home,
            }
        })
    }

    /// Whether a home is favoured.
    pub fn is_favouring(&self) -> bool {
        self.favoured.load(Ordering::Relaxed) != NOBODY
    }

    /// The value, without locking: the exclusive borrow shows that nobody holds it.
    pub fn with_mut<R>(&mut self, f: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: the exclusive borrow.
        self.value.with_mut(|value| f(unsafe { &mut *value }))
    }

    /// Locks on the thread of home `me`, 0 if it is none.
    #[inline(always)]
    fn lock_as(&self, me: u64) -> BiasedGuard<'_, T> {
        loop {
            // SAFETY: the callers are on the thread of home `me`, or of none.
            if let Some(inside) = unsafe { self.lock_if_favoured(me) } {
                std::mem::forget(inside);
                return self.guard(Held::Inside(me));
            }
            if let Some(uses) = self.lock_shared(me) {
                return self.guard(Held::Shared(uses));
            }
        }
    }

    #[inline]
    fn guard<'a>(&'a self, held: Held<'a>) -> BiasedGuard<'a, T> {
        BiasedGuard {
            lock: self,
            held,
            stays_on_its_thread: PhantomData,
        }
    }

    /// Locks among all. `None`: home `me` is favoured again, whose favour was borrowed meanwhile.
    #[inline(never)]
    fn lock_shared(&self, me: u64) -> Option<PiGuard<'_, Uses>> {
        // Whoever ends the favour meanwhile waits for a section of this thread under `shared`: it would wait for itself.
        self.inside.assert_not_here();
        let mut uses = self.shared.lock();
        let favoured = self.favoured.load(Ordering::Relaxed);
        if favoured == NOBODY {
            uses.count(me);
        } else if favoured == me {
            return None;
        } else {
            self.exclude_home();
            uses.is_shared_for_good = true;
        }
        Some(uses)
    }

    /// The home of that number leaves.
    #[inline(always)]
    fn leave(&self, home: u64) {
        self.inside.leave();
        fence::light();
        if self.favoured.load(Ordering::Relaxed) != home {
            self.inside.leave_revoked();
        }
    }

    /// Favours the home that has used the lock alone for long, if that can be. The caller holds `shared`, and its section is over: its thread is the home,
    /// so nobody is inside at the same time.
    #[cold]
    fn favour(&self, uses: &mut Uses) {
        if fence::is_available() {
            uses.in_a_row = 0;
            self.favoured.store(uses.home, Ordering::Release);
        } else {
            uses.is_shared_for_good = true;
        }
    }

    /// Ends the favour, and waits until the home is outside. The caller holds `shared`.
    #[cold]
    fn exclude_home(&self) {
        /// If one of the steps panics the home is not excluded, so it is favoured again before `shared` is released.
        struct Restore<'a>(&'a AtomicU64, u64);
        impl Drop for Restore<'_> {
            fn drop(&mut self) {
                self.0.store(self.1, Ordering::Release);
            }
        }
        let restore = Restore(&self.favoured, self.favoured.swap(NOBODY, Ordering::SeqCst));
        fence::heavy();
        self.inside.wait_until_left();
        std::mem::forget(restore);
    }
}

impl<T> Drop for BiasedGuard<'_, T> {
    #[inline(always)]
    fn drop(&mut self) {
        match &mut self.held {
            Held::Inside(home) => self.lock.leave(*home),
            // Before `shared` is released.
            Held::Shared(uses) if uses.earn_favour() => self.lock.favour(uses),
            Held::Shared(_) => {}
        }
    }
}

/// The guard of a look: see [`BiasedLock::lock_briefly`].
#[must_use = "the lock is released when the guard is dropped"]
pub struct BriefGuard<'a, T>(Brief<'a, T>);

enum Brief<'a, T> {
    Locked(BiasedGuard<'a, T>),
    /// The home of that number is favoured again afterwards.
    Borrowed {
        lock: &'a BiasedLock<T>,
        _uses: PiGuard<'a, Uses>,
        home: u64,
    },
}

impl<T> Drop for BriefGuard<'_, T> {
    fn drop(&mut self) {
        // Before `shared` is released.
        if let Brief::Borrowed { lock, home, .. } = &self.0 {
            lock.favoured.store(*home, Ordering::Release);
        }
    }
}

impl<T> Deref for BriefGuard<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        match &self.0 {
            Brief::Locked(guard) => guard,
            // SAFETY: this guard exists, so by the lock's invariant this thread has access.
            Brief::Borrowed { lock, .. } => lock.value.with(|value| unsafe { &*value }),
        }
    }
}

impl<T> DerefMut for BriefGuard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        match &mut self.0 {
            Brief::Locked(guard) => guard,
            // SAFETY: as above, and the guard is borrowed exclusively.
            Brief::Borrowed { lock, .. } => lock.value.with_mut(|value| unsafe { &mut *value }),
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for BriefGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// The guard of the favoured home: see [`BiasedLock::lock_if_favoured`].
#[must_use = "the lock is released when the guard is dropped"]
pub struct InsideGuard<'a, T> {
    lock: &'a BiasedLock<T>,
    home: u64,
    stays_on_its_thread: PhantomData<*const ()>,
}

impl<T> InsideGuard<'_, T> {
    /// Keeps the lock: [`BiasedLock::kept`] gives the guard again.
    #[inline(always)]
    pub fn keep(self) {
        std::mem::forget(self);
    }
}

impl<T> Drop for InsideGuard<'_, T> {
    #[inline(always)]
    fn drop(&mut self) {
        self.lock.leave(self.home);
    }
}

impl<T> Deref for InsideGuard<'_, T> {
    type Target = T;
    #[inline(always)]
    fn deref(&self) -> &T {
        // SAFETY: this guard exists, so by the lock's invariant this thread has access.
        self.lock.value.with(|value| unsafe { &*value })
    }
}

impl<T> DerefMut for InsideGuard<'_, T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as above, and the guard is borrowed exclusively.
        self.lock.value.with_mut(|value| unsafe { &mut *value })
    }
}

impl<T: fmt::Debug> fmt::Debug for InsideGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

impl<T> Deref for BiasedGuard<'_, T> {
    type Target = T;
    #[inline]
    fn deref(&self) -> &T {
        // SAFETY: this guard exists, so by the lock's invariant this thread has access.
        self.lock.value.with(|value| unsafe { &*value })
    }
}

impl<T> DerefMut for BiasedGuard<'_, T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: as above, and the guard is borrowed exclusively.
        self.lock.value.with_mut(|value| unsafe { &mut *value })
    }
}

impl<T> fmt::Debug for BiasedLock<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("BiasedLock")
            .field("is_favouring", &self.is_favouring())
            .finish_non_exhaustive()
    }
}

impl<T: fmt::Debug> fmt::Debug for BiasedGuard<'_, T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests;

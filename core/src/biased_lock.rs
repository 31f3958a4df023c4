//! A biased lock: the executor that alone uses it needs no atomic read-modify-write. It guards
//! channels, select states, timer queues and the shown state of processes.
//!
//! Most channels connect processes of one executor. One thread takes their lock every time, and two
//! compare-and-swaps an operation would be most of the cost of a communication. A lock that one
//! executor has taken many times in a row therefore becomes *biased* to it. From then on the thread
//! of that executor marks itself as inside by plain stores. Any other thread must first revoke the
//! bias. After that the lock is never biased again; only `lock_briefly` restores the bias.
//!
//! ```text
//!   shared --16 times in a row by one executor--> biased --by another thread--> shared, for good
//!     \                                            ^  \
//!      by a second executor: shared, for good       '---' `lock_briefly`: revoked and restored
//! ```
//!
//! # Mutual exclusion
//!
//! ```text
//!   owner of the bias, each time         another thread, to revoke
//!   inside = 1                           (holds `shared`)
//!   -- light fence --                    bias = none
//!   bias is me? in : out                 -- heavy fence --
//!   ...                                  waits while inside = 1
//!   inside = 0
//!   -- light fence --
//!   bias is me? done : repair
//! ```
//!
//! This is Dekker's pattern: if both sides have a full fence between store and load, at least one
//! of them sees the other's store. The light fence keeps only the compiler from reordering. The
//! heavy one, `membarrier(2)`, makes every running thread of the program execute a full fence, so
//! the owner has executed one whenever it matters (asymmetric fences: P1202; biased locks: D. Dice,
//! H. Huang, M. Yang, *Asymmetric Dekker Synchronization*, 2001).
//!
//! The fences give order, not exclusion: a thread that finds the owner inside has to wait. It waits
//! with priority inheritance: `inside` is the word of a priority-inheriting futex, and the owner
//! writes its thread id there, so the kernel knows which thread to boost. The owner's plain store
//! on leaving may erase the kernel's mark that a thread waits. Hence the second read of `bias`, and
//! the repair (`Inside::leave_revoked`).
//!
//! The loom models use full fences on both sides, which is the effect of the pair in the kernel.

mod guards;

pub use guards::{BiasedGuard, Guard, InsideGuard, Refused};

use crate::current::{self, Here, PlainTurn};
use core::marker::PhantomData;
use guards::{ByAny, ByOwner, Hold};
use luna_platform::fence;
use luna_platform::inside::Inside;
use luna_platform::lock::PiLock;
use luna_platform::on_drop::OnDrop;
use luna_platform::sync::UnsafeCell;
use luna_platform::sync::atomic::{AtomicU64, Ordering};

/// Uses in a row by one executor after which the lock becomes biased to it.
const ALONE: u8 = 16;

/// The threshold of this program; see [`bias_after`].
static USES_ALONE: core::sync::atomic::AtomicU8 = core::sync::atomic::AtomicU8::new(ALONE);

/// Sets the number of uses after which a lock becomes biased. For tests that are shorter than the
/// default threshold.
#[doc(hidden)]
pub fn bias_after(uses: u8) {
    USES_ALONE.store(uses, core::sync::atomic::Ordering::Relaxed);
}

#[inline]
fn uses_alone() -> u8 {
    USES_ALONE.load(core::sync::atomic::Ordering::Relaxed)
}

/// No bias; no executor has this id.
const NO_EXECUTOR: u64 = u64::MAX;

/// A lock that costs the owner of its bias no read-modify-write, and every other thread as much as
/// a [`PiLock`].
///
/// Real-time path: yes. For the owner of the bias O(1), a few loads and stores; shared, as for
/// `PiLock`. The first use by another thread while the lock is biased makes one system call
/// (`membarrier(2)`, some microseconds; it interrupts the processors that run threads of this
/// program). It also waits for a critical section of the owner that is under way, with priority
/// inheritance. After that the lock is never biased again.
/// [`lock_briefly`](BiasedLock::lock_briefly) costs that each time, and restores the bias.
///
/// # Panics
///
/// `lock` panics if the calling thread holds the lock already.
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
/// Once other threads know the lock, only the holder of `shared` changes `bias`. It is granted to
/// an executor on that executor's thread. It is revoked, and after a brief or failed revocation
/// restored, on any thread. All its life the lock is biased to one executor at most: the first bias
/// is granted only if no second executor has used the lock, and a revocation either restores that
/// bias or sets `is_shared_for_good`, after which none is granted. Two kinds of thread access
/// `value`: the holder of `shared`, while there is no bias and `inside` is free after the heavy
/// fence; and the owner of the bias, while it holds `inside`.
#[repr(C)]
pub struct BiasedLock<T> {
    bias: AtomicU64,
    inside: Inside,
    shared: PiLock<Uses>,
    value: UnsafeCell<T>,
}

// The guarded value begins on the cache line of the lock's words. Channels rely on the space that
// is left there.
#[cfg(all(feature = "std", target_os = "linux", not(luna_portable), not(loom)))]
const _: () = assert!(core::mem::offset_of!(BiasedLock<u64>, value) == 32);

// SAFETY: the lock gives access to one thread at a time, so it may be shared if the value may move
// between threads.
unsafe impl<T: Send> Sync for BiasedLock<T> {}
// SAFETY: a lock that is moved is not borrowed, so no guard exists; it is as `Send` as its value.
unsafe impl<T: Send> Send for BiasedLock<T> {}

/// The recent users of the lock in shared mode. Packed, so that the lock's word lies beside
/// `inside` and more of the cache line is left for the guarded value.
#[derive(Debug, Clone, Copy)]
#[repr(C, packed(4))]
struct Uses {
    /// The executor that used it last.
    executor: u64,
    in_a_row: u8,
    /// The bias was revoked, or two executors have used the lock: it is never biased again.
    is_shared_for_good: bool,
}

impl Uses {
    #[inline]
    fn count(&mut self, executor: u64) {
        if executor == 0 {
            // A plain thread: it may have used the lock while the system was set up.
            self.in_a_row = 0;
            return;
        }
        if self.executor != executor {
            // A second executor uses the lock: more of the same is expected.
            self.is_shared_for_good |= self.executor != NO_EXECUTOR;
            self.executor = executor;
            self.in_a_row = 0;
        }
        self.in_a_row = self.in_a_row.saturating_add(1);
    }

    #[inline]
    fn earn_bias(&self) -> bool {
        self.in_a_row >= uses_alone() && !self.is_shared_for_good
    }
}

impl<T> BiasedLock<T> {
    /// An unlocked lock around `value`, without a bias.
    pub fn new(value: T) -> Self {
        Self {
            bias: AtomicU64::new(NO_EXECUTOR),
            inside: Inside::new(),
            shared: PiLock::new(Uses {
                executor: NO_EXECUTOR,
                in_a_row: 0,
                is_shared_for_good: false,
            }),
            value: UnsafeCell::new(value),
        }
    }

    /// An unlocked lock around `value`, biased from the start to the executor of the calling
    /// thread, if it is one. For a thing that is used on this executor, and seldom elsewhere.
    #[inline(always)]
    pub fn biased_in(here: Here<'_>, value: T) -> Self {
        let executor = match here.executor_number() {
            0 => NO_EXECUTOR,
            executor if fence::is_available() => executor,
            _ => NO_EXECUTOR,
        };
        Self {
            bias: AtomicU64::new(executor),
            ..Self::new(value)
        }
    }

    /// Locks. Waits while another thread holds it.
    #[inline]
    pub fn lock(&self) -> BiasedGuard<'_, T> {
        self.lock_in(Here::now())
    }

    /// Locks, in whichever way the calling thread can: as the owner of the bias by plain stores.
    #[inline(always)]
    pub fn lock_in(&self, here: Here<'_>) -> BiasedGuard<'_, T> {
        self.guard(match self.enter_in(here) {
            Some(inside) => inside.into_any(),
            // SAFETY: as in `enter_in`.
            None => unsafe { self.hold_as(here.executor_number(), here.thread_id()) },
        })
    }

    /// Locks, if the lock is biased to the executor of this thread, which is not inside already:
    /// without any atomic read-modify-write.
    #[inline(always)]
    pub fn enter_in(&self, here: Here<'_>) -> Option<InsideGuard<'_, T>> {
        // SAFETY: both are those of the calling thread.
        unsafe { self.enter_as(here.executor_number(), here.thread_id()) }
    }

    /// # Safety
    ///
    /// The calling thread has this id, and is that of the executor with the number `me`; or the
    /// number is 0, to which no lock is biased.
    #[inline(always)]
    unsafe fn enter_as(&self, me: u64, thread_id: u32) -> Option<InsideGuard<'_, T>> {
        // Acquire, here and below: pairs with the store that restores the bias, so that the owner
        // sees what was done during a brief revocation.
        if self.bias.load(Ordering::Acquire) != me || self.inside.is_entered() {
            return None;
        }
        // SAFETY: it is the id of the calling thread, which is not inside: only the thread of the
        // executor that owns the bias could be, and it would have been seen.
        unsafe { self.inside.enter_unchecked(thread_id) };
        fence::light();
        if self.bias.load(Ordering::Acquire) == me {
            return Some(self.guard(ByOwner(me)));
        }
        self.leave_at_once();
        None
    }

    #[cold]
    #[inline(never)]
    fn leave_at_once(&self) {
        self.inside.leave();
        self.inside.leave_revoked();
    }

    /// Locks if the lock is biased to the executor of this turn, without any atomic
    /// read-modify-write. For a critical section that runs no user code and waits for no other
    /// lock: it is not checked whether the thread holds the lock already.
    ///
    /// # Safety
    ///
    /// The calling thread does not hold the lock.
    #[inline(always)]
    pub unsafe fn enter_trusted(&self, turn: PlainTurn<'_>) -> Result<InsideGuard<'_, T>, Refused> {
        let executor = self.bias.load(Ordering::Acquire);
        if executor != turn.executor_number() {
            return Err(Refused::NotBiased);
        }
        // SAFETY: a turn is that of the calling thread, and so is its thread id. The caller
        // promises that the thread does not hold this lock, so it is not inside. Only the owner of
        // the bias gets here: any other thread would overwrite the mark of the owner.
        unsafe { self.inside.enter_unchecked(turn.thread_id()) };
        fence::light();
        if self.bias.load(Ordering::Acquire) == executor {
            return Ok(self.guard(ByOwner(executor)));
        }
        self.inside.leave();
        Err(Refused::Revoked)
    }

    /// Ends the critical section of the owner that has left and found the bias revoked.
    #[cold]
    #[inline(never)]
    pub fn after_revocation(&self) {
        self.inside.leave_revoked();
    }

    /// The guard that was [kept](InsideGuard::keep).
    ///
    /// # Safety
    ///
    /// The calling thread has kept a guard of this lock, and has not called this since.
    #[inline(always)]
    pub unsafe fn kept(&self, turn: PlainTurn<'_>) -> InsideGuard<'_, T> {
        self.guard(ByOwner(turn.executor_number()))
    }

    /// Locks as [`lock`](Self::lock) does, for an occasional inspection: a bias is restored
    /// afterwards. Not for regular use of the value.
    pub fn lock_briefly(&self) -> BiasedGuard<'_, T> {
        let me = current::executor_number();
        if self.bias.load(Ordering::Relaxed) == me {
            return self.lock();
        }
        self.inside.assert_not_here();
        let uses = self.shared.lock();
        let executor = self.bias.load(Ordering::Relaxed);
        if executor == NO_EXECUTOR {
            return self.guard(ByAny::shared(uses));
        }
        self.revoke_bias();
        self.guard(ByAny::revoked(uses, executor))
    }

    /// Whether this is the value that it guards.
    #[inline(always)]
    pub fn guards(&self, value: &T) -> bool {
        self.value.with(|own| core::ptr::eq(own, value))
    }

    /// Whether the lock is biased.
    pub fn is_biased(&self) -> bool {
        self.bias.load(Ordering::Relaxed) != NO_EXECUTOR
    }

    /// The value, without locking: the exclusive borrow shows that no guard exists.
    pub fn with_mut<R>(&mut self, f: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: `self` is borrowed exclusively, so no guard exists and no other thread accesses
        // the value.
        self.value.with_mut(|value| f(unsafe { &mut *value }))
    }

    /// Locks as on the thread of executor `me`.
    #[cfg(all(test, loom))]
    fn lock_as(&self, me: u64) -> BiasedGuard<'_, T> {
        let thread_id = Inside::id_of_this_thread();
        // SAFETY: the models' threads each pass an executor of their own, or 0.
        self.guard(unsafe {
            match self.enter_as(me, thread_id) {
                Some(inside) => inside.into_any(),
                None => self.hold_as(me, thread_id),
            }
        })
    }

    #[inline(always)]
    fn guard<H: Hold>(&self, hold: H) -> Guard<'_, T, H> {
        Guard {
            lock: self,
            hold,
            stays_on_its_thread: PhantomData,
        }
    }

    /// Locks in shared mode, or inside, if the bias to `me` was revoked briefly and has been
    /// restored meanwhile.
    ///
    /// # Safety
    ///
    /// As for [`enter_as`](Self::enter_as).
    #[inline(never)]
    unsafe fn hold_as(&self, me: u64, thread_id: u32) -> ByAny<'_> {
        loop {
            // A thread that revokes the bias holds `shared` and waits for the critical section of
            // this thread: blocking on `shared` inside it would deadlock.
            self.inside.assert_not_here();
            let mut uses = self.shared.lock();
            let bias = self.bias.load(Ordering::Relaxed);
            if bias == NO_EXECUTOR {
                uses.count(me);
            } else if bias != me {
                self.revoke_bias();
                uses.is_shared_for_good = true;
            } else {
                drop(uses);
                // SAFETY: as is demanded here.
                match unsafe { self.enter_as(me, thread_id) } {
                    Some(inside) => return inside.into_any(),
                    None => continue,
                }
            }
            return ByAny::shared(uses);
        }
    }

    /// Ends the critical section of the executor with the number `executor`.
    #[inline(always)]
    fn leave(&self, executor: u64) {
        self.inside.leave();
        fence::light();
        if self.bias.load(Ordering::Relaxed) != executor {
            self.inside.leave_revoked();
        }
    }

    /// Biases the lock to the executor that alone has used it for long, if possible. The caller
    /// holds `shared`, and its critical section is over. Its thread is that of the executor, so the
    /// executor is not inside at the same time.
    #[cold]
    fn grant_bias(&self, uses: &mut Uses) {
        if fence::is_available() {
            uses.in_a_row = 0;
            self.bias.store(uses.executor, Ordering::Release);
        } else {
            uses.is_shared_for_good = true;
        }
    }

    /// Revokes the bias, and waits until its owner is outside. The caller holds `shared`.
    #[cold]
    fn revoke_bias(&self) {
        let before = self.bias.swap(NO_EXECUTOR, Ordering::SeqCst);
        // If one of the steps panics, the bias is restored before `shared` is released: the owner
        // has not been excluded then.
        let restore = OnDrop::new(|| self.bias.store(before, Ordering::Release));
        fence::heavy();
        self.inside.wait_until_left();
        core::mem::forget(restore);
    }
}

luna_platform::debug_fields!(impl[T] BiasedLock<T>, |lock| is_biased: lock.is_biased());

#[cfg(test)]
mod tests;

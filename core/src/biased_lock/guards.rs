//! The guards of a biased lock.

use super::{BiasedLock, Uses};
use core::marker::PhantomData;
use core::mem::MaybeUninit;
use core::ops::{Deref, DerefMut};
use luna_platform::fence;
use luna_platform::lock::PiGuard;
use luna_platform::sync::atomic::Ordering;

/// Unlocks when dropped. Not `Send`: it stays on the thread that locked. At most two words beside
/// the lock, so that one that is taken and dropped in one function lies in registers.
#[must_use = "the lock is released when the guard is dropped"]
pub struct Guard<'a, T, H: Hold> {
    pub(super) lock: &'a BiasedLock<T>,
    pub(super) hold: H,
    pub(super) stays_on_its_thread: PhantomData<*const ()>,
}

/// The guard of whichever thread has locked.
pub type BiasedGuard<'a, T> = Guard<'a, T, ByAny<'a>>;

/// The guard of the owner of the bias: see [`BiasedLock::enter_in`].
pub type InsideGuard<'a, T> = Guard<'a, T, ByOwner>;

/// How a lock is held.
pub trait Hold {
    /// Releases `lock`, once.
    fn release<T>(&mut self, lock: &BiasedLock<T>);
}

/// The owner of the bias is inside: its executor's number.
#[derive(Debug)]
pub struct ByOwner(pub(super) u64);

impl Hold for ByOwner {
    #[inline(always)]
    fn release<T>(&mut self, lock: &BiasedLock<T>) {
        lock.leave(self.0);
    }
}

/// By the owner of the bias, or by another thread.
///
/// # Invariants
///
/// `uses` is there unless the owner of the bias is inside.
#[derive(Debug)]
pub struct ByAny<'a> {
    /// Of the owner of the bias, which is inside: its executor's number. 0: locked in shared mode.
    /// With `BRIEFLY`: the bias was revoked, and is restored to the executor of this number.
    executor: u64,
    uses: MaybeUninit<PiGuard<'a, Uses>>,
}

/// No executor's number has this bit.
const BRIEFLY: u64 = 1 << 63;

impl<'a> ByAny<'a> {
    pub(super) fn shared(uses: PiGuard<'a, Uses>) -> Self {
        Self {
            executor: 0,
            uses: MaybeUninit::new(uses),
        }
    }

    pub(super) fn revoked(uses: PiGuard<'a, Uses>, executor: u64) -> Self {
        Self {
            executor: executor | BRIEFLY,
            uses: MaybeUninit::new(uses),
        }
    }
}

impl Hold for ByAny<'_> {
    #[inline(always)]
    fn release<T>(&mut self, lock: &BiasedLock<T>) {
        if self.executor.cast_signed() > 0 {
            return lock.leave(self.executor);
        }
        // SAFETY: by the invariant it is there; it is read once, since a guard releases once.
        let uses = unsafe { self.uses.assume_init_read() };
        lock.unlock_otherwise(self.executor, uses);
    }
}

impl<T, H: Hold> Drop for Guard<'_, T, H> {
    #[inline(always)]
    fn drop(&mut self) {
        self.hold.release(self.lock);
    }
}

impl<T, H: Hold> Deref for Guard<'_, T, H> {
    type Target = T;
    #[inline(always)]
    fn deref(&self) -> &T {
        // SAFETY: this guard exists, so by the lock's invariant this thread has access.
        self.lock.value.with(|value| unsafe { &*value })
    }
}

impl<T, H: Hold> DerefMut for Guard<'_, T, H> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: this guard exists, so by the lock's invariant this thread alone has access; the
        // exclusive borrow of the guard excludes a second borrow of the value through it.
        self.lock.value.with_mut(|value| unsafe { &mut *value })
    }
}

luna_platform::debug_fields!(impl[T, H: Hold] Guard<'_, T, H>, |guard| lock: guard.lock);

impl<T> BiasedLock<T> {
    #[cold]
    #[inline(never)]
    fn unlock_otherwise(&self, executor: u64, mut uses: PiGuard<'_, Uses>) {
        // Before `shared` is released.
        if executor != 0 {
            self.bias.store(executor & !BRIEFLY, Ordering::Release);
        } else if uses.earn_bias() {
            self.grant_bias(&mut uses);
        }
    }
}

/// Why the owner of the bias could not [enter](BiasedLock::enter_trusted).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refused {
    /// The lock is not biased to this executor.
    NotBiased,
    /// The bias was revoked at this moment: [`BiasedLock::after_revocation`] is to be called.
    Revoked,
}

impl<'a, T> InsideGuard<'a, T> {
    /// Leaves; `false` if the bias was revoked meanwhile: then the caller calls
    /// [`BiasedLock::after_revocation`]. For a caller that is to end by that call.
    #[inline(always)]
    #[must_use = "a thread that has revoked the bias may wait"]
    pub fn leave(self) -> bool {
        self.lock.inside.leave();
        fence::light();
        let is_biased = self.lock.bias.load(Ordering::Relaxed) == self.hold.0;
        core::mem::forget(self);
        is_biased
    }

    /// As a guard of either kind.
    #[inline(always)]
    pub(super) fn into_any(self) -> ByAny<'a> {
        let executor = self.hold.0;
        core::mem::forget(self);
        ByAny {
            executor,
            uses: MaybeUninit::uninit(),
        }
    }

    /// Leaves the lock locked: [`BiasedLock::kept`] returns the guard again.
    #[inline(always)]
    pub fn keep(self) {
        core::mem::forget(self);
    }
}

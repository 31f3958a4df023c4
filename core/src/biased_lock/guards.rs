//! The guards of a biased lock.

use super::{BiasedLock, Uses};
use core::marker::PhantomData;
use core::mem::MaybeUninit;
use core::ops::{Deref, DerefMut};
use luna_platform::fence;
use luna_platform::lock::PiGuard;
use luna_platform::sync::atomic::Ordering;

/// Unlocks when dropped. Not `Send`: it stays on the thread that locked. Two words beside the lock,
/// so that one that is taken and dropped in one function lies in registers.
#[must_use = "the lock is released when the guard is dropped"]
pub struct BiasedGuard<'a, T> {
    pub(super) lock: &'a BiasedLock<T>,
    pub(super) held: Held<'a>,
    pub(super) stays_on_its_thread: PhantomData<*const ()>,
}

luna_platform::debug_fields!(impl[T] BiasedGuard<'_, T>, |guard| lock: guard.lock);

/// How a lock is held.
///
/// # Invariants
///
/// `uses` is there unless the owner of the bias is inside.
pub(super) struct Held<'a> {
    /// Of the owner of the bias, which is inside: its executor's number. 0: locked in shared mode.
    /// With `BRIEFLY`: the bias was revoked, and is restored to the executor of this number.
    executor: u64,
    uses: MaybeUninit<PiGuard<'a, Uses>>,
}

/// No executor's number has this bit.
const BRIEFLY: u64 = 1 << 63;

impl<'a> Held<'a> {
    #[inline(always)]
    pub(super) fn inside(executor: u64) -> Self {
        Self {
            executor,
            uses: MaybeUninit::uninit(),
        }
    }

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

    #[inline(always)]
    fn is_inside(&self) -> bool {
        self.executor.cast_signed() > 0
    }
}

impl<T> Drop for BiasedGuard<'_, T> {
    #[inline(always)]
    fn drop(&mut self) {
        if self.held.is_inside() {
            return self.lock.leave(self.held.executor);
        }
        // SAFETY: by the invariant it is there; it is read once, since this is the drop.
        let uses = unsafe { self.held.uses.assume_init_read() };
        self.lock.unlock_otherwise(self.held.executor, uses);
    }
}

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

/// The guard of the owner of the bias: see [`BiasedLock::enter_trusted`].
#[derive(Debug)]
#[must_use = "the lock is released when the guard is dropped"]
pub struct InsideGuard<'a, T> {
    pub(super) lock: &'a BiasedLock<T>,
    pub(super) executor: u64,
    pub(super) stays_on_its_thread: PhantomData<*const ()>,
}

impl<'a, T> InsideGuard<'a, T> {
    /// Leaves; `false` if the bias was revoked meanwhile: then the caller calls
    /// [`BiasedLock::after_revocation`]. For a caller that is to end by that call.
    #[inline(always)]
    #[must_use = "a thread that has revoked the bias may wait"]
    pub fn leave(self) -> bool {
        self.lock.inside.leave();
        fence::light();
        let is_biased = self.lock.bias.load(Ordering::Relaxed) == self.executor;
        core::mem::forget(self);
        is_biased
    }

    /// As a guard of either kind.
    #[inline(always)]
    pub(super) fn held(self) -> Held<'a> {
        let held = Held::inside(self.executor);
        core::mem::forget(self);
        held
    }

    /// Leaves the lock locked: [`BiasedLock::kept`] returns the guard again.
    #[inline(always)]
    pub fn keep(self) {
        core::mem::forget(self);
    }
}

impl<T> Drop for InsideGuard<'_, T> {
    #[inline(always)]
    fn drop(&mut self) {
        self.lock.leave(self.executor);
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
        // SAFETY: this guard exists, so by the lock's invariant this thread alone has access; the
        // exclusive borrow of the guard excludes a second borrow of the value through it.
        self.lock.value.with_mut(|value| unsafe { &mut *value })
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
        // SAFETY: this guard exists, so by the lock's invariant this thread alone has access; the
        // exclusive borrow of the guard excludes a second borrow of the value through it.
        self.lock.value.with_mut(|value| unsafe { &mut *value })
    }
}

//! The guards of a biased lock.

use super::{BiasedLock, Uses};
use core::marker::PhantomData;
use core::ops::{Deref, DerefMut};
use luna_platform::fence;
use luna_platform::lock::PiGuard;
use luna_platform::sync::atomic::Ordering;

/// Unlocks when dropped. Not `Send`: it stays on the thread that locked.
#[derive(Debug)]
#[must_use = "the lock is released when the guard is dropped"]
pub struct BiasedGuard<'a, T> {
    pub(super) lock: &'a BiasedLock<T>,
    pub(super) held: Held<'a>,
    pub(super) stays_on_its_thread: PhantomData<*const ()>,
}

#[derive(Debug)]
pub(super) enum Held<'a> {
    /// Locked by the owner of the bias, the executor of this id.
    Inside(u64),
    Shared(PiGuard<'a, Uses>),
    /// Locked briefly: the bias was revoked, and is restored to the executor of this id.
    Revoked {
        _uses: PiGuard<'a, Uses>,
        executor: u64,
    },
}

impl<T> Drop for BiasedGuard<'_, T> {
    #[inline(always)]
    fn drop(&mut self) {
        match &mut self.held {
            Held::Inside(executor) => self.lock.leave(*executor),
            // Before `shared` is released.
            Held::Shared(uses) if uses.earn_bias() => self.lock.grant_bias(uses),
            Held::Shared(_) => {}
            Held::Revoked { executor, .. } => self.lock.bias.store(*executor, Ordering::Release),
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

impl<T> InsideGuard<'_, T> {
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

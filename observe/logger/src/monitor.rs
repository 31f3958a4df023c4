//! State shared by two threads, each of which waits for changes made by the other.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A state under a lock, with a condition for its changes. No user code runs under the lock, so a
/// panic leaves the state consistent.
#[derive(Debug, Default)]
pub(crate) struct Monitor<T> {
    state: Mutex<T>,
    changes: Condvar,
}

impl<T> Monitor<T> {
    pub(crate) fn lock(&self) -> MutexGuard<'_, T> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and wakes the waiting threads.
    pub(crate) fn change<R>(&self, change: impl FnOnce(&mut T) -> R) -> R {
        let result = change(&mut self.lock());
        self.wake();
        result
    }

    /// Wakes the waiting threads, after a change under the lock.
    pub(crate) fn wake(&self) {
        self.changes.notify_all();
    }

    /// Waits for a change, or until `most` has passed.
    pub(crate) fn wait<'a>(&self, state: MutexGuard<'a, T>, most: Duration) -> MutexGuard<'a, T> {
        let waited = self.changes.wait_timeout(state, most);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }

    /// Waits while the state is so.
    pub(crate) fn wait_while<'a>(
        &self,
        state: MutexGuard<'a, T>,
        is_so: impl FnMut(&mut T) -> bool,
    ) -> MutexGuard<'a, T> {
        let waited = self.changes.wait_while(state, is_so);
        waited.unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits while the condition holds, at most `limit`.
    pub(crate) fn wait_while_within<'a>(
        &self,
        state: MutexGuard<'a, T>,
        limit: Duration,
        is_so: impl FnMut(&mut T) -> bool,
    ) -> MutexGuard<'a, T> {
        let waited = self.changes.wait_timeout_while(state, limit, is_so);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

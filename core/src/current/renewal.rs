//! How a wake handle comes into a node without user code under the node's lock: see the rule at the
//! head of [`wake_handle`](super::wake_handle).

use super::WakeHandle;
use core::task::Context;

/// A wake handle on its way into the node of a waiting operation. It is made without the lock that
/// guards the node. A handle that is left over is dropped with this: declare it first, so that the
/// drop is the caller's last step.
///
/// ```
/// use luna_core::current::{Renewal, WakeHandle};
/// use luna_platform::lock::PiLock;
/// use std::task::{Context, Waker};
///
/// let stored: PiLock<Option<WakeHandle>> = PiLock::new(None);
/// let cx = Context::from_waker(Waker::noop());
/// let mut renewal = Renewal::of(&cx);
/// renewal.put(|renewal| renewal.store(&mut stored.lock()));
/// assert!(stored.lock().as_ref().unwrap().is_of(&cx));
/// ```
#[derive(Debug)]
#[must_use = "nothing is stored until `put` is called"]
pub struct Renewal<'a, 'b> {
    cx: &'a Context<'b>,
    /// The handle to be stored, or the one that was stored before.
    handle: Option<WakeHandle>,
    is_missing: bool,
}

impl<'a, 'b> Renewal<'a, 'b> {
    /// No waker is cloned until it is known to be needed.
    #[inline]
    pub fn of(cx: &'a Context<'b>) -> Self {
        Self {
            cx,
            handle: None,
            is_missing: false,
        }
    }

    /// For a node that has no handle: a waker is cloned now.
    pub fn made(cx: &'a Context<'b>) -> Self {
        Self {
            handle: Some(WakeHandle::of(cx)),
            ..Self::of(cx)
        }
    }

    /// Calls `locked`, which takes the lock, checks whether the operation waits, and
    /// [stores](Self::store) or [takes](Self::take) the handle if so. It is called a second time if
    /// a waker has to be cloned in between. Returns the result of the last call.
    #[inline]
    pub fn put<R>(&mut self, mut locked: impl FnMut(&mut Self) -> R) -> R {
        // One call of the closure in the code, so that it is inlined.
        loop {
            let result = locked(self);
            if !self.is_missing {
                return result;
            }
            self.make();
        }
    }

    #[cold]
    fn make(&mut self) {
        self.is_missing = false;
        self.handle = Some(WakeHandle::of(self.cx));
    }

    /// Makes `stored` wake the task of the context. Called under the lock that guards it.
    #[inline]
    pub fn store(&mut self, stored: &mut Option<WakeHandle>) {
        if stored.as_ref().is_some_and(|stored| stored.is_of(self.cx)) {
            return;
        }
        if let Some(handle) = self.take() {
            self.handle = stored.replace(handle);
        }
    }

    /// The handle, for a node that is about to be listed. With `None` the caller lists nothing and
    /// returns: it is called again.
    #[inline]
    pub fn take(&mut self) -> Option<WakeHandle> {
        let handle = self.handle.take();
        let handle = handle.or_else(|| WakeHandle::without_waker(self.cx));
        self.is_missing = handle.is_none();
        handle
    }
}

//! Steps that are also done while a panic of user code unwinds.

use core::mem;

/// Calls a function when it is dropped: for what must follow user code (a wake, a drop), however
/// that ends. The rule stands at the head of [`luna_core::current::WakeHandle`]'s module.
#[must_use = "the step is done when this is dropped"]
pub(crate) struct Finally<F: FnMut()>(F);

impl<F: FnMut()> Finally<F> {
    pub(crate) fn new(step: F) -> Self {
        Self(step)
    }

    /// No panic came: the step is the caller's.
    #[inline]
    pub(crate) fn cancel(self) {
        mem::forget(self);
    }
}

impl<F: FnMut()> Drop for Finally<F> {
    #[inline]
    fn drop(&mut self) {
        (self.0)();
    }
}

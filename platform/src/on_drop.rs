//! A closure that runs at the end of a scope, also if a panic unwinds it.

use core::fmt;
use core::marker::PhantomData;

/// Runs its closure when it is dropped, on the thread that made it.
///
/// ```
/// use luna_platform::on_drop::OnDrop;
/// use std::cell::Cell;
///
/// let is_inside = Cell::new(true);
/// drop(OnDrop::new(|| is_inside.set(false)));
/// assert!(!is_inside.get());
/// ```
#[must_use = "the scope ends when it is dropped"]
pub struct OnDrop<F: FnMut()> {
    end: F,
    stays_on_its_thread: PhantomData<*const ()>,
}

impl<F: FnMut()> OnDrop<F> {
    /// A scope that ends with `end`.
    #[inline]
    pub fn new(end: F) -> Self {
        Self {
            end,
            stays_on_its_thread: PhantomData,
        }
    }
}

impl<F: FnMut()> Drop for OnDrop<F> {
    #[inline]
    fn drop(&mut self) {
        (self.end)();
    }
}

impl<F: FnMut()> fmt::Debug for OnDrop<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("OnDrop")
    }
}

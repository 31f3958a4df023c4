//! Access to the fields of a pinned value, where its own code moves nothing that must stay.

use core::pin::Pin;

/// A type of which no code moves a part that is pinned with the whole.
///
/// # Safety
///
/// Code of the type's own folder alone calls [`in_place`](Self::in_place). With the reference it
/// moves or replaces neither the whole nor the fields that must stay in their places, and hands it
/// to no other code that could. Review each new call for this.
pub(crate) unsafe trait InPlace: Sized {
    /// The fields of one that is pinned.
    #[inline(always)]
    fn in_place(self: Pin<&mut Self>) -> &mut Self {
        // SAFETY: by the trait's promise nothing that is pinned is moved by this reference.
        unsafe { self.get_unchecked_mut() }
    }
}

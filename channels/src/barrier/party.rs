//! A party by enrollment.

use super::{Barrier, SyncOp};

/// One party of a barrier, until it is dropped: see [`Barrier::enroll`].
///
/// A process that ends, fails or panics takes its party with it, so that the others do not wait for
/// it for ever. Dropping it is O(1), and O(parties) if that completes the round.
///
/// ```
/// use luna_channels::Barrier;
/// # luna_core::block_on(async {
/// let barrier = Barrier::new(0);
/// let party = barrier.enroll();
/// party.sync().await; // alone
/// drop(party);
/// assert_eq!(barrier.parties(), 0);
/// # }).unwrap();
/// ```
#[derive(Debug)]
#[must_use = "the party resigns when this is dropped"]
pub struct Party {
    barrier: Barrier,
}

impl Party {
    pub(super) fn new(barrier: Barrier) -> Self {
        Self { barrier }
    }

    /// As [`Barrier::sync`].
    #[inline]
    pub fn sync(&self) -> SyncOp<'_> {
        self.barrier.sync()
    }
}

impl Drop for Party {
    fn drop(&mut self) {
        self.barrier.resign();
    }
}

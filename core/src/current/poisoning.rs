//! Dropping the values of a process that was ended because of a failure.

use core::cell::Cell;
use luna_platform::on_drop::OnDrop;

luna_platform::local! {
    static POISONS: Cell<bool> = const { Cell::new(false) };
}

/// Runs `drop`. Meanwhile every channel end that is dropped on this thread poisons its channel,
/// instead of merely counting as one less: the partners of a failed process must learn that what
/// they wait for will not come.
pub fn poison_dropped_ends<R>(drop: impl FnOnce() -> R) -> R {
    let before = POISONS.replace(true);
    let _restore = OnDrop::new(|| POISONS.set(before));
    drop()
}

/// Whether a channel end that is dropped here and now poisons its channel.
#[inline]
pub fn dropped_ends_poison() -> bool {
    // Ends are dropped with a thread's locals too.
    POISONS.try_with(Cell::get).unwrap_or(false)
}

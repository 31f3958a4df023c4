//! The dropping of what a process leaves that was ended for cause.

use std::cell::Cell;

thread_local! {
    static POISONS: Cell<bool> = const { Cell::new(false) };
}

/// Runs `drop`, during which every channel end that is dropped on this thread poisons its channel, and does not merely count as one less: the
/// partners of a process that was ended for cause are to know that what they wait for will not come.
pub fn poison_dropped_ends<R>(drop: impl FnOnce() -> R) -> R {
    struct Restore(bool);
    impl Drop for Restore {
        fn drop(&mut self) {
            POISONS.set(self.0);
        }
    }
    let _restore = Restore(POISONS.replace(true));
    drop()
}

/// Whether a channel end that is dropped here and now poisons its channel.
#[inline]
pub fn dropped_ends_poison() -> bool {
    // Ends are dropped with a thread's locals too.
    POISONS.try_with(Cell::get).unwrap_or(false)
}

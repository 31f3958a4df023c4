//! What a chip, or a simulated one, gives LUNA.

use super::once::OnceLock;
use crate::clock::Instant;

/// The clock and the idling of one CPU.
///
/// The methods are called from the program and from interrupts, also within a critical section, but
/// for [`idle`](Self::idle). None may use LUNA.
pub trait Port: Sync {
    /// Nanoseconds since an origin, which never go back. From 0 to `u64::MAX - 1`: 584 years.
    fn now(&self) -> u64;

    /// Waits for a [`wake`](Self::wake), or until [`now`](Self::now) reaches `deadline`;
    /// [`Instant::NEVER`] is none. Called by the program alone, outside of critical sections. It
    /// may return without a cause, as after any interrupt.
    ///
    /// A wake that came since the last return ends it at once: the caller has looked for work
    /// before, and an interrupt may have come since. `wfe` of ARM does just that.
    fn idle(&self, deadline: Instant);

    /// Ends the present call of [`idle`](Self::idle), or else the next. `sev` of ARM.
    fn wake(&self);

    /// Whether the CPU runs an interrupt handler. Builds with debug assertions ask it whenever a
    /// context uses what is its own, to find interrupts that use LUNA outside of
    /// [`interrupt`](super::interrupt). One in the middle of another's `interrupt` is not found.
    fn is_interrupt(&self) -> bool;
}

/// The installed port.
static INSTALLED: OnceLock<&'static dyn Port> = OnceLock::new();

/// Makes `port` that of the program: once, before anything else of LUNA is called. O(1).
///
/// # Panics
///
/// If there is one already.
///
/// # Safety
///
/// - LUNA is called on one CPU alone, and there by the program and by interrupt handlers: not by
///   the threads of another scheduler.
/// - Each interrupt handler calls LUNA within [`interrupt`](super::interrupt) alone.
/// - No handler that a critical section does not hold back (as that of a non-maskable interrupt)
///   calls LUNA.
/// - Guards of [`PiLock`](crate::lock::PiLock), and of luna-core's biased locks, respect the
///   sections of the crate `critical-section`: one that is held when such a section begins is held
///   until after its end, and one that is made in a section is dropped in it. Channels and executors
///   give no guard to their users, so this concerns programs that use these locks themselves.
pub unsafe fn install(port: &'static dyn Port) {
    let is_first = INSTALLED.set(port).is_ok();
    assert!(is_first, "a port is installed already");
}

/// The port, if there is one.
#[inline]
pub(super) fn installed() -> Option<&'static dyn Port> {
    INSTALLED.get().copied()
}

/// The port.
#[inline]
pub(super) fn port() -> &'static dyn Port {
    match installed() {
        Some(port) => port,
        None => panic!("LUNA has no port: call `luna_platform::bare::install` first"),
    }
}

//! Where a thread's time comes from.

use super::Instant;
use crate::on_drop::OnDrop;
use crate::sync::plain::{AtomicU64, Ordering};
use alloc::sync::Arc;
use core::cell::Cell;
use core::fmt;
use core::ptr;

crate::local! {
    /// The clock of this thread: null is the machine's, anything else that of the guard
    /// which keeps it.
    static SOURCE: Cell<*const VirtualClock> = const { Cell::new(ptr::null()) };
}

/// What [`Instant::now`] is.
#[inline(always)]
pub(super) fn now() -> Instant {
    let source = SOURCE.get();
    if source.is_null() {
        return Instant::now_real();
    }
    // SAFETY: the guard that has set it keeps the clock, and sets another before it goes.
    unsafe { read(source) }
}

/// # Safety
///
/// The clock lives.
#[cold]
#[inline(never)]
unsafe fn read(source: *const VirtualClock) -> Instant {
    // SAFETY: the caller promises that the source is live.
    unsafe { &*source }.now()
}

#[cold]
#[inline(never)]
fn as_far_on_machine(deadline: Instant) -> Instant {
    if deadline == Instant::NEVER {
        return deadline;
    }
    Instant::now_real() + (deadline - Instant::now())
}

/// A clock that stands until it is moved. Threads that have [entered](Clock::enter) it see it stand
/// and move.
///
/// ```
/// use luna_platform::clock::{Instant, VirtualClock};
///
/// let clock = VirtualClock::new();
/// assert_eq!(clock.now(), VirtualClock::ORIGIN);
/// clock.move_to(Instant::from_nanos(3_000_000_000));
/// clock.move_to(VirtualClock::ORIGIN); // it does not go back
/// assert_eq!(clock.now().as_nanos(), 3_000_000_000);
/// ```
#[derive(Debug)]
pub struct VirtualClock {
    nanos: AtomicU64,
}

impl VirtualClock {
    /// Where every virtual clock begins, so that each run sees the same instants. Not 0, so that
    /// there is something before it.
    pub const ORIGIN: Instant = Instant::from_nanos(1_000_000_000);

    /// A clock at its [origin](Self::ORIGIN).
    pub fn new() -> Self {
        Self {
            nanos: AtomicU64::new(Self::ORIGIN.as_nanos()),
        }
    }

    /// The time on it, from any thread. O(1), one load.
    #[inline]
    pub fn now(&self) -> Instant {
        // Acquire: a thread that sees the new time sees what was done before the move.
        Instant::from_nanos(self.nanos.load(Ordering::Acquire))
    }

    /// Moves it on to `instant`; does nothing if it has passed that already.
    pub fn move_to(&self, instant: Instant) {
        self.nanos.fetch_max(instant.as_nanos(), Ordering::AcqRel);
    }
}

/// A source of time: the machine's clock, or a virtual one. Clones are the same clock.
///
/// ```
/// use luna_platform::clock::{Clock, Instant, VirtualClock};
///
/// let clock = Clock::from(std::sync::Arc::new(VirtualClock::new()));
/// {
///     let _inside = clock.enter();
///     assert_eq!(Instant::now(), VirtualClock::ORIGIN);
/// }
/// assert!(Clock::REAL.now() <= Instant::now());
/// ```
#[derive(Clone, Default)]
pub struct Clock(Option<Arc<VirtualClock>>);

impl Clock {
    /// The machine's clock.
    pub const REAL: Clock = Clock(None);

    /// The time on it.
    pub fn now(&self) -> Instant {
        self.0
            .as_ref()
            .map_or_else(Instant::now_real, |clock| clock.now())
    }

    /// Whether the clock stands until it is moved.
    pub fn is_virtual(&self) -> bool {
        self.0.is_some()
    }

    /// Makes it the calling thread's, until the guard is dropped; then the one before is it again.
    /// Guards are dropped in the reverse order.
    pub fn enter(&self) -> OnDrop<impl FnMut() + use<>> {
        let source = self.0.as_ref().map_or(ptr::null(), Arc::as_ptr);
        let (before, clock) = (SOURCE.replace(source), self.clone());
        OnDrop::new(move || {
            SOURCE.set(before);
            // The thread has read it until here.
            let _ = &clock;
        })
    }

    /// Whether the calling thread has entered a virtual clock.
    #[inline]
    pub fn is_virtual_here() -> bool {
        !SOURCE.get().is_null()
    }

    /// A number for the calling thread's clock: 0 for the machine's, and no other clock that lives
    /// has the same.
    #[inline]
    pub fn number_here() -> usize {
        SOURCE.get().addr()
    }

    /// The instant on the machine's clock after the time that the calling thread's clock has to
    /// advance until `deadline`: the deadline of a sleep in the kernel. A virtual clock stands
    /// while such a thread is waited for, so a timeout there takes real time.
    #[inline]
    pub fn deadline_of_machine(deadline: Instant) -> Instant {
        if Self::is_virtual_here() {
            as_far_on_machine(deadline)
        } else {
            deadline
        }
    }
}

impl From<Arc<VirtualClock>> for Clock {
    fn from(clock: Arc<VirtualClock>) -> Self {
        Clock(Some(clock))
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            None => f.write_str("Clock(real)"),
            Some(clock) => write!(f, "Clock(virtual, {:?})", clock.now()),
        }
    }
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;
    use core::time::Duration;

    #[test]
    fn clocks_nest_and_belong_to_their_thread() {
        let (outer, inner) = (VirtualClock::new(), VirtualClock::new());
        inner.move_to(Instant::from_nanos(5_000_000_000));
        let (outer, inner) = (Clock::from(Arc::new(outer)), Clock::from(Arc::new(inner)));
        assert_eq!(Clock::number_here(), 0);
        let _outer = outer.enter();
        {
            let _inner = inner.enter();
            assert_eq!(Instant::now().as_nanos(), 5_000_000_000);
            let elsewhere = std::thread::spawn(Clock::is_virtual_here);
            assert!(!elsewhere.join().unwrap());
            let _real = Clock::REAL.enter();
            assert!(!Clock::is_virtual_here());
        }
        assert_eq!(Instant::now(), VirtualClock::ORIGIN);
    }

    #[test]
    fn a_guard_keeps_its_clock() {
        let clock = Clock::from(Arc::new(VirtualClock::new()));
        let _inside = clock.enter();
        drop(clock);
        assert_eq!(Instant::now(), VirtualClock::ORIGIN);
    }

    #[test]
    fn a_deadline_is_as_far_on_the_machines_clock() {
        let deadline = Instant::from_nanos(7);
        assert_eq!(Clock::deadline_of_machine(deadline), deadline);
        let clock = Clock::from(Arc::new(VirtualClock::new()));
        let _inside = clock.enter();
        let second = Duration::from_secs(1);
        let before = Instant::now_real();
        let there = Clock::deadline_of_machine(Instant::now() + second);
        assert!(there >= before + second && there <= Instant::now_real() + second);
        assert_eq!(Clock::deadline_of_machine(Instant::NEVER), Instant::NEVER);
    }
}

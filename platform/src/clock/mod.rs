//! Time in nanoseconds, on the machine's clock or on that of a simulation.

mod source;

pub use source::{Clock, VirtualClock};

use core::fmt;
use core::ops::{Add, AddAssign, Sub};
use core::time::Duration;

/// A point in time, in nanoseconds since an origin: on the machine's monotonic clock an origin that
/// is the same for the whole run of the machine, on a [`VirtualClock`] one of its own. Instants of
/// different clocks have nothing to do with each other.
///
/// Unlike `std::time::Instant` it is a number: it can be stored in an atomic, written to a log, and
/// given to the kernel as an absolute deadline. Arithmetic saturates: no sum of an instant and a
/// duration wraps or panics.
///
/// ```
/// use luna_platform::clock::Instant;
/// use std::time::Duration;
///
/// let start = Instant::now();
/// let deadline = start + Duration::from_millis(1);
/// assert_eq!(deadline - start, Duration::from_millis(1));
/// assert_eq!(start - deadline, Duration::ZERO); // saturates
/// ```
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Instant(u64);

impl Instant {
    /// A deadline that never comes.
    pub const NEVER: Instant = Instant(u64::MAX);

    /// Reads the calling thread's clock: the machine's, unless the thread has
    /// [entered](Clock::enter) a virtual one. O(1), no system call where the kernel offers a vDSO
    /// (24 ns on the reference machine).
    #[inline]
    pub fn now() -> Instant {
        source::now()
    }

    /// Reads the machine's clock, also on a thread with another one: for measurements of the
    /// machine, and for sleeps in its kernel.
    ///
    /// ```
    /// use luna_platform::clock::{Clock, Instant, VirtualClock};
    ///
    /// let clock = Clock::from(std::sync::Arc::new(VirtualClock::new()));
    /// let _inside = clock.enter();
    /// let (stands, goes) = (Instant::now(), Instant::now_real());
    /// while Instant::now_real() == goes {}
    /// assert_eq!(Instant::now(), stands);
    /// ```
    #[inline]
    pub fn now_real() -> Instant {
        Instant(crate::backend::clock::monotonic_nanos())
    }

    /// The instant `nanos` nanoseconds after the origin.
    #[inline]
    pub const fn from_nanos(nanos: u64) -> Instant {
        Instant(nanos)
    }

    /// Nanoseconds since the origin.
    #[inline]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Nanoseconds from `earlier` to here, 0 if `earlier` is later.
    #[inline]
    pub const fn nanos_since(self, earlier: Instant) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// This instant moved by `nanos` nanoseconds; saturates at [`NEVER`](Self::NEVER).
    #[inline]
    pub const fn plus_nanos(self, nanos: u64) -> Instant {
        Instant(self.0.saturating_add(nanos))
    }
}

impl Add<Duration> for Instant {
    type Output = Instant;
    #[inline]
    fn add(self, duration: Duration) -> Instant {
        self.plus_nanos(nanos(duration))
    }
}

impl AddAssign<Duration> for Instant {
    #[inline]
    fn add_assign(&mut self, duration: Duration) {
        *self = *self + duration;
    }
}

impl Instant {
    /// How long it is after `earlier`; zero if it is not. What `self - earlier` gives, under the
    /// name that it has in the standard library.
    ///
    /// ```
    /// use luna_platform::clock::Instant;
    /// use std::time::Duration;
    ///
    /// let (early, late) = (Instant::from_nanos(5), Instant::from_nanos(7));
    /// assert_eq!(late.saturating_duration_since(early), Duration::from_nanos(2));
    /// assert_eq!(early.saturating_duration_since(late), Duration::ZERO);
    /// ```
    #[inline]
    pub fn saturating_duration_since(self, earlier: Instant) -> Duration {
        self - earlier
    }
}

impl Sub for Instant {
    type Output = Duration;
    #[inline]
    fn sub(self, earlier: Instant) -> Duration {
        Duration::from_nanos(self.nanos_since(earlier))
    }
}

impl Sub<Duration> for Instant {
    type Output = Instant;
    #[inline]
    fn sub(self, duration: Duration) -> Instant {
        Instant(self.0.saturating_sub(nanos(duration)))
    }
}

impl fmt::Debug for Instant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "Instant({}.{:09} s)",
            self.0 / 1_000_000_000,
            self.0 % 1_000_000_000
        )
    }
}

/// How long the calling thread has had a processor since it began; `None` where the system does not
/// report it. One system call that never waits, and no allocation.
///
/// ```
/// use luna_platform::clock::processor_time;
///
/// if let Some(before) = processor_time() {
///     while processor_time() == Some(before) {}
/// }
/// ```
#[cfg(all(feature = "std", not(loom)))]
pub fn processor_time() -> Option<Duration> {
    crate::backend::clock::processor_time()
}

/// A duration as whole nanoseconds, saturating after 584 years.
#[inline]
pub fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(all(test, not(loom)))]
mod tests {
    use super::*;

    #[test]
    fn arithmetic_saturates() {
        let huge = Instant::from_nanos(u64::MAX - 1) + Duration::MAX;
        assert_eq!(huge, Instant::NEVER);
        assert_eq!(
            Instant::from_nanos(5) - Instant::from_nanos(7),
            Duration::ZERO
        );
        assert_eq!(
            Instant::from_nanos(5) - Duration::from_nanos(7),
            Instant::from_nanos(0)
        );
    }

    #[test]
    fn the_clock_does_not_go_back() {
        let mut last = Instant::now();
        for _ in 0..10_000 {
            let now = Instant::now();
            assert!(now >= last);
            last = now;
        }
    }
}

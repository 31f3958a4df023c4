//! Stamps: points in time that other computers read.

use luna_machine::tai::{Synchronization, tai_nanos};
use luna_platform::clock::{Clock, Instant};
use std::time::Duration;
use std::{fmt, io};

/// Which clock stamps are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum StampClock {
    /// CLOCK_MONOTONIC: each computer's own, that no daemon sets. What crosses is converted by a
    /// measured offset. In a system on a virtual clock this is the system's time.
    #[default]
    Monotonic,
    /// CLOCK_TAI: the same on all computers, as far as PTP or NTP keeps them together. It is
    /// refused where nothing does.
    Tai,
}

impl fmt::Display for StampClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            StampClock::Monotonic => "CLOCK_MONOTONIC",
            StampClock::Tai => "CLOCK_TAI",
        })
    }
}

/// A point in time on a [`StampClock`], in nanoseconds since its origin. Stamps of different clocks
/// or computers have nothing to do with each other until one is converted, so this is no
/// [`Instant`](super::Instant).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(u64);

impl Stamp {
    /// The stamp `nanos` nanoseconds after the clock's origin.
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the clock's origin.
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Nanoseconds from `earlier`, a stamp of the same clock, to here; negative if it is later.
    /// Saturates after 292 years.
    pub fn nanos_since(self, earlier: Stamp) -> i64 {
        let distance = i128::from(self.0) - i128::from(earlier.0);
        distance.clamp(i64::MIN.into(), i64::MAX.into()) as i64
    }

    /// This stamp moved by so many nanoseconds; saturates.
    pub const fn plus_nanos(self, nanos: i64) -> Self {
        Self(self.0.saturating_add_signed(nanos))
    }
}

impl fmt::Debug for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, nanos) = (self.0 / 1_000_000_000, self.0 % 1_000_000_000);
        write!(f, "Stamp({seconds}.{nanos:09} s)")
    }
}

/// Why a clock cannot give stamps.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StampError {
    /// Nothing has set in the kernel how far TAI is ahead of UTC.
    #[error(
        "CLOCK_TAI is UTC under another name here: its offset is 0 s, not 37 s or more; let the daemon set it (chrony: `leapsectz right/UTC`; PTP: phc2sys, from a master that states it), or take StampClock::Monotonic"
    )]
    NoTaiOffset,
    /// No daemon keeps the clock, or none has done so lately.
    #[error(
        "CLOCK_TAI is not synchronized here (the kernel's greatest error is {greatest_error:?}): start chrony, or ptp4l with phc2sys, and wait until `chronyc tracking` or their log says so; or take StampClock::Monotonic"
    )]
    Unsynchronized {
        /// What the kernel states.
        greatest_error: Duration,
    },
    /// The process goes by a virtual clock, which has nothing to do with TAI.
    #[error("a virtual clock has no TAI: take StampClock::Monotonic in a simulation")]
    VirtualClock,
    /// The system does not say.
    #[error("the kernel's state of CLOCK_TAI cannot be read: {0}; take StampClock::Monotonic")]
    Refused(io::Error),
}

/// Whether TAI can be trusted in this state of the machine.
fn judged(state: &Synchronization) -> Result<(), StampError> {
    if !state.is_synchronized {
        return Err(StampError::Unsynchronized {
            greatest_error: state.greatest_error,
        });
    }
    match state.tai_offset {
        0 => Err(StampError::NoTaiOffset),
        _ => Ok(()),
    }
}

impl StampClock {
    /// Checks that the clock is what it says, and gives the source of its stamps.
    ///
    /// Not for the real-time path: a system call for TAI, none for the monotonic clock.
    ///
    /// # Errors
    ///
    /// For TAI a [`StampError`]: its offset is not set, no daemon keeps it, the thread goes by a
    /// virtual clock, or the system does not say. None for the monotonic clock.
    ///
    /// ```
    /// use luna::time::StampClock;
    ///
    /// let source = match StampClock::Tai.source() {
    ///     Ok(source) => source,
    ///     Err(why) => {
    ///         eprintln!("{why}");
    ///         StampClock::Monotonic.source()?
    ///     }
    /// };
    /// assert!(source.now() <= source.now());
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn source(self) -> Result<StampSource, StampError> {
        if self == StampClock::Tai {
            if Clock::is_virtual_here() {
                return Err(StampError::VirtualClock);
            }
            judged(&Synchronization::of_machine().map_err(StampError::Refused)?)?;
            tai_nanos().map_err(StampError::Refused)?;
        }
        Ok(StampSource(self))
    }
}

/// A clock that was found to be usable for stamps: see [`StampClock::source`].
///
/// ```
/// use luna::time::StampClock;
///
/// let source = StampClock::Monotonic.source()?;
/// let conversion = source.conversion();
/// let now = luna::now();
/// assert_eq!(conversion.instant(conversion.stamp(now)), now);
/// println!("{}", source.state()?);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StampSource(StampClock);

impl StampSource {
    /// Which clock it is.
    pub fn clock(self) -> StampClock {
        self.0
    }

    /// The time on it. Real-time path: yes; O(1), no system call where the kernel offers a vDSO.
    pub fn now(self) -> Stamp {
        match self.0 {
            StampClock::Monotonic => Stamp(super::now().as_nanos()),
            // It was read when the source was made, and no clock goes away.
            StampClock::Tai => Stamp(tai_nanos().unwrap_or_default()),
        }
    }

    /// Measures how its stamps and the instants of the loops belong together. Real-time path: yes;
    /// ten readings of clocks.
    pub fn conversion(self) -> Conversion {
        match self.0 {
            StampClock::Monotonic => Conversion::default(),
            StampClock::Tai => Conversion::measured(|| super::now().as_nanos(), || self.now().0),
        }
    }

    /// How good the clock is now. Real-time path: a system call for TAI, which never waits; once a
    /// second is enough.
    ///
    /// # Errors
    ///
    /// As for [`StampClock::source`]: the daemon may have ended since.
    pub fn state(self) -> Result<StampState, StampError> {
        let synchronization = match self.0 {
            StampClock::Monotonic => None,
            StampClock::Tai => {
                let state = Synchronization::of_machine().map_err(StampError::Refused)?;
                judged(&state)?;
                Some(state)
            }
        };
        Ok(StampState {
            clock: self.0,
            synchronization,
            read_within: self.conversion().error(),
        })
    }
}

/// How good a clock of stamps is: see [`StampSource::state`]. Its `Display` is a line for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct StampState {
    /// Which clock.
    pub clock: StampClock,
    /// What the kernel knows of TAI; none for the monotonic clock, which is nobody else's.
    pub synchronization: Option<Synchronization>,
    /// The error of converting between stamps and the instants of the loops.
    pub read_within: Duration,
}

impl StampState {
    /// By how much it may differ from TAI; none for the monotonic clock.
    pub fn error(&self) -> Option<Duration> {
        let state = self.synchronization?;
        Some(state.greatest_error + self.read_within)
    }
}

impl fmt::Display for StampState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.synchronization {
            None => write!(f, "{}, of this computer alone", self.clock),
            Some(state) => write!(
                f,
                "{}, {} s ahead of UTC, error at most {:?} ({:?} expected), converted within {:?}",
                self.clock,
                state.tai_offset,
                state.greatest_error,
                state.estimated_error,
                self.read_within
            ),
        }
    }
}

/// How the clock of a system's stamps was, in its report. Its `Display` is a line for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct StampReport {
    /// When the clock was stated.
    pub at_first: StampState,
    /// At the end; none if it could be trusted no longer.
    pub at_end: Option<StampState>,
}

impl StampReport {
    pub(crate) fn new(at_first: StampState) -> Self {
        Self {
            at_first,
            at_end: StampSource(at_first.clock).state().ok(),
        }
    }
}

impl fmt::Display for StampReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "stamps of {}", self.at_first)?;
        match self.at_end.and_then(|state| state.error()) {
            Some(error) => write!(f, "; {error:?} at the end"),
            None if self.at_end.is_none() => f.write_str("; not synchronized any more at the end"),
            None => Ok(()),
        }
    }
}

/// How the stamps of a clock and instants belong together, with the error of that: measured by
/// [`StampSource::conversion`](StampSource::conversion).
///
/// Both clocks go at the same rate, so it holds until TAI is set. Measure anew now and then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Conversion {
    /// A stamp minus its instant.
    offset: i64,
    error: u64,
}

impl Conversion {
    /// Reads the one clock before and after the other, a few times, and keeps the closest.
    pub(super) fn measured(
        mut instant: impl FnMut() -> u64,
        mut stamp: impl FnMut() -> u64,
    ) -> Self {
        let mut best = Self {
            offset: 0,
            error: u64::MAX,
        };
        for _ in 0..5 {
            let before = instant();
            let between = stamp();
            let taken = instant().saturating_sub(before);
            // Rounded up: half a nanosecond is an error too.
            let error = taken.div_ceil(2);
            if error < best.error {
                let middle = before.saturating_add(taken / 2);
                best = Self {
                    offset: Stamp::from_nanos(between).nanos_since(Stamp::from_nanos(middle)),
                    error,
                };
            }
        }
        best
    }

    /// The stamp of an instant.
    pub fn stamp(&self, instant: Instant) -> Stamp {
        Stamp::from_nanos(instant.as_nanos()).plus_nanos(self.offset)
    }

    /// The instant of a stamp; saturates at the clock's origin.
    pub fn instant(&self, stamp: Stamp) -> Instant {
        let nanos = stamp.plus_nanos(self.offset.saturating_neg()).as_nanos();
        Instant::from_nanos(nanos)
    }

    /// By how much both may be wrong.
    pub fn error(&self) -> Duration {
        Duration::from_nanos(self.error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(tai_offset: i32, is_synchronized: bool) -> Synchronization {
        Synchronization {
            tai_offset,
            is_synchronized,
            greatest_error: Duration::from_millis(16),
            estimated_error: Duration::ZERO,
        }
    }

    #[test]
    fn tai_is_refused_where_nothing_keeps_it() {
        assert!(judged(&state(37, true)).is_ok());
        let unset = judged(&state(0, true)).unwrap_err();
        assert!(unset.to_string().contains("offset is 0 s"), "{unset}");
        let free = judged(&state(37, false)).unwrap_err();
        assert!(free.to_string().contains("16ms"), "{free}");
    }

    #[test]
    fn this_machine_has_tai_or_says_why_not() {
        match StampClock::Tai.source() {
            Ok(source) => assert!(source.state().is_ok_and(|state| state.error().is_some())),
            Err(why) => assert!(why.to_string().contains("StampClock::Monotonic"), "{why}"),
        }
    }
    use proptest::prelude::*;
    use std::cell::{Cell, RefCell};

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Two clocks an offset apart, with readings that take time.
        #[test]
        fn a_conversion_is_within_its_error(
            offset in -1_000_000_000_000_i64..2_000_000_000_000_000_000,
            costs in prop::collection::vec(0_u64..10_000, 15),
        ) {
            let now = Cell::new(2_000_000_000_000_u64);
            let mut costs = costs.into_iter().cycle();
            let costs = RefCell::new(&mut costs);
            let read = || {
                now.set(now.get() + costs.borrow_mut().next().unwrap_or(0));
                now.get()
            };
            let measured = Conversion::measured(read, || read().saturating_add_signed(offset));
            prop_assert!(measured.offset.abs_diff(offset) <= measured.error);
            let instant = Instant::from_nanos(5_000_000_000_000);
            prop_assert_eq!(measured.instant(measured.stamp(instant)), instant);
        }
    }
}

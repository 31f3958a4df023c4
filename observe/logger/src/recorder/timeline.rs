//! Ticks of the processor's counter as nanoseconds on the machine's clock.

use crate::hub::Stamp;
use luna_machine::counter::Counter;
use luna_platform::clock::Instant;

/// Turns time stamps into nanoseconds.
///
/// The counter and the clock are read together once a round, and stamps in between are interpolated
/// linearly. So the counter's rate need not be known, and drift against the clock (which NTP slews)
/// does not accumulate. A round takes only stamps from before its reading.
pub(super) enum Timeline {
    /// Stamps are nanoseconds.
    Clock,
    Counter(Line),
}

/// A straight line through two readings.
pub(super) struct Line {
    counter: Counter,
    /// The later of the readings: ticks, nanoseconds.
    to: (u64, u64),
    /// The earlier.
    from: (u64, u64),
    /// Nanoseconds a tick, times 2^32.
    slope: u64,
}

impl Timeline {
    pub(super) fn begin(stamp: Stamp) -> Self {
        match stamp {
            Stamp::Clock => Timeline::Clock,
            Stamp::Counter(counter) => Timeline::Counter(Line::begin(counter)),
        }
    }

    /// Reads the clocks. Call it before taking stamps up to now.
    pub(super) fn advance(&mut self) {
        if let Timeline::Counter(line) = self {
            let (ticks, instant) = line.counter.beside_clock();
            line.through((ticks, instant.as_nanos()));
        }
    }

    /// The stamps that there are nanoseconds for.
    pub(super) fn limit(&self) -> u64 {
        match self {
            Timeline::Clock => u64::MAX,
            Timeline::Counter(line) => line.to.0,
        }
    }

    /// The nanoseconds of a stamp.
    pub(super) fn nanos(&self, stamp: u64) -> u64 {
        match self {
            Timeline::Clock => stamp,
            Timeline::Counter(line) => line.nanos(stamp),
        }
    }
}

impl Line {
    fn begin(counter: Counter) -> Self {
        let (ticks, instant) = counter.beside_clock();
        let at = (ticks, instant.as_nanos());
        Self {
            counter,
            to: at,
            from: at,
            slope: 1 << 32,
        }
    }

    fn through(&mut self, to: (u64, u64)) {
        let ticks = to.0.saturating_sub(self.to.0);
        if ticks == 0 {
            return;
        }
        let nanos = to.1.saturating_sub(self.to.1);
        let slope = (u128::from(nanos) << 32) / u128::from(ticks);
        (self.from, self.to) = (self.to, to);
        self.slope = u64::try_from(slope).unwrap_or(u64::MAX);
    }

    fn nanos(&self, stamp: u64) -> u64 {
        // From the nearer end, to limit the error of the slope. Stamps beyond an end are
        // extrapolated.
        let (base, nanos) = if stamp.abs_diff(self.from.0) < stamp.abs_diff(self.to.0) {
            self.from
        } else {
            self.to
        };
        let distance = (u128::from(stamp.abs_diff(base)) * u128::from(self.slope)) >> 32;
        let distance = u64::try_from(distance).unwrap_or(u64::MAX);
        if stamp >= base {
            nanos.saturating_add(distance)
        } else {
            nanos.saturating_sub(distance)
        }
    }
}

/// The time of day beside the machine's clock: nanoseconds since 1970, and the instant.
pub(super) fn epoch() -> Option<(i64, u64)> {
    let before = Instant::now_real();
    let unix = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let after = Instant::now_real();
    let unix = i64::try_from(unix.ok()?.as_nanos()).ok()?;
    Some((
        unix,
        before.as_nanos() + (after - before).as_nanos() as u64 / 2,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line() -> Option<Line> {
        Counter::of_machine().map(Line::begin)
    }

    #[test]
    fn stamps_become_the_instants_at_which_they_were_taken() {
        let Some(counter) = Counter::of_machine() else {
            return;
        };
        let mut timeline = Timeline::begin(Stamp::Counter(counter));
        for _ in 0..20 {
            let before = Instant::now_real().as_nanos();
            let stamp = counter.read();
            let after = Instant::now_real().as_nanos();
            timeline.advance();
            let nanos = timeline.nanos(stamp);
            // An interrupted reading is off by the interruption, at most a time slice.
            let most = 20_000_000;
            assert!(
                nanos + most >= before && nanos <= after + most,
                "{nanos} {before} {after}"
            );
        }
    }

    proptest! {
        #[test]
        fn a_line_goes_through_its_readings_and_never_back(
            ticks in 1u64..1 << 44,
            rate in 0.1f64..10.0,
            at in prop::collection::vec(0.0f64..1.0, 1..50),
        ) {
            let Some(mut line) = line() else { return Ok(()) };
            let begin = line.to;
            let nanos = (ticks as f64 * rate) as u64;
            let end = (begin.0 + ticks, begin.1 + nanos);
            line.through(end);
            prop_assert_eq!(line.nanos(begin.0), begin.1);
            prop_assert_eq!(line.nanos(end.0), end.1);
            for part in at {
                let stamp = begin.0 + (ticks as f64 * part) as u64;
                let exact = begin.1 as f64 + (stamp - begin.0) as f64 * nanos as f64 / ticks as f64;
                // The slope's last bit, and the rounding of what it is compared with.
                let most = ticks as f64 / (1u64 << 31) as f64 + 1e3;
                prop_assert!((line.nanos(stamp) as f64 - exact).abs() <= most);
            }
        }
    }
}

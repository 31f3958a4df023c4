//! The slots of a loop: where each lies, and how the following ones are moved. Arithmetic alone,
//! without a clock.

use luna_platform::clock::Instant;

/// Slots that are a period apart, by their numbers.
///
/// Slots up to `reference` lie where they were when they came; trimming moves those behind it
/// alone. So what has been counted stays true.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Grid {
    period: u64,
    /// When slot `reference` would begin if it had been where the following ones are.
    at: Instant,
    reference: u64,
    /// The last slot that had come when the loop joined the grid: the loop is responsible for those
    /// behind it.
    joined: u64,
}

impl Grid {
    /// Slot 0 begins at `origin`, and the loop is responsible for all behind it.
    pub(super) fn new(origin: Instant, period: u64) -> Self {
        Self {
            period,
            at: origin,
            reference: 0,
            joined: 0,
        }
    }

    /// Slot 0 begins at `origin`, and the loop is responsible for those that come after `now`, and
    /// never for slot 0.
    pub(super) fn joined_at(origin: Instant, period: u64, now: Instant) -> Self {
        let grid = Self::new(origin, period);
        Self {
            joined: grid.last_at(now),
            ..grid
        }
    }

    /// The last slot that had come when the loop joined.
    pub(super) fn joined(&self) -> u64 {
        self.joined
    }

    /// When slot `number` begins, which is not before the last one that was trimmed.
    pub(super) fn slot(&self, number: u64) -> Instant {
        self.at.plus_nanos(
            self.period
                .saturating_mul(number.saturating_sub(self.reference)),
        )
    }

    /// The last slot that has begun at `now`.
    pub(super) fn last_at(&self, now: Instant) -> u64 {
        self.reference + now.nanos_since(self.at) / self.period
    }

    /// Number of slots that the loop is responsible for when `last` is the last that has come.
    pub(super) fn elapsed(&self, last: u64) -> u64 {
        last.saturating_sub(self.joined)
    }

    /// Moves all slots behind `number`, later if `nanos` is positive; numbers stay.
    pub(super) fn shift_behind(&mut self, number: u64, nanos: i64) {
        let at = self.slot(number).as_nanos();
        self.at = Instant::from_nanos(at.saturating_add_signed(nanos));
        self.reference = number;
    }
}

/// How far the slots behind a cycle have been moved in it: what
/// [`Periodic::correct`](super::Periodic::correct) may still do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Trim(i64);

impl Trim {
    /// The part of a period by which its next slots can be moved in one cycle.
    const PART: u64 = 100;

    /// Adds `nanos`, as far as the sum stays within a hundredth of `period` either way; returns
    /// what was added.
    pub(super) fn add(&mut self, nanos: i64, period: u64) -> i64 {
        // A hundredth of any number of 64 bits fits.
        let most = (period / Self::PART) as i64;
        let before = self.0;
        self.0 = before.saturating_add(nanos).clamp(-most, most);
        self.0 - before
    }

    /// The sum.
    pub(super) fn nanos(self) -> i64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::UNIX_EPOCH;

    fn at(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    #[test]
    fn slots_and_their_numbers() {
        let grid = Grid::new(at(100), 10);
        assert_eq!(
            [0, 1, 7].map(|number| grid.slot(number)),
            [at(100), at(110), at(170)]
        );
        assert_eq!(
            [0, 99, 100, 109, 110, 179].map(|now| grid.last_at(at(now))),
            [0, 0, 0, 0, 1, 7]
        );
        assert_eq!(grid.elapsed(7), 7);
    }

    #[test]
    fn one_that_joins_later_answers_for_what_follows() {
        let grid = Grid::joined_at(at(100), 10, at(137));
        assert_eq!(grid.joined(), 3);
        assert_eq!(grid.slot(grid.joined() + 1), at(140));
        assert_eq!(grid.elapsed(grid.last_at(at(155))), 2);
        // Before the grid begins, the first is slot 1.
        assert_eq!(Grid::joined_at(at(100), 10, at(5)).joined(), 0);
    }

    #[test]
    fn a_shift_moves_what_follows_and_no_number() {
        let mut grid = Grid::new(at(100), 10);
        grid.shift_behind(4, 3);
        assert_eq!((grid.slot(5), grid.slot(6)), (at(153), at(163)));
        // Slot 4 has come, wherever its slot would be now.
        assert_eq!(
            (
                grid.last_at(at(140)),
                grid.last_at(at(152)),
                grid.last_at(at(153))
            ),
            (4, 4, 5)
        );
        grid.shift_behind(5, -5);
        assert_eq!((grid.slot(6), grid.slot(7)), (at(158), at(168)));
        // Twice behind the same slot: the sum.
        grid.shift_behind(5, -1);
        assert_eq!(grid.slot(6), at(157));
    }

    #[test]
    fn a_shift_at_the_clocks_ends_saturates() {
        let mut early = Grid::new(at(1), 1000);
        early.shift_behind(0, -10);
        assert_eq!(early.slot(1), at(1000));
        let mut late = Grid::new(Instant::NEVER, 1000);
        late.shift_behind(0, 10);
        assert_eq!(late.slot(1), Instant::NEVER);
    }

    #[test]
    fn a_trim_is_a_hundredth_of_the_period_in_one_cycle_and_no_more() {
        let mut trim = Trim::default();
        assert_eq!(trim.add(4, 1000), 4);
        assert_eq!(trim.add(9, 1000), 6);
        assert_eq!(trim.add(1, 1000), 0);
        assert_eq!(trim.add(i64::MIN, 1000), -20);
        assert_eq!(trim.add(i64::MIN, 1000), 0);
        assert_eq!(trim.add(i64::MAX, 1000), 20);
        assert_eq!(trim.nanos(), 10);
        // A hundredth of so short a period is less than the clock's unit.
        assert_eq!(Trim::default().add(1, 99), 0);
        assert_eq!(
            Trim::default().add(i64::MAX, u64::MAX),
            (u64::MAX / 100) as i64
        );
    }

    /// A bus that beats every `period` by its own clock, which gains or loses `drift` parts in a
    /// billion on ours.
    struct Bus {
        first: i128,
        period: i128,
        drift: i128,
    }

    impl Bus {
        /// When its beat `number` comes, by our clock.
        fn beat(&self, number: u64) -> i128 {
            let periods = i128::from(number) * self.period;
            self.first + periods - periods * self.drift / 1_000_000_000
        }

        /// From `now` to the beat that is nearest.
        fn offset(&self, now: i128) -> i128 {
            let length = self.beat(1) - self.beat(0);
            let guess = u64::try_from((now - self.first) / length).unwrap_or(0);
            (guess.saturating_sub(1)..=guess + 2)
                .map(|number| self.beat(number) - now)
                .min_by_key(|offset| offset.abs())
                .expect("four beats were looked at")
        }
    }

    /// A loop that corrects itself by all it measures follows the bus from wherever it begins, with
    /// the cycle's share of the drift for its error.
    fn follow(period: u64, drift: i128, begin: i128, missed_every: u64) {
        let bus = Bus {
            first: 5_000_000_000,
            period: i128::from(period),
            drift,
        };
        let mut grid = Grid::new(at((bus.first + begin) as u64), period);
        let share = bus.period * drift.abs() / 1_000_000_000 + 1;
        let most = bus.period / 100;
        // Half a period at a hundredth a cycle, less what it drifts meanwhile.
        let settled = bus.period / 2 / (most - share) + 2;
        let (mut number, mut before) = (0, grid.slot(0));
        for cycle in 0..5_000 {
            // Now and then a cycle takes so long that slots are missed: the numbers go on.
            let late = if missed_every > 0 && cycle % i128::from(missed_every) == 7 {
                period * 5 / 2
            } else {
                0
            };
            let begins = grid.slot(number + 1).plus_nanos(late);
            let last = grid.last_at(begins);
            let skipped = last - number - 1;
            assert_eq!(skipped, late / period, "cycle {cycle}");
            number = last;
            let slot = grid.slot(number);
            let apart = i128::from(slot.nanos_since(before)) - i128::from(skipped) * bus.period;
            assert!(
                (apart - bus.period).abs() <= most,
                "cycle {cycle}: {apart} ns"
            );
            before = slot;
            let offset = bus.offset(i128::from(slot.as_nanos()));
            if cycle > settled {
                let error = share * i128::from(skipped + 1) + 1;
                assert!(offset.abs() <= error, "cycle {cycle}: {offset} ns off");
            }
            let moved = Trim::default().add(offset as i64, period);
            grid.shift_behind(number, moved);
        }
    }

    #[test]
    fn a_bus_clock_that_drifts_by_50_ppm_is_followed() {
        for drift in [50_000, -50_000, 0] {
            for begin in [0, 400_000, -499_999] {
                follow(1_000_000, drift, begin, 0);
                follow(1_000_000, drift, begin, 50);
            }
        }
    }

    #[test]
    fn any_bus_clock_within_the_trim_is_followed() {
        let seed = std::env::var("LUNA_SEED")
            .ok()
            .and_then(|seed| seed.parse().ok())
            .unwrap_or_else(|| {
                UNIX_EPOCH
                    .elapsed()
                    .map_or(1, |since| since.as_nanos() as u64)
            });
        println!("LUNA_SEED={seed}");
        let mut state: u64 = seed | 1;
        let mut below = |end: u64| {
            // xorshift64*
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            state.wrapping_mul(0x2545_f491_4f6c_dd1d) % end
        };
        for _ in 0..60 {
            let period = 50_000 + below(10_000_000);
            let drift = i128::from(below(1_000_000)) - 500_000;
            let begin = i128::from(below(period)) - i128::from(period / 2);
            let missed_every = [0, 20, 91][below(3) as usize];
            follow(period, drift, begin, missed_every);
        }
    }
}

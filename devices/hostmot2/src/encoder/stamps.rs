//! The card's time stamps.

use std::time::Duration;

/// The card's counter of time stamps, without its wraps.
///
/// It has 16 bits. The host's clock, which need not be exact, determines how often it wrapped
/// between two answers.
///
/// ```
/// use hostmot2::encoder::Stamps;
/// use std::time::Duration;
///
/// let mut stamps = Stamps::new(1e6); // a microsecond each
/// stamps.update(65_000, Duration::ZERO);
/// let began = stamps.now();
/// stamps.update(464, Duration::from_millis(1));
/// assert_eq!(stamps.now() - began, 1_000);
/// stamps.update(464, Duration::from_millis(130)); // two turns, nearly
/// assert_eq!(stamps.now() - began, 1_000 + 2 * 65_536);
/// ```
#[derive(Debug, Clone)]
pub struct Stamps {
    frequency: f64,
    /// Begins behind a turn, so that no stamp is before its begin.
    now: u64,
    has_begun: bool,
}

impl Stamps {
    /// Stamps in a turn of the counter.
    pub const TURN: u64 = 1 << 16;

    /// A counter of this frequency (Hz).
    pub const fn new(frequency: f64) -> Self {
        Self {
            frequency,
            now: Self::TURN,
            has_begun: false,
        }
    }

    /// Takes the counter of an answer, about `elapsed` after the one before. O(1).
    pub fn update(&mut self, stamp: u16, elapsed: Duration) {
        let part = u64::from(stamp.wrapping_sub(self.now as u16));
        if !self.has_begun {
            self.has_begun = true;
            self.now += part;
            return;
        }
        let expected = elapsed.as_secs_f64() * self.frequency;
        let turns = ((expected - part as f64) / Self::TURN as f64).round();
        // A cast saturates at 0.
        let turns = (turns as u64).min(u64::MAX >> 20);
        self.now = self.now.saturating_add(part + turns * Self::TURN);
    }

    /// The time of the last answer, in units of the stamps' counter, without wraps.
    pub const fn now(&self) -> u64 {
        self.now
    }

    /// Stamps a second.
    pub const fn frequency(&self) -> f64 {
        self.frequency
    }

    /// How long before the last answer this stamp was taken, if that is less than a turn.
    pub(super) fn age(&self, stamp: u16) -> u64 {
        u64::from((self.now as u16).wrapping_sub(stamp))
    }
}

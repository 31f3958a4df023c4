//! Converts a card's 16-bit counters to positions that do not wrap, and time stamps to rates.

mod stamps;
#[cfg(test)]
mod tests;

pub use stamps::Stamps;

use crate::cycle::RawEncoder;
use std::time::Duration;

/// An encoder's values in one answer.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Encoder {
    /// Counts since the tracker began.
    pub position: i64,
    /// Counts a second: between the last two edges, or at a reversal between the last two readings.
    /// Without an edge it decreases to what the wait allows. Never beyond the encoder's greatest
    /// speed.
    pub rate: f64,
    /// The position at the index, once it was seen. None for an index that was latched before the
    /// first reading, unless it is near enough to be unambiguous.
    pub index: Option<i64>,
}

/// Why a position is unknown. It does not become known again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Lost {
    /// Between two answers the position may have moved by more than half of the counter's range.
    #[error("its position is lost: no answer came for so long that its counter may have wrapped")]
    Wrapped,
    /// It has moved further than it can: a counter that was reset, or a fault.
    #[error("its position is lost: it jumped by {by} counts, more than it can move")]
    Jumped {
        /// By how many counts.
        by: i64,
    },
    /// A and B changed at once: the card has lost counts.
    #[error("its position is lost: both of its lines changed at once")]
    Quadrature,
}

/// Follows one counter.
///
/// ```
/// use hostmot2::RawEncoder;
/// use hostmot2::encoder::{Lost, Stamps, Tracker};
/// use std::time::Duration;
///
/// let (mut tracker, mut stamps, ms) = (
///     Tracker::new(100_000.0),
///     Stamps::new(1e6),
///     Duration::from_millis(1),
/// );
/// let says = |count, stamp| RawEncoder { count, stamp, index: None, quadrature_error: false };
/// stamps.update(0, ms);
/// assert_eq!(tracker.update(says(65_530, 0), &stamps, ms)?.position, 0);
/// stamps.update(1_000, ms);
/// let read = tracker.update(says(14, 1_000), &stamps, ms)?; // it has wrapped
/// assert_eq!((read.position, read.rate), (20, 20_000.0));
/// stamps.update(2_000, ms);
/// assert_eq!(tracker.update(says(5_000, 2_000), &stamps, ms), Err(Lost::Jumped { by: 4_986 }));
/// # Ok::<(), Lost>(())
/// ```
#[derive(Debug, Clone)]
pub struct Tracker {
    /// The most counts a second.
    fastest: f64,
    state: Option<State>,
    lost: Option<Lost>,
    index: Option<i64>,
    /// Whether a latch that is seen now latched since the last reading.
    is_armed: bool,
    checks_quadrature: bool,
}

#[derive(Debug, Clone, Copy)]
struct State {
    count: u16,
    stamp: u16,
    position: i64,
    /// When it was read, in time stamps.
    read: u64,
    /// When the last edge was.
    edge: Option<u64>,
    /// Which way that was, 1 or −1; 0 if it is not known.
    direction: i64,
    rate: f64,
}

/// Tolerance in counts between a counter and the elapsed time: edges are not equidistant, and the
/// time is not exact.
const SLACK: f64 = 4.0;

impl Tracker {
    /// For an encoder that makes at most `fastest` counts a second.
    pub const fn new(fastest: f64) -> Self {
        Self {
            fastest,
            state: None,
            lost: None,
            index: None,
            is_armed: false,
            checks_quadrature: true,
        }
    }

    /// Leaves out the card's check that A and B never change at once.
    #[must_use]
    pub const fn ignoring_quadrature_errors(mut self) -> Self {
        self.checks_quadrature = false;
        self
    }

    /// Evaluates the counter in an answer with the stamps `stamps`. `elapsed` is the longest
    /// possible time between this reading and the one before; for the first reading, since the
    /// latch of the index was armed (an index is not reported if the encoder may have moved away
    /// from it by more than half of the counter's range). The first reading is position 0. O(1).
    ///
    /// # Errors
    ///
    /// [`Lost`], and from then on always.
    pub fn update(
        &mut self,
        raw: RawEncoder,
        stamps: &Stamps,
        elapsed: Duration,
    ) -> Result<Encoder, Lost> {
        if let Some(lost) = self.lost {
            return Err(lost);
        }
        let updated = self.follow(raw, stamps, elapsed);
        if let Err(lost) = updated {
            self.lost = Some(lost);
        }
        updated
    }

    fn follow(
        &mut self,
        raw: RawEncoder,
        stamps: &Stamps,
        elapsed: Duration,
    ) -> Result<Encoder, Lost> {
        if raw.quadrature_error && self.checks_quadrature {
            return Err(Lost::Quadrature);
        }
        let now = stamps.now();
        let farthest = self.fastest * elapsed.as_secs_f64() + SLACK;
        // A NaN limit is no limit.
        let may_wrap = farthest.is_nan() || farthest >= f64::from(i16::MAX);
        let is_near = |moved: i64| !may_wrap && (moved as f64).abs() <= farthest;
        let next = match self.state {
            None => State {
                count: raw.count,
                stamp: raw.stamp,
                position: 0,
                read: now,
                edge: None,
                direction: 0,
                rate: 0.0,
            },
            Some(last) => {
                if may_wrap {
                    return Err(Lost::Wrapped);
                }
                let moved = i64::from(raw.count.wrapping_sub(last.count).cast_signed());
                if !is_near(moved) {
                    return Err(Lost::Jumped { by: moved });
                }
                last.after(raw, moved, stamps, self.fastest)
            }
        };
        if let (None, Some(latched)) = (self.index, raw.index) {
            let since = raw.count.wrapping_sub(latched).cast_signed().into();
            // Latched before the first reading, it may be whole turns of the counter away.
            if self.is_armed || (self.state.is_none() && is_near(since)) {
                self.index = Some(next.position.saturating_sub(since));
            }
        }
        self.is_armed |= raw.index.is_none();
        self.state = Some(next);
        Ok(Encoder {
            position: next.position,
            rate: next.rate,
            index: self.index,
        })
    }
}

impl State {
    fn after(self, raw: RawEncoder, moved: i64, stamps: &Stamps, fastest: f64) -> State {
        let now = stamps.now();
        // A stamp is less than a turn of the stamps' counter old if the previous answer is.
        let is_near = now - self.read < Stamps::TURN;
        let edge = is_near.then(|| now - stamps.age(raw.stamp));
        let (edge, direction, rate) = if moved != 0 {
            let direction = moved.signum();
            // Without two edges of one direction: between the two readings. The edges at a reversal
            // are those of the same line, and may be arbitrarily near to each other.
            let (from, to) = match (self.edge, edge) {
                (Some(from), Some(to)) if to > from && direction == self.direction => (from, to),
                _ => (self.read, now),
            };
            let ticks = (to - from).max(1);
            let rate = moved as f64 * stamps.frequency() / ticks as f64;
            (edge, direction, rate)
        } else if raw.stamp != self.stamp {
            // There and back again.
            (edge, 0, 0.0)
        } else {
            let rate = self.edge.map_or(0.0, |edge| {
                let most = stamps.frequency() / (now - edge).max(1) as f64;
                self.rate.min(most).max(-most)
            });
            (self.edge, self.direction, rate)
        };
        State {
            count: raw.count,
            stamp: raw.stamp,
            position: self.position.saturating_add(moved),
            read: now,
            edge,
            direction,
            // Not `clamp`, which panics on a NaN limit.
            rate: rate.min(fastest).max(-fastest),
        }
    }
}

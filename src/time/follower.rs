//! A loop that follows another computer's tick: a phase-locked loop over [`Periodic::correct`].

use super::period::period_nanos;
use super::statistics::Distribution;
use super::{Cycle, Instant, Periodic};
use crate::error::Result;
use luna_platform::clock::nanos;
use std::time::Duration;

/// How strongly a phase error acts.
#[derive(Debug, Clone, Copy)]
struct Gains {
    /// The part that one cycle takes away.
    proportional: f64,
    /// The part that is added to the rate in each cycle.
    integral: f64,
}

/// To come near: an error is below a hundredth after 35 cycles, and overshoots a little.
const WIDE: Gains = Gains {
    proportional: 0.25,
    integral: 0.02,
};
/// To stay near: the noise of single ticks moves the loop, and the learned rate, twenty times less.
const NARROW: Gains = Gains {
    proportional: 0.05,
    integral: 0.001,
};
/// After how many measured cycles in lock it is to stay near.
const SETTLED: u32 = 64;
/// Only errors below this part of the period are added to the rate. Larger ones come from the begin
/// or from a jump, not from a rate.
const INTEGRATED_PART: f64 = 1.0 / 64.0;
/// The learned difference of the rates stays below this: half of what a loop can be moved by.
const MAX_RATE: f64 = 0.005;

/// A slot of the loop that is followed, on this computer's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LeaderTick {
    /// When the slot began.
    pub at: Instant,
    /// By how much that may be wrong.
    pub error: Duration,
}

/// How a [`Follower`] stands to its leader.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum FollowState {
    /// The phase error is not yet small, or no longer.
    #[default]
    Acquiring,
    /// The phase error was within the tolerance for eight measured cycles.
    Locked,
    /// The leader has been silent for too long: the loop goes on at the last estimated rate.
    FreeRunning,
}

/// What a [`Follower`] did in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Followed {
    /// How the loop stands to its leader now.
    pub state: FollowState,
    /// By how many nanoseconds the loop's slot came after the leader's, without the phase; none in
    /// a cycle without a usable tick.
    pub phase_error: Option<i64>,
    /// By how many nanoseconds the following slots are to be moved, later if it is positive.
    pub correction: i64,
}

/// Keeps a loop in step with that of another computer, whose slots come as [`LeaderTick`]s: a
/// phase-locked loop.
///
/// In each cycle it compares the loop's slot with the newest tick of the leader, and moves the
/// following slots by a part of the difference. It also learns the difference of the two rates. So
/// ticks may be missing: the loop goes on at the learned rate. The loop's own period is the nominal
/// one; the leader's may differ from it by a tenth of a per cent. From any phase a loop is locked
/// within 150 cycles, if the ticks are exact to a fifth of the tolerance.
///
/// Real-time path: yes; O(1), no allocation but in [`new`](Self::new).
///
/// ```
/// use luna::prelude::*;
/// use luna::time::{Follower, FollowState, LeaderTick};
/// use std::time::Duration;
///
/// let mut system = System::new("follower");
/// system.virtual_clock();
/// let main = system.executor("main").build()?;
/// main.process("loop").spawn(async {
///     let period = Duration::from_millis(1);
///     let mut follower = Follower::new(period)?;
///     let mut tick = luna::periodic("loop", period)?;
///     // The leader's clock is 100 ppm slow, and its slots lie elsewhere.
///     let leader_period = Duration::from_nanos(1_000_100);
///     let mut leader = luna::now() + Duration::from_micros(370);
///     for _ in 0..200 {
///         let cycle = tick.next().await;
///         while leader + leader_period <= cycle.deadline {
///             leader += leader_period;
///         }
///         let heard = LeaderTick { at: leader, error: Duration::ZERO };
///         follower.follow(&mut tick, &cycle, Some(heard));
///     }
///     assert_eq!(follower.state(), FollowState::Locked);
///     assert!((follower.rate_ppm() - 100.0).abs() < 5.0);
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug)]
pub struct Follower {
    period: u64,
    phase: i64,
    tolerance: u64,
    silence: u32,
    state: FollowState,
    /// By how many nanoseconds the slots move in each cycle to keep the leader's rate.
    rate: f64,
    /// Measured cycles in a row within the tolerance, or beyond it when locked.
    in_a_row: u32,
    /// Measured cycles since it was locked.
    settled: u32,
    silent: u32,
    losses: u64,
    refused: u64,
    phase_error: Distribution,
}

impl Follower {
    /// Cycles in a row that decide about the lock.
    const IN_A_ROW: u32 = 8;

    /// For a loop of this period. It is locked within a hundredth of the period, and runs freely
    /// after ten cycles without a tick. Allocates about 16 KiB for the histogram.
    ///
    /// # Errors
    ///
    /// [`SetupError`](crate::error::SetupError): a period of zero, or of more than 292 years.
    pub fn new(period: Duration) -> Result<Self> {
        let period = period_nanos("follower", period)?;
        Ok(Self {
            period,
            phase: 0,
            tolerance: period / 100,
            silence: 10,
            state: FollowState::default(),
            rate: 0.0,
            in_a_row: 0,
            settled: 0,
            silent: 0,
            losses: 0,
            refused: 0,
            phase_error: Distribution::default(),
        })
    }

    /// Lets the loop's slots begin this long after the leader's; taken modulo the period.
    #[must_use]
    pub fn phase(mut self, phase: Duration) -> Self {
        self.phase = i64::try_from(nanos(phase) % self.period).unwrap_or(0);
        self
    }

    /// The phase error up to which the loop counts as locked. Ticks with a greater error of their
    /// own than five times that are not used.
    #[must_use]
    pub fn tolerance(mut self, tolerance: Duration) -> Self {
        self.tolerance = nanos(tolerance);
        self
    }

    /// After how many cycles without a usable tick the loop runs freely.
    #[must_use]
    pub fn free_running_after(mut self, cycles: u32) -> Self {
        self.silence = cycles;
        self
    }

    /// To be called in each cycle, after `tick` has given `cycle`: moves the following slots. The
    /// leader's tick is the newest one that has come since the call before, if one has.
    pub fn follow(
        &mut self,
        tick: &mut Periodic,
        cycle: &Cycle,
        leader: Option<LeaderTick>,
    ) -> Followed {
        let followed = self.step(cycle.deadline, cycle.missed, leader);
        tick.correct(followed.correction);
        followed
    }

    /// The arithmetic of [`follow`](Self::follow), without a loop: `slot` is where the present slot
    /// began, `missed` the number of slots since the last call that had no cycle.
    pub fn step(&mut self, slot: Instant, missed: u64, leader: Option<LeaderTick>) -> Followed {
        // All slots that have passed since then have drifted.
        let drift = self.rate * (1.0 + missed as f64);
        let usable = leader.filter(|leader| self.is_usable(leader));
        self.refused += u64::from(leader.is_some() && usable.is_none());
        let Some(leader) = usable else {
            self.silent = self.silent.saturating_add(1);
            if self.silent > self.silence && self.state != FollowState::FreeRunning {
                self.state = FollowState::FreeRunning;
                self.losses += 1;
                self.in_a_row = 0;
            }
            return Followed {
                state: self.state,
                phase_error: None,
                correction: drift as i64,
            };
        };
        self.silent = 0;
        let error = self.phase_error_of(slot, leader.at);
        self.judge(error);
        let gains = match self.settled < SETTLED {
            true => WIDE,
            false => NARROW,
        };
        if error.abs() <= self.period as f64 * INTEGRATED_PART {
            let most = self.period as f64 * MAX_RATE;
            self.rate = (self.rate - gains.integral * error).clamp(-most, most);
        }
        Followed {
            state: self.state,
            phase_error: Some(error as i64),
            correction: (drift - gains.proportional * error).round() as i64,
        }
    }

    /// How far the slot is behind the one of the leader that belongs to it. The leader's slots are
    /// a period and the learned rate apart, so an old tick is as good as a new one.
    fn phase_error_of(&self, slot: Instant, leader: Instant) -> f64 {
        let apart = i128::from(slot.as_nanos()) - i128::from(leader.as_nanos());
        let behind = (apart - i128::from(self.phase)) as f64;
        let distance = self.period as f64 + self.rate;
        behind - (behind / distance).round() * distance
    }

    fn is_usable(&self, leader: &LeaderTick) -> bool {
        nanos(leader.error) <= self.tolerance.saturating_mul(5)
    }

    fn judge(&mut self, error: f64) {
        let is_small = error.abs() <= self.tolerance as f64;
        if self.state == FollowState::FreeRunning {
            self.state = FollowState::Acquiring;
            self.settled = 0;
        }
        let is_locked = self.state == FollowState::Locked;
        if is_locked {
            self.phase_error.record(error.abs() as u64);
            self.settled = self.settled.saturating_add(1);
        }
        self.in_a_row = if is_small == is_locked {
            0
        } else {
            self.in_a_row + 1
        };
        if self.in_a_row == Self::IN_A_ROW {
            (self.in_a_row, self.settled) = (0, 0);
            self.state = match is_locked {
                true => FollowState::Acquiring,
                false => FollowState::Locked,
            };
        }
    }

    /// How the loop stands to its leader.
    pub fn state(&self) -> FollowState {
        self.state
    }

    /// By how much the leader's period is longer than this computer's of the same length, in parts
    /// per million.
    pub fn rate_ppm(&self) -> f64 {
        self.rate / self.period as f64 * 1e6
    }

    /// How often the loop has begun to run freely.
    pub fn losses(&self) -> u64 {
        self.losses
    }

    /// Ticks that were not used since their own error was too great.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    /// The phase errors, without their signs, of the cycles with a tick while the loop was locked.
    pub fn phase_error(&self) -> &Distribution {
        &self.phase_error
    }
}

#[cfg(test)]
mod tests;

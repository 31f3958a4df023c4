//! A key that an operator holds.

use crate::block::{Sample, Verdict};
use crate::fault::Fault;
use crate::setting::{Of, SettingError};
use std::time::Duration;

/// Lets values pass only while an operator holds a key and the key is refreshed.
///
/// A key is a number: 0 is *released*, any other *held*. It has to be refreshed in each `time`; if
/// it [must change](Self::must_change), by a number other than the last. Guards against an absent
/// operator, and against a console, or a link to it, that is dead or repeats itself. When the time
/// is over, or the key has been [held too long](Self::held_at_most) (tied down, operator asleep),
/// it counts as released until it has actually been released.
///
/// Bound: a release in the same step; other faults at their time. As a process
/// ([`DeadManProcess`](crate::DeadManProcess)) it wakes up by itself at that instant. Does not
/// detect a key held by another person or thing.
///
/// ```
/// use luna_safety_blocks::DeadMan;
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut grip = DeadMan::new(100 * ms)?.must_change();
/// assert!(grip.step(None, ms).is_err()); // nobody has come yet
/// assert!(grip.step(Some(1), ms).is_ok());
/// assert!(grip.step(Some(2), 99 * ms).is_ok());
/// assert!(grip.step(Some(2), 99 * ms).is_ok()); // repeats itself: no refresh
/// assert!(grip.step(Some(3), ms).is_err()); // too late,
/// assert!(grip.step(Some(4), ms).is_err()); // until it has been released
/// assert!(grip.step(Some(0), ms).is_err());
/// assert!(grip.step(Some(5), ms).is_ok());
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct DeadMan {
    time: Duration,
    longest: Duration,
    must_change: bool,
    state: State,
}

#[derive(Debug, Clone, Copy)]
enum State {
    Released,
    Held {
        key: u32,
        unrefreshed: Duration,
        held: Duration,
    },
    /// Counts as released, until it is.
    Spent(Fault),
}

impl DeadMan {
    /// A key that is refreshed in each `time`.
    ///
    /// # Errors
    ///
    /// It is zero.
    pub fn new(time: Duration) -> Result<Self, SettingError> {
        Ok(Self {
            time: Of("dead-man").time("time", time)?,
            longest: Duration::MAX,
            must_change: false,
            state: State::Released,
        })
    }

    /// Takes only another number than the last one for a refresh.
    #[must_use]
    pub fn must_change(mut self) -> Self {
        self.must_change = true;
        self
    }

    /// A key that has been held for `longest` counts as released.
    ///
    /// # Errors
    ///
    /// It is zero.
    pub fn held_at_most(mut self, longest: Duration) -> Result<Self, SettingError> {
        self.longest = Of("dead-man").time("longest time", longest)?;
        Ok(self)
    }

    /// Takes a key, or none, `elapsed` after the call before. O(1); allocates nothing.
    ///
    /// # Errors
    ///
    /// The key is not held, or does not count as held: [`Fault::Released`], [`Fault::Silent`],
    /// [`Fault::HeldTooLong`].
    pub fn step(&mut self, key: Option<u32>, elapsed: Duration) -> Result<(), Fault> {
        if let State::Held {
            unrefreshed, held, ..
        } = &mut self.state
        {
            *unrefreshed = unrefreshed.saturating_add(elapsed);
            *held = held.saturating_add(elapsed);
            let (unrefreshed, held) = (*unrefreshed, *held);
            // Checked before the key, so that a late key does not hide its delay.
            if unrefreshed >= self.time {
                self.state = State::Spent(Fault::Silent {
                    time: unrefreshed,
                    limit: self.time,
                });
            } else if held >= self.longest {
                self.state = State::Spent(Fault::HeldTooLong {
                    time: held,
                    limit: self.longest,
                });
            }
        }
        self.state = match (key, self.state) {
            (Some(0), _) => State::Released,
            (Some(key), State::Released) => State::Held {
                key,
                unrefreshed: Duration::ZERO,
                held: Duration::ZERO,
            },
            (Some(new), State::Held { key, held, .. }) if !self.must_change || new != key => {
                State::Held {
                    key: new,
                    unrefreshed: Duration::ZERO,
                    held,
                }
            }
            (_, state) => state,
        };
        match self.state {
            State::Held { .. } => Ok(()),
            State::Released => Err(Fault::Released),
            State::Spent(fault) => Err(fault),
        }
    }

    /// The time until it counts as released if no key comes; none if it does already.
    pub fn expires_in(&self) -> Option<Duration> {
        match self.state {
            State::Held {
                unrefreshed, held, ..
            } => Some(
                self.time
                    .saturating_sub(unrefreshed)
                    .min(self.longest.saturating_sub(held)),
            ),
            _ => None,
        }
    }
}

/// The verdict on `value` with this key: a release is no fault, but the output is `neutral`.
pub(crate) fn judge(value: f64, key: Result<(), Fault>, neutral: f64) -> Verdict {
    match (Sample::new(value, Duration::ZERO).not_finite(), key) {
        (Some(fault), _) => Verdict::Refused(fault),
        (None, Ok(())) => Verdict::Pass(value),
        (None, Err(Fault::Released)) => Verdict::Limited(neutral, Fault::Released),
        (None, Err(fault)) => Verdict::Refused(fault),
    }
}

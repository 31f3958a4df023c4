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
/// it counts as released until it has actually been released. That is a fault, also if the release
/// is what shows it: a late key hides no silence.
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
    /// [`Fault::HeldTooLong`]. A release that comes too late is the fault, once.
    pub fn step(&mut self, key: Option<u32>, elapsed: Duration) -> Result<(), Fault> {
        let before = self.state;
        self.pass(elapsed);
        if let (State::Held { .. }, State::Spent(fault), Some(0)) = (before, self.state, key) {
            self.state = State::Released;
            return Err(fault);
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
        self.judged()
    }

    /// No key comes any more, `elapsed` after the call before. One that is held then is a fault;
    /// one that had been released, or counted as that, is released.
    pub(crate) fn end(&mut self, elapsed: Duration) -> Result<(), Fault> {
        let before = self.state;
        self.pass(elapsed);
        self.state = match (before, self.state) {
            (State::Held { .. }, State::Spent(fault)) => State::Spent(fault),
            (State::Held { .. }, _) => State::Spent(Fault::KeyLost),
            _ => State::Released,
        };
        self.judged()
    }

    fn judged(&self) -> Result<(), Fault> {
        match self.state {
            State::Held { .. } => Ok(()),
            State::Released => Err(Fault::Released),
            State::Spent(fault) => Err(fault),
        }
    }

    /// Time passes for a key that is held. Before a new key is looked at, so that a late one does
    /// not hide its delay.
    fn pass(&mut self, elapsed: Duration) {
        if let State::Held {
            unrefreshed, held, ..
        } = &mut self.state
        {
            *unrefreshed = unrefreshed.saturating_add(elapsed);
            *held = held.saturating_add(elapsed);
            let (unrefreshed, held) = (*unrefreshed, *held);
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

//! What stands before a chain: the timeout of its set-points, and their feedback.

use super::Steps;
use super::alarms::Alarms;
use super::chain::Signal;
use crate::response::Reactor;
use crate::timeout::Timeout;
use luna::{Instant, Receiver};
use std::time::Duration;

/// The limit of feedback values received at a time: a register holds one.
const MAX_AT_ONCE: usize = 16;

/// Where the feedback comes from.
pub(super) struct Feedback {
    pub(super) values: Receiver<f64>,
    pub(super) oldest: Duration,
    pub(super) newest: Option<(f64, Instant)>,
}

/// The timeout before the chain.
pub(super) struct Front<T> {
    pub(super) timeout: Timeout,
    pub(super) reactor: Reactor,
    pub(super) steps: Steps,
    pub(super) deadline: Instant,
    pub(super) make: fn(f64) -> T,
}

impl<T: Signal> Front<T> {
    pub(super) fn begin(&mut self, now: Instant) {
        self.steps.elapsed(now);
        self.deadline = now + self.timeout.time();
    }

    pub(super) fn step(&mut self, came: Option<T>, now: Instant, alarms: &mut Alarms) -> T {
        if self.reactor.take_reset() {
            self.timeout.reset();
        }
        let elapsed = self.steps.elapsed(now);
        let verdict = self.timeout.step(came.map(|came| came.value()), elapsed);
        // With a warning alone the last one holds.
        let (value, alarm) = self.reactor.react(verdict, self.timeout.last(), elapsed);
        if let Some(alarm) = alarm {
            alarms.raise(alarm);
        }
        self.deadline = now
            + match came {
                Some(_) => self.timeout.time(),
                None => self.timeout.repetition(),
            };
        came.unwrap_or_else(|| (self.make)(value)).with_value(value)
    }
}

impl Feedback {
    /// The newest, if it is not too old at `now`.
    pub(super) fn at(&mut self, now: Instant) -> Option<f64> {
        for _ in 0..MAX_AT_ONCE {
            match self.values.try_recv() {
                Ok(value) => self.newest = Some((value, now)),
                Err(_) => break,
            }
        }
        let (value, came) = self.newest?;
        (now - came <= self.oldest).then_some(value)
    }
}

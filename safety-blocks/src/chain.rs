//! Blocks one after the other.

use crate::block::{Block, Sample};
use crate::monitor::Monitor;
use crate::response::{Alarm, Reaction, Reactor, Response};
use crate::setting::{Of, SettingError};
use std::fmt;

/// Blocks that a value passes one after the other, with the responses to their verdicts.
///
/// Within one chain there is no communication and no switch: put blocks that belong together into
/// one, and spawn it as a process by [`process`](Self::process). Or call it directly in a control
/// process.
///
/// The final output is reported to the blocks before, so that a rate limit continues from the
/// actual output. Only the order relative to a [`RateLimit`](crate::RateLimit) matters: changes by
/// blocks before it, also to neutral, are limited to its rate; blocks behind it act at once. So an
/// [`EndStop`](crate::EndStop) belongs behind it. A number that is not finite is refused by the
/// first block.
///
/// ```
/// use luna_safety_blocks::{Chain, EndStop, Limit, RateLimit, Reaction, Sample};
/// use std::time::Duration;
///
/// let mut pan = Chain::new(0.0)?
///     .then("limit", Limit::new(-0.7, 0.7)?, Reaction::Warn)?
///     .then("slew", RateLimit::new(100.0)?, Reaction::Warn)?
///     .then("stops", EndStop::new(-1.3, 1.3)?, Reaction::Neutral)?;
/// let sample = |duty| Sample::new(duty, Duration::from_millis(1)).beside(0.2);
/// assert_eq!(pan.step(&sample(0.05), |_| {}), 0.05);
/// let mut alarms = 0;
/// assert_eq!(pan.step(&sample(f64::NAN), |_| alarms += 1), 0.0);
/// assert_eq!(alarms, 1);
/// # Ok::<(), luna_safety_blocks::SettingError>(())
/// ```
pub struct Chain {
    neutral: f64,
    links: Vec<Link>,
}

struct Link {
    block: Box<dyn Block + Send>,
    reactor: Reactor,
    /// What it let pass last.
    passed: f64,
}

impl Chain {
    /// A chain without blocks: all finite values pass. `neutral`, in the unit of the signal, is a
    /// harmless value.
    ///
    /// # Errors
    ///
    /// It is not finite.
    pub fn new(neutral: f64) -> Result<Self, SettingError> {
        Ok(Self {
            neutral: Of("chain").finite("neutral", neutral)?,
            links: Vec::new(),
        })
    }

    /// With `block` behind those there are, called `name`. Allocates.
    ///
    /// # Errors
    ///
    /// The block would not let the chain's neutral pass.
    pub fn then(
        mut self,
        name: &str,
        block: impl Block + Send + 'static,
        response: impl Into<Response>,
    ) -> Result<Self, SettingError> {
        block.check_neutral(self.neutral)?;
        self.links.push(Link {
            block: Box::new(block),
            reactor: Reactor::new(name, self.neutral, response)?,
            passed: self.neutral,
        });
        Ok(self)
    }

    /// The value that replaces refused ones, in the unit of the signal.
    pub fn neutral(&self) -> f64 {
        self.neutral
    }

    /// What others see of the block called `name`, if there is one.
    pub fn monitor(&self, name: &str) -> Option<Monitor> {
        let link = self.links.iter().find(|link| link.reactor.name() == name)?;
        Some(link.reactor.monitor())
    }

    /// Judges a sample and returns the output, which is always finite. Calls `on_alarm` for each
    /// fault that begins. After a fault with [`Reaction::Emergency`] the output is neutral.
    ///
    /// Real-time path: yes; O(blocks), no allocation, except for those of `on_alarm`.
    pub fn step(&mut self, sample: &Sample, mut on_alarm: impl FnMut(Alarm)) -> f64 {
        let mut sample = *sample;
        let mut is_over = false;
        for link in &mut self.links {
            if link.reactor.take_reset() {
                link.block.reset();
            }
            let verdict = link.block.step(&sample);
            let (value, alarm) = link.reactor.react(verdict, sample.value, sample.elapsed);
            if verdict.or(f64::NAN) != value {
                link.block.replaced(value);
            }
            if let Some(alarm) = alarm {
                is_over |= alarm.reaction == Reaction::Emergency;
                on_alarm(alarm);
            }
            link.passed = value;
            sample.value = value;
        }
        let out = match sample.value.is_finite() && !is_over {
            true => sample.value,
            // Of a chain without blocks, or at its end.
            false => self.neutral,
        };
        self.put_out(out)
    }

    /// Reports the actual output to the blocks.
    fn put_out(&mut self, out: f64) -> f64 {
        for link in &mut self.links {
            if link.passed != out {
                link.block.replaced(out);
                link.passed = out;
            }
        }
        out
    }

    /// Puts out neutral, independent of the blocks' verdicts.
    pub(crate) fn put_out_neutral(&mut self) -> f64 {
        self.put_out(self.neutral)
    }

    /// The system's safe state is over: the blocks that led to it judge again.
    pub(crate) fn rearm(&self) {
        for link in &self.links {
            link.reactor.rearm();
        }
    }
}

impl fmt::Debug for Chain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.links.iter().map(|link| link.reactor.name());
        f.debug_struct("Chain")
            .field("neutral", &self.neutral)
            .field("blocks", &names.collect::<Vec<_>>())
            .finish()
    }
}

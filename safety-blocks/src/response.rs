//! What is done about a verdict.

use crate::block::Verdict;
use crate::fault::{Fault, Finding};
use crate::lasting::Lasting;
use crate::monitor::Monitor;
use crate::setting::{Of, SettingError};
use std::sync::Arc;
use std::time::Duration;

/// What a fault leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reaction {
    /// It is told, and what came passes on, but for what is no finite number: in its place neutral is put out. The first one of a block is a
    /// [warning](luna::Safety::warn) of the system.
    Warn,
    /// Neutral is put out until the block has [recovered](Recovery). The first time is a warning of the system too.
    Neutral,
    /// The system enters its [safe state](luna::Safety::enter_safe_state): the processes of all blocks put out neutral, but those of
    /// [sensors](crate::ChainProcess::of_sensor), until somebody [resets](luna::Safety::reset) it. If the fault is still there then, it is found anew.
    SafeState,
    /// It is an emergency ([`luna::emergency`]) with a [`Finding`], which ends the system. Nothing is put out any more.
    Emergency,
}

/// When a block that holds neutral lets values pass again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Recovery {
    /// When somebody says so: [`Monitor::reset`].
    Reset,
    /// When samples have been good for this long, from the first good one to the last; zero is the first good one. Or by a reset.
    After(Duration),
}

/// What is done about a block's verdicts: which [`Reaction`], when it ends, and whether limiting is a fault in the end.
///
/// ```
/// use luna_safety_blocks::{Reaction, Recovery, Response};
/// use std::time::Duration;
///
/// let hold = Response::new(Reaction::Neutral)
///     .recovery(Recovery::After(Duration::from_millis(200)))
///     .limited_for(Duration::from_secs(1));
/// assert_eq!(Response::from(Reaction::Warn), Response::new(Reaction::Warn));
/// # let _ = hold;
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Response {
    pub(crate) reaction: Reaction,
    pub(crate) recovery: Recovery,
    pub(crate) limited_for: Option<Duration>,
}

impl Response {
    /// This reaction. It is recovered from by a reset alone; a warning, and what led to a safe state, at the first good sample. Limiting is no fault.
    pub const fn new(reaction: Reaction) -> Self {
        Self {
            reaction,
            recovery: match reaction {
                Reaction::Warn | Reaction::SafeState => Recovery::After(Duration::ZERO),
                Reaction::Neutral | Reaction::Emergency => Recovery::Reset,
            },
            limited_for: None,
        }
    }

    /// Lets it recover like this.
    #[must_use]
    pub const fn recovery(mut self, recovery: Recovery) -> Self {
        self.recovery = recovery;
        self
    }

    /// Makes it a fault when a block has [limited](Verdict::Limited) for `time` without a pause: a set-point that has run away, an end stop that is pressed. Zero is the first time.
    #[must_use]
    pub const fn limited_for(mut self, time: Duration) -> Self {
        self.limited_for = Some(time);
        self
    }
}

impl From<Reaction> for Response {
    fn from(reaction: Reaction) -> Self {
        Self::new(reaction)
    }
}

/// A fault has begun.
#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {
    /// Who found what.
    pub finding: Finding,
    /// What it leads to.
    pub reaction: Reaction,
    /// Whether it is the block's first, or the first since a reset.
    pub is_first: bool,
}

/// Turns verdicts into what is put out.
///
/// A [`Chain`](crate::Chain) has one for each of its blocks. By itself it is for what gives verdicts and is no block.
#[derive(Debug)]
pub struct Reactor {
    name: Arc<str>,
    response: Response,
    neutral: f64,
    limited: Lasting,
    good: Lasting,
    is_bad: bool,
    has_alarmed: bool,
    monitor: Monitor,
}

impl Reactor {
    /// Of a block called `name`; `neutral` is what is put out in the place of what must not be. Allocates.
    ///
    /// # Errors
    ///
    /// `neutral` is no finite number.
    pub fn new(
        name: &str,
        neutral: f64,
        response: impl Into<Response>,
    ) -> Result<Self, SettingError> {
        Ok(Self {
            name: Arc::from(name),
            response: response.into(),
            neutral: Of("response").finite("neutral", neutral)?,
            limited: Lasting::default(),
            good: Lasting::default(),
            is_bad: false,
            has_alarmed: false,
            monitor: Monitor::default(),
        })
    }

    /// What the block is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What is put out in the place of what must not be.
    pub fn neutral(&self) -> f64 {
        self.neutral
    }

    /// What others see of it, and by which they reset it.
    pub fn monitor(&self) -> Monitor {
        self.monitor.clone()
    }

    /// Whether somebody has asked for a reset since the last look; if so there is no fault any more.
    pub fn take_reset(&mut self) -> bool {
        let is_asked = self.monitor.take_reset();
        if is_asked {
            (self.is_bad, self.has_alarmed) = (false, false);
            self.limited.reset();
            self.good.reset();
            self.monitor.tell_held(false);
        }
        is_asked
    }

    /// The system's safe state is over: who led to it looks anew.
    pub(crate) fn rearm(&self) {
        if self.response.reaction == Reaction::SafeState {
            self.monitor.reset();
        }
    }

    /// What is put out upon `verdict` on `came`, `elapsed` after the one before: always a finite number. And the alarm, when a fault begins.
    ///
    /// Real-time path: yes; O(1), no allocation (an alarm shares the name).
    pub fn react(
        &mut self,
        verdict: Verdict,
        came: f64,
        elapsed: Duration,
    ) -> (f64, Option<Alarm>) {
        self.monitor.count(&verdict);
        // What nearly all samples are.
        if let Verdict::Pass(value) = verdict
            && !self.is_bad
            && value.is_finite()
        {
            self.limited.reset();
            return (value, None);
        }
        let fault = self.fault_of(verdict, elapsed);
        let has_begun = fault.is_some() && !self.is_bad;
        match fault {
            Some(_) => {
                self.is_bad = true;
                self.good.reset();
            }
            None if self.is_bad => {
                let good = self.good.step(true, elapsed).unwrap_or_default();
                self.is_bad = match self.response.recovery {
                    Recovery::Reset => true,
                    Recovery::After(time) => good < time,
                };
            }
            None => {}
        }
        let alarm = fault.filter(|_| has_begun).map(|fault| Alarm {
            finding: Finding {
                block: self.name.clone(),
                fault,
            },
            reaction: self.response.reaction,
            is_first: !std::mem::replace(&mut self.has_alarmed, true),
        });
        let is_held = self.is_bad && self.response.reaction != Reaction::Warn;
        self.monitor.tell_held(is_held);
        let value = match verdict {
            _ if is_held => self.neutral,
            Verdict::Pass(value) | Verdict::Limited(value, _) => value,
            Verdict::Refused(Fault::NotFinite { .. }) => self.neutral,
            Verdict::Refused(_) => came,
        };
        // The last word, also about a block of somebody's own that keeps no promise.
        let value = match value.is_finite() {
            true => value,
            false => self.neutral,
        };
        (value, alarm)
    }

    fn fault_of(&mut self, verdict: Verdict, elapsed: Duration) -> Option<Fault> {
        let is_limited = matches!(verdict, Verdict::Limited(..));
        let limited = self.limited.step(is_limited, elapsed);
        match verdict {
            Verdict::Pass(_) => None,
            Verdict::Limited(_, fault) => {
                let longest = self.response.limited_for?;
                (limited? >= longest).then_some(fault)
            }
            Verdict::Refused(fault) => Some(fault),
        }
    }
}

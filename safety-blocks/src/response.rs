//! Responses to verdicts.

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
    /// It is reported, and the value passes, except that neutral replaces a value that is not
    /// finite. The first warning of a block is a [warning](luna::safety::Safety::warn) of the
    /// system.
    Warn,
    /// Neutral is put out until the block has [recovered](Recovery). The first one is a warning of
    /// the system too.
    Neutral,
    /// The system enters its [safe state](luna::safety::Safety::enter_safe_state): the processes of
    /// all blocks put out neutral, except those of [sensors](crate::ChainProcess::of_sensor), until
    /// a [reset](luna::safety::Safety::reset). If the fault is still there then, it is found again.
    SafeState,
    /// An emergency ([`luna::emergency`]) with a [`Finding`], which ends the system. Nothing is put
    /// out any more.
    Emergency,
}

/// When a block that holds neutral lets values pass again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Recovery {
    /// By a call of [`Monitor::reset`].
    Reset,
    /// After samples have been good for this long, from the first good one to the last; zero is the
    /// first good one. Or by a reset.
    After(Duration),
}

/// The response to a block's verdicts: its [`Reaction`], its recovery, and whether limiting becomes
/// a fault.
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
    /// A response with this reaction. It recovers only by a reset; a warning, and a block that led
    /// to a safe state, at the first good sample. Limiting is no fault.
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

    /// Makes it a fault that a block has [limited](Verdict::Limited) for `time` without a pause: a
    /// run-away set-point, a pressed end stop. Zero is the first time.
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
    /// The fault and its block.
    pub finding: Finding,
    /// What it leads to.
    pub reaction: Reaction,
    /// Whether it is the block's first, or the first since a reset.
    pub is_first: bool,
}

/// Turns verdicts into outputs.
///
/// A [`Chain`](crate::Chain) has one for each of its blocks. Use it directly for verdicts of other
/// sources.
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
    /// A responder for a block called `name`; `neutral` replaces refused values. Allocates.
    ///
    /// # Errors
    ///
    /// `neutral` is not finite.
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

    /// The value that replaces refused ones, in the unit of the signal.
    pub fn neutral(&self) -> f64 {
        self.neutral
    }

    /// What others see of it, and by which they reset it.
    pub fn monitor(&self) -> Monitor {
        self.monitor.clone()
    }

    /// Whether the end of the writers, which neutral alone does not answer, counts as a silence.
    pub(crate) fn outlives_its_writers(&self) -> bool {
        let is_wanted = matches!(
            self.response.reaction,
            Reaction::SafeState | Reaction::Emergency
        );
        is_wanted && !self.monitor.is_retired()
    }

    /// Whether a reset was requested since the last call; if so the fault is cleared.
    pub fn take_reset(&mut self) -> bool {
        let is_asked = self.monitor.take_reset();
        if is_asked {
            (self.is_bad, self.has_alarmed) = (false, false);
            self.limited.reset();
            self.good.reset();
            self.monitor.note_held(false);
        }
        is_asked
    }

    /// The system's safe state is over: a block that led to it judges again.
    pub(crate) fn rearm(&self) {
        if self.response.reaction == Reaction::SafeState {
            self.monitor.reset();
        }
    }

    /// The output for `verdict` on `came`, `elapsed` after the one before, which is always finite.
    /// And the alarm, when a fault begins.
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
        self.monitor.note_held(is_held);
        let value = match verdict {
            _ if is_held => self.neutral,
            Verdict::Pass(value) | Verdict::Limited(value, _) => value,
            Verdict::Refused(Fault::NotFinite { .. }) => self.neutral,
            Verdict::Refused(_) => came,
        };
        // A final check, since a block of the user's may break its promise.
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

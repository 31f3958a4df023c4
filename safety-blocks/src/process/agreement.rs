//! Two channels as one, as a process.

use super::alarms::Alarms;
use super::{Steps, put_out};
use crate::agreement::Agreement;
use crate::fault::{Channel, Finding};
use crate::monitor::Monitor;
use crate::response::{Reactor, Response};
use crate::setting::{Of, SettingError};
use luna::{Process, Receiver, RecvTimeoutError, Sender, alt};
use std::time::Duration;

/// An [`Agreement`] between two channels and one: a value of each makes a round, for which one is put out.
///
/// When one has come, the other is waited for `skew`; then it is missing in this round, and its value begins the next. When neither has come for `silence`, both are missing,
/// each `silence` again. A channel whose writers are gone, or have poisoned it, is missing from then on, and not waited for. When both are gone, neutral is put out once, and it ends; also when its readers are gone.
///
/// While the system is in a safe state it puts out neutral. Bound: a channel that falls silent is seen `skew` after the other's next value, two that do after `silence`. Choose `skew` below the period: a channel that is
/// later than that in each round is missing in each. Real-time path: yes; O(1) a round, no allocation, but one for the first alarm,
/// for a safe state, and for an emergency.
///
/// ```
/// use luna::prelude::*;
/// use luna_safety_blocks::{Agreement, AgreementProcess, Reaction, Vote};
/// use std::time::Duration;
///
/// let ms = Duration::from_millis(1);
/// let mut system = System::new("two channels");
/// system.virtual_clock(); // a busy machine makes no channel late here
/// let main = system.executor("main").build()?;
/// let ((a, from_a), (b, from_b)) = (luna::channel(), luna::channel());
/// let (safe, torques) = luna::channel();
/// let both = Agreement::new(Vote::OneOutOfTwo, 0.0, 0.1, Duration::ZERO)?;
/// main.process("vote").spawn(AgreementProcess::new("vote", both, Reaction::Neutral, [from_a, from_b], safe, 5 * ms, 20 * ms)?)?;
/// for (name, channel, second) in [("controller a", a, 0.35), ("controller b", b, 0.8)] {
///     main.process(name).spawn(async move {
///         for torque in [0.3, second] {
///             channel.send(torque).await?;
///         }
///         Ok(())
///     })?;
/// }
/// main.process("motor").spawn(async move {
///     for expected in [0.3, 0.0, 0.0] { // 0.35 and 0.8 are not the same; and neutral at the end
///         assert_eq!(torques.recv().await?, expected);
///     }
///     Ok(())
/// })?;
/// system.run()?;
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug)]
#[must_use = "a process protects nobody until it is spawned"]
pub struct AgreementProcess {
    agreement: Agreement,
    reactor: Reactor,
    channels: [Receiver<f64>; 2],
    is_open: [bool; 2],
    output: Sender<f64>,
    skew: Duration,
    silence: Duration,
    alarms: Alarms,
}

impl AgreementProcess {
    /// Called `name`, from the two `channels`, A and B, to `output`.
    ///
    /// # Errors
    ///
    /// `skew` or `silence` is zero.
    pub fn new(
        name: &str,
        agreement: Agreement,
        response: impl Into<Response>,
        channels: [Receiver<f64>; 2],
        output: Sender<f64>,
        skew: Duration,
        silence: Duration,
    ) -> Result<Self, SettingError> {
        let of = Of("agreement");
        Ok(Self {
            reactor: Reactor::new(name, agreement.neutral(), response)?,
            agreement,
            channels,
            is_open: [true; 2],
            output,
            skew: of.time("skew", skew)?,
            silence: of.time("silence", silence)?,
            alarms: Alarms::default(),
        })
    }

    /// Tells `told` of each fault that begins, if there is room: give it a buffer that overwrites.
    pub fn tell(mut self, told: Sender<Finding>) -> Self {
        self.alarms.tell(told);
        self
    }

    /// What others see of it, and by which they reset it.
    pub fn monitor(&self) -> Monitor {
        self.reactor.monitor()
    }

    async fn pass_on(&mut self) -> luna::Result<()> {
        self.alarms.begin();
        let mut steps = Steps::default();
        while let Some([a, b]) = self.round().await {
            let elapsed = steps.elapsed(luna::now());
            if self.alarms.safe_state_is_over() {
                self.reactor.rearm();
            }
            if self.reactor.take_reset() {
                self.agreement.reset();
            }
            let verdict = self.agreement.step(a, b, elapsed);
            // With a warning alone: of one that is refused the first, and without any nothing is put out.
            let came = a.or(b).unwrap_or(self.reactor.neutral());
            let (value, alarm) = self.reactor.react(verdict, came, elapsed);
            if let Some(alarm) = alarm {
                self.alarms.raise(alarm);
            }
            self.alarms.go_on()?;
            let value = match self.alarms.is_safe_state() {
                true => self.reactor.neutral(),
                false => value,
            };
            if !put_out(&self.output, value).await? {
                break;
            }
        }
        Ok(())
    }

    /// What the two say in one round; nothing when both are gone.
    async fn round(&mut self) -> Option<[Option<f64>; 2]> {
        let mut round = [None; 2];
        let end = luna::now() + self.silence;
        while round == [None; 2] {
            let [a, b] = &self.channels;
            let [a_is_open, b_is_open] = self.is_open;
            if !a_is_open && !b_is_open {
                return None;
            }
            let (channel, value) = alt! {
                _ = luna::at(end) => return Some(round),
                value = a.recv(), if a_is_open => (Channel::A, value.ok()),
                value = b.recv(), if b_is_open => (Channel::B, value.ok()),
            };
            round[channel as usize] = value;
            self.is_open[channel as usize] = value.is_some();
        }
        let other = usize::from(round[0].is_some());
        if self.is_open[other] {
            match self.channels[other].recv_timeout(self.skew).await {
                Ok(value) => round[other] = Some(value),
                Err(RecvTimeoutError::Timeout) => {}
                Err(_) => self.is_open[other] = false,
            }
        }
        Some(round)
    }
}

impl Process for AgreementProcess {
    async fn run(&mut self) -> luna::Result<()> {
        let ended = self.pass_on().await;
        if ended.is_ok() {
            // Who is gone needs no neutral.
            let _ = self.output.send(self.reactor.neutral()).await;
        }
        ended
    }
}

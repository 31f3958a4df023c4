//! Two channels as one, as a process.

use super::alarms::Alarms;
use super::{Entered, Steps, put_out, taken, unless};
use crate::agreement::Agreement;
use crate::fault::{Channel, Finding};
use crate::monitor::Monitor;
use crate::response::{Reactor, Response};
use crate::setting::{Of, SettingError};
use luna::{Instant, Process, Receiver, RecvTimeoutError, SendError, Sender, alt};
use std::pin::pin;
use std::time::Duration;

/// An [`Agreement`] with two input channels and one output: each round takes a value of each and
/// puts one out.
///
/// When one value has come, the process waits `skew` for the other; then that one is missing in
/// this round, and begins the next. When neither has come for `silence`, both are missing, again
/// after each `silence`. A channel without writers, or poisoned, is missing from then on, without
/// waiting. When both are gone, neutral is put out once, and the process ends; with a reaction that
/// leads to a safe state or an emergency it does that first, when `silence` is over, unless
/// [`Monitor::retire`] was called before. It also ends when its readers are gone.
///
/// When the system enters a safe state it offers neutral at once, or within `skew` if it waits for
/// the second value of a round (in a recorded system, with the next round), and goes on while the
/// safe state lasts. A value that was not taken by then is withdrawn, and replaced by neutral.
/// Bound: a silent channel is found `skew` after the other's next value, two silent channels after
/// `silence`. Choose `skew` below the period: a channel that is later than that in each round is
/// missing in each. Real-time path: yes; O(1) a round, no allocation except one for the first
/// alarm, for a safe state, and for an emergency.
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
/// main.process("vote").spawn(AgreementProcess::new(
///     "vote",
///     both,
///     Reaction::Neutral,
///     [from_a, from_b],
///     safe,
///     5 * ms,
///     20 * ms,
/// )?)?;
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
#[must_use = "a process protects nothing until it is spawned"]
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
    /// An agreement called `name`, from the two `channels`, A and B, to `output`.
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

    /// Sends each fault that begins to `reports`, if there is room: use a buffer that overwrites.
    pub fn report_to(mut self, reports: Sender<Finding>) -> Self {
        self.alarms.report_to(reports);
        self
    }

    /// What others see of it, and by which they reset it.
    pub fn monitor(&self) -> Monitor {
        self.reactor.monitor()
    }

    /// Returns until when a value was awaited, if both channels are gone.
    async fn pass_on(&mut self) -> luna::Result<Option<Instant>> {
        self.alarms.begin();
        let mut steps = Steps::default();
        let mut entered = pin!(self.alarms.entered());
        let mut end = luna::now() + self.silence;
        // Neutral is on offer for the safe state, until it is taken or replaced.
        let mut offers = false;
        loop {
            let awaited = entered.as_mut().as_pin_mut();
            let awaited = awaited.filter(|_| self.alarms.awaits_safe_state());
            let [a, b] = match self.round(end, awaited, offers).await? {
                Round::Over => return Ok(Some(end)),
                Round::Values(values) => values,
                Round::SafeState => {
                    self.alarms.note_safe_state();
                    offers = true;
                    continue;
                }
                Round::Taken(false) => return Ok(None),
                Round::Taken(true) => {
                    offers = false;
                    continue;
                }
            };
            offers = false;
            let elapsed = steps.elapsed(luna::now());
            if self.alarms.safe_state_is_over() {
                self.reactor.rearm();
            }
            if self.reactor.take_reset() {
                self.agreement.reset();
            }
            let verdict = self.agreement.step(a, b, elapsed);
            // Only with a warning: the first value of a refused pair. Without values nothing is put
            // out.
            let came = a.or(b).unwrap_or(self.reactor.neutral());
            let (value, alarm) = self.reactor.react(verdict, came, elapsed);
            if let Some(alarm) = alarm {
                self.alarms.raise(alarm);
            }
            self.alarms.go_on()?;
            let neutral = self.reactor.neutral();
            let is_neutral = self.alarms.is_safe_state();
            let value = if is_neutral { neutral } else { value };
            let entered = entered.as_mut().as_pin_mut().filter(|_| !is_neutral);
            let (output, alarms) = (&self.output, &mut self.alarms);
            if !put_out(output, value, entered, alarms, || neutral).await? {
                return Ok(None);
            }
            end = luna::now() + self.silence;
        }
    }

    /// Both channels are gone: that is a silence of both, found at `end`.
    async fn fall_silent(&mut self, end: Instant) -> luna::Result<()> {
        // A reader that does not take it must not hold the reaction up.
        let neutral = self.reactor.neutral();
        let _ = self.output.send_deadline(neutral, end).await;
        luna::at(end).await;
        if self.reactor.outlives_its_writers() {
            let verdict = self.agreement.step(None, None, self.silence);
            let (_, alarm) = self.reactor.react(verdict, neutral, self.silence);
            if let Some(alarm) = alarm {
                self.alarms.raise(alarm);
            }
        }
        self.alarms.go_on()
    }

    /// The two values of one round, or none of them until `end`.
    async fn round(
        &mut self,
        end: Instant,
        mut entered: Entered<'_>,
        offers: bool,
    ) -> luna::Result<Round> {
        let neutral = self.reactor.neutral();
        let mut round = [None; 2];
        while round == [None; 2] {
            let [a, b] = &self.channels;
            let [a_is_open, b_is_open] = self.is_open;
            if !a_is_open && !b_is_open {
                return Ok(Round::Over);
            }
            let event = async {
                alt! {
                    _ = luna::at(end) => Event::Silence,
                    sent = self.output.send(neutral), if offers => Event::Taken(sent),
                    value = a.recv(), if a_is_open => Event::Came(Channel::A, value.ok()),
                    value = b.recv(), if b_is_open => Event::Came(Channel::B, value.ok()),
                }
            };
            let entered = entered.as_mut().map(|entered| entered.as_mut());
            let (channel, value) = match unless(event, entered).await {
                None => return Ok(Round::SafeState),
                Some(Event::Taken(sent)) => return Ok(Round::Taken(taken(sent)?)),
                Some(Event::Silence) => return Ok(Round::Values(round)),
                Some(Event::Came(channel, value)) => (channel, value),
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
        Ok(Round::Values(round))
    }
}

/// What a round comes to.
enum Round {
    Values([Option<f64>; 2]),
    /// The safe state was entered before a value came.
    SafeState,
    /// Neutral was put out for it, if a reader exists.
    Taken(bool),
    /// Both are gone.
    Over,
}

enum Event {
    Silence,
    Taken(Result<(), SendError<f64>>),
    Came(Channel, Option<f64>),
}

impl Process for AgreementProcess {
    async fn run(&mut self) -> luna::Result<()> {
        let ended = self.pass_on().await?;
        match ended.filter(|_| self.reactor.outlives_its_writers()) {
            Some(end) => self.fall_silent(end).await,
            None => {
                // Readers that are gone need no neutral.
                let _ = self.output.send(self.reactor.neutral()).await;
                Ok(())
            }
        }
    }
}

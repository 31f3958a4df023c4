//! A chain as a process.

use super::alarms::Alarms;
use super::front::{Feedback, Front};
use super::{Entered, Steps, put_out, taken};
use crate::block::Sample;
use crate::chain::Chain;
use crate::fault::Finding;
use crate::monitor::Monitor;
use crate::response::{Reactor, Response};
use crate::setting::{Of, SettingError};
use crate::timeout::Timeout;
use luna::safety::SafeStateEntered;
use luna::{Instant, Process, Receiver, RecvTimeoutError, Sender, alt};
use std::fmt;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::task::Poll;
use std::time::Duration;

/// What a chain's channels carry: a number, or something with one in it.
///
/// ```
/// use luna_safety_blocks::Signal;
/// use std::time::Duration;
///
/// #[derive(Clone, Copy)]
/// struct Command { duty: f64, angle: f64 }
///
/// impl Signal for Command {
///     fn value(&self) -> f64 { self.duty }
///     fn with_value(self, duty: f64) -> Self { Self { duty, ..self } }
///     fn feedback(&self) -> Option<f64> { Some(self.angle) }
/// }
/// # assert_eq!(Command { duty: 0.1, angle: 0.2 }.with_value(0.0).feedback(), Some(0.2));
/// ```
pub trait Signal: Copy + Send + 'static {
    /// What the blocks judge.
    fn value(&self) -> f64;

    /// The same with another value.
    #[must_use]
    fn with_value(self, value: f64) -> Self;

    /// The feedback that it carries. The default is none: then it comes by
    /// [`ChainProcess::feedback`].
    fn feedback(&self) -> Option<f64> {
        None
    }

    /// The time since the one before, if it carries that. The default is none: then it is the time
    /// between arrivals.
    fn elapsed(&self) -> Option<Duration> {
        None
    }
}

impl Signal for f64 {
    fn value(&self) -> f64 {
        *self
    }

    fn with_value(self, value: f64) -> Self {
        value
    }
}

/// A [`Chain`] between two channels: each value that comes is judged, and one is put out for it.
///
/// It keeps the pace of its input and adds no queue: with a rendezvous on both sides it holds one
/// value. It sends each output before it receives the next value. When its writers are gone (or
/// have poisoned the channel) it puts out neutral once and ends, so that neutral is the reader's
/// last value; after an emergency it puts out nothing. When its readers are gone it ends. With a
/// [`timeout`](Self::timeout) that leads to a safe state or an emergency, the end of the writers is
/// a silence: it does that at the timeout's instant, and ends then.
///
/// When the system enters a [safe state](crate::Reaction::SafeState), from whatever source, it
/// offers neutral at once, also while it waits for a value, until it is taken or the next value
/// comes, and then puts neutral out for each value that comes. A value that was not taken by then
/// is withdrawn, and replaced by neutral.
///
/// Real-time path: yes; a receive, the chain's step, a send; with a feedback up to 16 attempts to
/// receive, with a timeout a timer. No allocation except one for the first alarm of each block, for
/// a safe state, and for an emergency.
///
/// ```
/// use luna::prelude::*;
/// use luna_safety_blocks::{Chain, Limit, Reaction};
///
/// let chain = Chain::new(0.0)?.then("limit", Limit::new(-0.7, 0.7)?, Reaction::Warn)?;
/// let limited = chain.monitor("limit").unwrap();
/// let (duty, asked) = luna::channel();
/// let (safe, duties) = luna::channel();
/// let mut system = System::new("axis");
/// let main = system.executor("main").build()?;
/// main.process("safety").spawn(chain.process(asked, safe))?;
/// main.process("controller").spawn(async move {
///     for wanted in [0.5, 3.0, f64::NAN] {
///         duty.send(wanted).await?;
///     }
///     Ok(())
/// })?;
/// main.process("motor").spawn(async move {
///     for expected in [0.5, 0.7, 0.0, 0.0] { // and neutral at the end
///         assert_eq!(duties.recv().await?, expected);
///     }
///     assert!(duties.recv().await.is_err());
///     Ok(())
/// })?;
/// system.run()?;
/// assert_eq!((limited.passed(), limited.limited(), limited.refused()), (1, 1, 1));
/// # Ok::<(), luna::Error>(())
/// ```
#[must_use = "a process protects nothing until it is spawned"]
pub struct ChainProcess<T = f64> {
    chain: Chain,
    input: Receiver<T>,
    output: Sender<T>,
    feedback: Option<Feedback>,
    timeout: Option<Front<T>>,
    alarms: Alarms,
    is_of_sensor: bool,
    /// What was put out last.
    last: Option<T>,
    /// The value to put out for the safe state, unless another one comes before.
    offered: Option<T>,
    /// The writers are gone, or have poisoned the channel.
    input_has_ended: bool,
}

impl Chain {
    /// A process with this chain between `input` and `output`.
    pub fn process<T: Signal>(self, input: Receiver<T>, output: Sender<T>) -> ChainProcess<T> {
        ChainProcess {
            chain: self,
            input,
            output,
            feedback: None,
            timeout: None,
            alarms: Alarms::default(),
            is_of_sensor: false,
            last: None,
            offered: None,
            input_has_ended: false,
        }
    }
}

impl<T: Signal> ChainProcess<T> {
    /// Takes the feedback from `values`, for signals that carry none: with each value the newest
    /// that has come, if it came at most `oldest` ago. Use a register
    /// ([`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest)); the process never waits
    /// for it. Its age is counted from when this process received it.
    ///
    /// # Errors
    ///
    /// `oldest` is zero.
    pub fn feedback(
        mut self,
        values: Receiver<f64>,
        oldest: Duration,
    ) -> Result<Self, SettingError> {
        let oldest = Of("feedback").time("oldest", oldest)?;
        self.feedback = Some(Feedback {
            values,
            oldest,
            newest: None,
        });
        Ok(self)
    }

    /// Sends each fault that begins to `reports`, if there is room, without waiting: use a buffer
    /// that overwrites.
    pub fn report_to(mut self, reports: Sender<Finding>) -> Self {
        self.alarms.report_to(reports);
        self
    }

    /// For measurements, where no value is better than an invented one: puts out no neutral when
    /// its writers are gone, nor in a safe state of the system.
    pub fn of_sensor(mut self) -> Self {
        self.is_of_sensor = true;
        self
    }
}

impl<T: Signal + From<f64>> ChainProcess<T> {
    /// Wakes up when nothing has come for the time of `timeout`, before the chain. It is called
    /// `name`. Depending on `response` it puts out its fall-back in place of neutral, or the last
    /// value in case of a warning; and again at its [repetition](Timeout::repeat), through the
    /// chain. A set-point that comes later than that, while this process waited for it, does not
    /// hide the silence before it.
    ///
    /// With [`Reaction::SafeState`](crate::Reaction::SafeState) or
    /// [`Reaction::Emergency`](crate::Reaction::Emergency) writers that have ended, failed or
    /// poisoned the channel are silent too: a controller does not switch that reaction off by its
    /// end. Before an end on purpose call [`Monitor::retire`] of the monitor.
    ///
    /// Returns its monitor, too.
    ///
    /// # Errors
    ///
    /// The fall-back is not finite, which `timeout` has already checked.
    pub fn timeout(
        mut self,
        name: &str,
        timeout: Timeout,
        response: impl Into<Response>,
    ) -> Result<(Self, Monitor), SettingError> {
        let reactor = Reactor::new(name, timeout.fallback(), response)?;
        let monitor = reactor.monitor();
        self.timeout = Some(Front {
            timeout,
            reactor,
            steps: Steps::default(),
            deadline: Instant::NEVER,
            make: T::from,
        });
        Ok((self, monitor))
    }
}

impl<T: Signal> ChainProcess<T> {
    /// Returns whether it was the writers that have ended.
    async fn pass_on(&mut self) -> luna::Result<bool> {
        self.alarms.begin();
        let mut steps = Steps::default();
        if let Some(front) = &mut self.timeout {
            front.begin(luna::now());
        }
        let mut entered = pin!(self.alarms.entered());
        while let Some(came) = self.next(entered.as_mut().as_pin_mut()).await? {
            let signal = match came {
                Came::Signal(signal) => signal,
                Came::SafeState(last) => {
                    self.alarms.note_safe_state();
                    let signal = last.with_value(self.chain.put_out_neutral());
                    (self.last, self.offered) = (Some(signal), Some(signal));
                    continue;
                }
                Came::Taken => continue,
            };
            let now = luna::now();
            if self.alarms.safe_state_is_over() {
                self.chain.rearm();
                if let Some(front) = &self.timeout {
                    front.reactor.rearm();
                }
            }
            // The clock's time advances in any case.
            let by_clock = steps.elapsed(now);
            let feedback = &mut self.feedback;
            let sample = Sample {
                value: signal.value(),
                feedback: signal
                    .feedback()
                    .or_else(|| feedback.as_mut().and_then(|feedback| feedback.at(now))),
                elapsed: signal.elapsed().unwrap_or(by_clock),
            };
            let (chain, alarms) = (&mut self.chain, &mut self.alarms);
            let mut value = chain.step(&sample, |alarm| alarms.raise(alarm));
            alarms.go_on()?;
            let is_neutral = !self.is_of_sensor && alarms.is_safe_state();
            if is_neutral {
                value = chain.put_out_neutral();
            }
            let last = self.last.insert(signal.with_value(value));
            let (signal, entered) = (*last, entered.as_mut().as_pin_mut());
            let entered = entered.filter(|_| !self.is_of_sensor && !is_neutral);
            let neutral = || {
                *last = signal.with_value(chain.put_out_neutral());
                *last
            };
            if !put_out(&self.output, signal, entered, alarms, neutral).await? {
                return Ok(false);
            }
        }
        Ok(self.input_has_ended)
    }

    /// What comes next, or the fall-back; nothing when the writers or the readers are gone.
    async fn next(&mut self, entered: Entered<'_>) -> luna::Result<Option<Came<T>>> {
        let deadline = self.timeout.as_ref().map(|front| front.deadline);
        // The newest signal: all of it but the value is used again.
        let last = self.last.filter(|_| !self.is_of_sensor);
        let awaited = entered.filter(|_| self.alarms.awaits_safe_state() && last.is_some());
        let waits_from = deadline.map(|_| luna::now());
        let came = match (self.offered.take(), awaited, deadline) {
            (Some(neutral), ..) => match self.offer(neutral, deadline).await? {
                Offered::Taken(true) => return Ok(Some(Came::Taken)),
                Offered::Taken(false) => return Ok(None),
                Offered::Came(came) => came,
            },
            (None, None, None) => self.input.recv().await.map_err(Into::into),
            (None, None, Some(deadline)) => self.input.recv_deadline(deadline).await,
            (None, Some(entered), None) => self.input.recv_unless(entered).await,
            (None, Some(entered), Some(deadline)) => {
                let stop = deadline_or(deadline, entered);
                self.input.recv_unless(stop).await
            }
        };
        let came = match came {
            Ok(signal) => Some(signal),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Closed) => {
                self.input_has_ended = true;
                return Ok(None);
            }
            Err(RecvTimeoutError::Poisoned) => {
                self.input_has_ended = true;
                return Err(luna::Error::Poisoned);
            }
        };
        let Some(front) = &mut self.timeout else {
            // Given up for the safe state alone.
            return Ok(came.map(Came::Signal).or(last.map(Came::SafeState)));
        };
        let now = luna::now();
        if let (None, Some(last)) = (came, last)
            && now < front.deadline
        {
            return Ok(Some(Came::SafeState(last)));
        }
        // While it was held up by its reader, the writer may have waited with a value in time.
        let has_waited = waits_from.is_some_and(|begun| begun <= front.deadline);
        if came.is_some() && has_waited && now > front.deadline {
            front.step(None, now, &mut self.alarms);
            self.alarms.go_on()?;
        }
        let signal = front.step(came, now, &mut self.alarms);
        self.alarms.go_on()?;
        Ok(Some(Came::Signal(signal)))
    }

    /// Offers `neutral` until it is taken, or until there is another value to put out, so that a
    /// reader that reads in step with its sends is not blocked.
    async fn offer(&self, neutral: T, deadline: Option<Instant>) -> luna::Result<Offered<T>> {
        let offered = alt! {
            sent = self.output.send(neutral) => Offered::Taken(taken(sent)?),
            came = self.input.recv() => Offered::Came(came.map_err(Into::into)),
            _ = luna::at(deadline.unwrap_or(Instant::NEVER)), if deadline.is_some() => {
                Offered::Came(Err(RecvTimeoutError::Timeout))
            }
        };
        Ok(offered)
    }
}

/// What there is for a chain to do.
enum Came<T> {
    Signal(T),
    /// The safe state, and what was put out last.
    SafeState(T),
    /// Neutral was put out for it.
    Taken,
}

/// What an offer of neutral comes to.
enum Offered<T> {
    /// Whether a reader exists.
    Taken(bool),
    Came(Result<T, RecvTimeoutError>),
}

/// Ends at `deadline`, or when the safe state is entered.
async fn deadline_or(deadline: Instant, mut entered: Pin<&mut SafeStateEntered>) {
    let mut deadline = pin!(luna::at(deadline));
    poll_fn(|cx| match entered.as_mut().poll(cx) {
        Poll::Ready(()) => Poll::Ready(()),
        Poll::Pending => deadline.as_mut().poll(cx),
    })
    .await;
}

impl<T: Signal> Process for ChainProcess<T> {
    async fn run(&mut self) -> luna::Result<()> {
        let ended = self.pass_on().await;
        let is_over = matches!(&ended, Err(error) if !error.is_poisoned());
        let neutral = self.last.filter(|_| !self.is_of_sensor && !is_over);
        let neutral = neutral.map(|last| last.with_value(self.chain.neutral()));
        let is_silent = match &ended {
            Ok(writers_have_ended) => *writers_have_ended,
            Err(error) => self.input_has_ended && error.is_poisoned(),
        };
        match &mut self.timeout {
            Some(front) if is_silent && front.reactor.outlives_its_writers() => {
                // A reader that does not take it must not hold the reaction up.
                if let Some(neutral) = neutral {
                    let _ = self.output.send_deadline(neutral, front.deadline).await;
                }
                luna::at(front.deadline).await;
                if front.reactor.outlives_its_writers() {
                    front.step(None, luna::now(), &mut self.alarms);
                    self.alarms.go_on()?;
                }
            }
            _ => {
                if let Some(neutral) = neutral {
                    // Readers that are gone need no neutral.
                    let _ = self.output.send(neutral).await;
                }
            }
        }
        ended.map(drop)
    }
}

impl<T> fmt::Debug for ChainProcess<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ChainProcess")
            .field("chain", &self.chain)
            .finish_non_exhaustive()
    }
}

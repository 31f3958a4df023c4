//! What a cycle does with the bus.

use super::ends::Ends;
use super::failures::Failures;
use super::running::{Answer, Running};
use super::{Parts, Stop};
use crate::exchange::Exchange;
use crate::{Fault, Health, Neutral, State};
use ethercrab::MainDevice;
use luna::Instant;
use luna::time::{Cycle, Follower, LeaderTick, Periodic};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

/// How long the reason of a failure is awaited, at most.
const REASON: Duration = Duration::from_millis(20);

/// The state of a bus from cycle to cycle.
pub(super) struct Cycles {
    pub(super) main: Box<MainDevice<'static>>,
    pub(super) exchange: Exchange,
    pub(super) running: Running,
    pub(super) follower: Option<Follower>,
    pub(super) neutral: Neutral,
    health: Arc<Health>,
    /// How long to wait for an answer.
    pub(super) patience: Duration,
    period: u64,
    /// What the working counter is if all take part.
    pub(super) counter: u16,
    pub(super) start_limit: Duration,
    /// When the first cycle was.
    pub(super) begun: Option<Instant>,
    /// When OP was requested last.
    pub(super) requested: Option<Instant>,
    is_driving: bool,
    failures: Failures,
    /// The last that was measured (ns).
    pub(super) phase_error: Option<i64>,
    /// Between which times the last good exchange was.
    exchanged: Option<[Instant; 2]>,
    last: Outcome,
}

/// What came of a cycle's exchange.
#[derive(Debug, Clone, Copy)]
enum Outcome {
    Missed,
    Answered(Answer),
}

/// The reference clock's time in a cycle, and between which times it was read.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClockTime {
    time: u64,
    sent: Instant,
    received: Instant,
}

impl Cycles {
    pub(super) fn new(
        parts: &Parts,
        main: Box<MainDevice<'static>>,
        exchange: Exchange,
        running: Running,
        neutral: Neutral,
        follower: Option<Follower>,
    ) -> Self {
        // In one datagram that reads and writes, a subdevice counts 1 for inputs and 2 for outputs.
        let counts = |bytes: usize, by: u16| if bytes > 0 { by } else { 0 };
        let found = parts.found.iter();
        let counters = found.map(|each| counts(each.inputs, 1) + counts(each.outputs, 2));
        let counter = counters.sum();
        Self {
            health: exchange.health.clone(),
            patience: parts.period,
            period: u64::try_from(parts.period.as_nanos()).unwrap_or(u64::MAX),
            counter,
            start_limit: parts.start_limit,
            begun: None,
            requested: None,
            is_driving: false,
            failures: Failures::new(parts.tolerated, counter),
            phase_error: None,
            exchanged: None,
            last: Outcome::Missed,
            main,
            exchange,
            running,
            neutral,
            follower,
        }
    }

    /// Sets how long to wait for an answer.
    pub(super) fn wait_for(&mut self, patience: Duration) {
        self.patience = patience;
    }

    pub(super) fn is_simulated(&self) -> bool {
        self.exchange.port.is_simulated()
    }

    /// Whether the loop follows a clock.
    pub(super) fn follows(&self) -> bool {
        self.follower.is_some()
    }

    /// Whether all subdevices are in OP, so that set-points act.
    pub(super) fn is_driving(&self) -> bool {
        self.is_driving
    }

    /// Sets the outputs of the next exchange.
    pub(super) fn write(&self, ends: &Ends) {
        for end in &ends.outputs {
            let position = end.place().position;
            self.running
                .with_outputs(&self.main, position, |to| match self.is_driving {
                    true => end.write(to),
                    false => end.write_safe(to),
                });
        }
    }

    /// Exchanges process data. Returns the reference clock's time, if there is one.
    pub(super) async fn exchange(&mut self) -> Result<Option<ClockTime>, Stop> {
        self.exchange.drain();
        let sent = luna::now();
        self.begun.get_or_insert(sent);
        self.last = Outcome::Missed;
        let exchange = pin!(self.running.exchange(&self.main));
        let deadline = sent + self.patience;
        let neutral = Some(&self.neutral);
        let answer = self.exchange.until(deadline, neutral, exchange).await;
        let received = luna::now();
        let Some(Ok(answer)) = answer.map_err(Fault::Wait)? else {
            return Ok(None);
        };
        self.last = Outcome::Answered(answer);
        if self.is_whole(&answer) {
            self.exchanged = Some([sent, received]);
        } else if self.is_driving || !answer.is_complete {
            // The clock's time may be missing too.
            return Ok(None);
        }
        Ok(answer.time.map(|time| ClockTime {
            time,
            sent,
            received,
        }))
    }

    /// Whether all subdevices took part.
    fn is_whole(&self, answer: &Answer) -> bool {
        answer.counter == self.counter && answer.is_complete
    }

    /// Reports the cycle's outcome to the readers. Returns whether there are any.
    pub(super) async fn judge(&mut self, ends: &mut Ends) -> Result<bool, Stop> {
        match self.last {
            Outcome::Missed => {
                self.health.missed.add();
                self.failures.missed()?;
            }
            Outcome::Answered(answer) => {
                if let Some((position, state)) = answer.not_op.filter(|_| self.is_driving) {
                    return Err(self.left(position, state).await.into());
                }
                if self.is_whole(&answer) {
                    return self.good(ends, answer).await;
                }
                self.health.miscounted.add();
                if !self.is_driving && answer.is_complete {
                    // A subdevice may take no outputs before OP.
                    self.start(answer).await?;
                    return Ok(true);
                }
                self.failures.miscounted(answer.counter, answer.silent)?;
            }
        }
        let in_a_row = self.failures.in_a_row();
        self.health.longest_silence.raise_to(in_a_row.into());
        Ok(self.send(ends, in_a_row))
    }

    /// A cycle in which all subdevices took part.
    async fn good(&mut self, ends: &mut Ends, answer: Answer) -> Result<bool, Stop> {
        self.failures.good();
        if !self.is_driving {
            if answer.not_op.is_some() {
                self.start(answer).await?;
                return Ok(true);
            }
            self.is_driving = true;
        }
        for end in &mut ends.inputs {
            let position = end.place().position;
            self.running
                .with_inputs(&self.main, position, |from| end.read(from));
        }
        Ok(self.send(ends, 0))
    }

    /// Sends the last value of each input; nothing before OP. Returns whether anybody reads one.
    fn send(&self, ends: &Ends, stale: u32) -> bool {
        let exchanged = self.exchanged.filter(|_| self.is_driving);
        exchanged.is_none_or(|exchanged| ends.send(stale, exchanged))
    }

    /// A subdevice has left OP.
    async fn left(&mut self, position: usize, state: State) -> Fault {
        let (state, code) = self.reason(position, state).await;
        Fault::Left {
            position,
            state,
            code,
        }
    }

    /// Asks a subdevice for its state and its reason. `state` is what it had. The outputs are made
    /// safe before the answer is awaited; the question goes before, since the request of SAFE-OP
    /// may delete the reason.
    pub(super) async fn reason(&mut self, position: usize, state: State) -> (State, Option<u16>) {
        let mut status = pin!(self.running.status(&self.main, position));
        let begun = self.exchange.begin(status.as_mut());
        // If the system refuses, the watchdogs remain.
        let _ = self.neutral.try_engage();
        let answer = match begun {
            Some(answer) => Some(answer),
            None => {
                let deadline = luna::now() + self.patience.min(REASON);
                let answer = self.exchange.until(deadline, None, status).await;
                answer.ok().flatten()
            }
        };
        match answer {
            Some(Ok(status)) => (status.state, Some(status.code)),
            _ => (state, None),
        }
    }

    /// Moves the loop's next slots towards those of the reference clock.
    pub(super) fn follow(&mut self, tick: &mut Periodic, slot: &Cycle, read: Option<ClockTime>) {
        let Some(follower) = &mut self.follower else {
            return;
        };
        let leader = read.map(|read| {
            // The clock was read in the middle, more or less.
            let error = (read.received - read.sent) / 2;
            // The next slot of the clock is as good as the last one.
            let until = self.period - read.time % self.period;
            LeaderTick {
                at: read.sent + error + Duration::from_nanos(until),
                error,
            }
        });
        let followed = follower.follow(tick, slot, leader);
        self.phase_error = followed.phase_error.or(self.phase_error);
        self.health.note_clock(&followed, follower.rate_ppm());
    }
}

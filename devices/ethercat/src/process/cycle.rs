//! What a cycle does with the bus.

use super::ends::Ends;
use super::running::{Answer, Running};
use super::{Parts, Stop};
use crate::exchange::Exchange;
use crate::{Fault, Health, Neutral, State};
use ethercrab::MainDevice;
use luna::Instant;
use luna::time::{Cycle, FollowState, Follower, LeaderTick, Periodic};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

/// After how many cycles OP is requested again while subdevices are not there.
const REQUEST_EVERY: u32 = 64;
/// How long the reason of a failure is awaited, at most.
const REASON: Duration = Duration::from_millis(20);
/// By how much a failed cycle weighs more than a good one.
const WEIGHT: u32 = 10;

/// The state of a bus from cycle to cycle.
pub(super) struct Cycles {
    main: Box<MainDevice<'static>>,
    exchange: Exchange,
    running: Running,
    follower: Option<Follower>,
    neutral: Neutral,
    health: Arc<Health>,
    /// How long to wait for an answer.
    patience: Duration,
    period: u64,
    /// What the working counter is if all take part.
    counter: u16,
    limit: u32,
    start_limit: Duration,
    /// When the first cycle was.
    begun: Option<Instant>,
    /// Cycles since OP was requested.
    requested: Option<u32>,
    is_driving: bool,
    /// Failed cycles in a row, and their weight less that of good ones.
    in_a_row: u32,
    level: u32,
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
        let counter = found.map(|each| counts(each.inputs, 1) + counts(each.outputs, 2));
        Self {
            health: exchange.health.clone(),
            patience: parts.period,
            period: u64::try_from(parts.period.as_nanos()).unwrap_or(u64::MAX),
            counter: counter.sum(),
            limit: parts.tolerated.saturating_mul(WEIGHT),
            start_limit: parts.start_limit,
            begun: None,
            requested: None,
            is_driving: false,
            in_a_row: 0,
            level: 0,
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
        if !self.is_whole(&answer) {
            // The clock's time may be missing too.
            return Ok(None);
        }
        self.exchanged = Some([sent, received]);
        Ok(answer.time.map(|time| ClockTime {
            time,
            sent,
            received,
        }))
    }

    /// Whether all subdevices took part.
    fn is_whole(&self, answer: &Answer) -> bool {
        answer.counter == self.counter && !matches!(answer.not_op, Some((_, State::Silent)))
    }

    /// Reports the cycle's outcome to the readers. Returns whether there are any.
    pub(super) async fn judge(&mut self, ends: &mut Ends) -> Result<bool, Stop> {
        let silent = match self.last {
            Outcome::Missed => {
                self.health.missed.add();
                None
            }
            Outcome::Answered(answer) => match answer.not_op {
                Some((position, state)) if self.is_driving && state != State::Silent => {
                    return Err(self.left(position, state).await.into());
                }
                _ if self.is_whole(&answer) => return self.good(ends, answer).await,
                not_op => {
                    self.health.miscounted.add();
                    let silent = not_op.filter(|(_, state)| *state == State::Silent);
                    silent.map(|(position, _)| position)
                }
            },
        };
        self.in_a_row = self.in_a_row.saturating_add(1);
        self.level = self.level.saturating_add(WEIGHT);
        self.health.longest_silence.raise_to(self.in_a_row.into());
        if self.level > self.limit {
            return Err(Fault::TooManyErrors {
                in_a_row: self.in_a_row,
                silent,
            }
            .into());
        }
        Ok(self.send(ends, self.in_a_row))
    }

    /// A cycle in which all subdevices took part.
    async fn good(&mut self, ends: &mut Ends, answer: Answer) -> Result<bool, Stop> {
        self.in_a_row = 0;
        self.level = self.level.saturating_sub(1);
        if !self.is_driving {
            match answer.not_op {
                None => self.is_driving = true,
                _ => {
                    self.start(answer.not_op).await?;
                    return Ok(true);
                }
            }
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

    /// Goes on with the start: OP is requested when the loop is in step with the clock.
    async fn start(&mut self, not_op: Option<(usize, State)>) -> Result<(), Stop> {
        let is_late = self
            .begun
            .is_some_and(|begun| luna::now() - begun > self.start_limit);
        let locked = self.follower.as_ref().map(Follower::state);
        if locked.is_some_and(|state| state != FollowState::Locked) && self.requested.is_none() {
            return match is_late {
                true => Err(Fault::NotLocked {
                    phase_error: self.health.phase_error(),
                    within: self.start_limit,
                }
                .into()),
                false => Ok(()),
            };
        }
        if let Some((position, state)) = not_op.filter(|_| is_late) {
            let (state, code) = self.reason(position, state).await;
            return Err(Fault::NotOperational {
                position,
                state,
                code,
                within: self.start_limit,
            }
            .into());
        }
        self.requested = match self.requested {
            Some(cycles) if cycles < REQUEST_EVERY => Some(cycles + 1),
            _ => {
                let request = pin!(Running::request(&self.main, State::Op));
                let deadline = luna::now() + self.patience;
                // If it is lost it is sent again.
                let _ = self
                    .exchange
                    .until(deadline, Some(&self.neutral), request)
                    .await
                    .map_err(Fault::Wait)?;
                Some(0)
            }
        };
        Ok(())
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
    async fn reason(&mut self, position: usize, state: State) -> (State, Option<u16>) {
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
            Some(Ok((state, code))) => (state, Some(code)),
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
        self.health.note_clock(&followed, follower.rate_ppm());
    }
}

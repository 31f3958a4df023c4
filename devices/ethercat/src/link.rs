//! From channels to a bus.

use crate::Sample;
use crate::bus::{Bus, Failed, Group, block_on};
use crate::error::{LinkError, StepError};
use crate::neutral::Neutral;
use crate::process::{BusProcess, Ends, Parts, Running};
use crate::value::Value;
use ethercrab::DcSupport;
use ethercrab::subdevice_group::DcConfiguration;
use luna::time::Follower;
use luna::{Receiver, Sender};
use std::any::Any;
use std::time::Duration;

/// When SYNC0 pulses begin at the earliest, after the time of their start was determined. All
/// subdevices have to be configured by then, also if two frames of it are lost.
const START_DELAY: Duration = Duration::from_millis(250);

/// A bus, and its ends of the channels by which processes reach it. Made by
/// [`Bus::link`](crate::Bus::link); for an example see the [crate](crate).
///
/// Use registers as channels ([`Buffer::overwrite_oldest(1)`](luna::Buffer::overwrite_oldest)): the
/// link never waits for a process. Outputs that are not connected are zeros.
pub struct Link {
    bus: Bus,
    name: String,
    period: Duration,
    patience: f64,
    tolerated: u32,
    greatest_age: Option<Duration>,
    start_limit: Duration,
    ends: Ends,
    /// The age of each output.
    ages: Vec<Option<Duration>>,
    clock_phase: Option<Duration>,
    clock_tolerance: Option<Duration>,
    kept: Vec<Box<dyn Any + Send>>,
}

impl Link {
    pub(crate) fn new(bus: Bus, name: &str, period: Duration) -> Self {
        Self {
            bus,
            name: name.to_owned(),
            period,
            patience: 0.8,
            tolerated: 10,
            greatest_age: Some(Duration::from_millis(100)),
            start_limit: Duration::from_secs(10),
            ends: Ends::default(),
            ages: Vec::new(),
            clock_phase: None,
            clock_tolerance: None,
            kept: Vec::new(),
        }
    }

    /// Sends the value at `byte` of the inputs of the subdevice at `position` to `channel` in each
    /// cycle.
    pub fn input<T: Value>(
        &mut self,
        position: usize,
        byte: usize,
        channel: Sender<Sample<T>>,
    ) -> &mut Self {
        let bit = byte.saturating_mul(8);
        self.ends.add_input(position, bit, channel);
        self
    }

    /// As [`input`](Self::input), of one bit: bit 9 is bit 1 of byte 1.
    pub fn input_bit(
        &mut self,
        position: usize,
        bit: usize,
        channel: Sender<Sample<bool>>,
    ) -> &mut Self {
        self.ends.add_input(position, bit, channel);
        self
    }

    /// Uses the values from `channel` as the value at `byte` of the outputs of the subdevice at
    /// `position`. They must be repeated: for a value that is set once, see
    /// [`greatest_age`](Self::greatest_age). The value is `safe` before the first one, when all
    /// senders are gone, at the end, and in an emergency.
    pub fn output<T: Value>(
        &mut self,
        position: usize,
        byte: usize,
        safe: T,
        channel: Receiver<T>,
    ) -> &mut Self {
        let bit = byte.saturating_mul(8);
        self.ends.add_output(position, bit, safe, channel);
        self.ages.push(self.greatest_age);
        self
    }

    /// As [`output`](Self::output), of one bit.
    pub fn output_bit(
        &mut self,
        position: usize,
        bit: usize,
        safe: bool,
        channel: Receiver<bool>,
    ) -> &mut Self {
        self.ends.add_output(position, bit, safe, channel);
        self.ages.push(self.greatest_age);
        self
    }

    /// How long a set-point is held when no new one comes, for the outputs that are connected from
    /// now on: 100 ms if not stated, the usual watchdog of a subdevice. After that the link ends
    /// with [`Fault::Overdue`](crate::Fault::Overdue), an emergency. Counted in whole periods, from OP on. `None` holds it as long as there is a
    /// sender, for set-points that are sent once.
    pub fn greatest_age(&mut self, age: Option<Duration>) -> &mut Self {
        self.greatest_age = age;
        self
    }

    /// Lets the loop's slots follow the distributed time of the reference clock: each begins
    /// `phase` after a multiple of the period on that clock, which is when SYNC0 pulses come. The
    /// loop's period is corrected by a [`Follower`]: by 1 % at most, so that clocks may differ by
    /// a tenth of a per cent. The bus goes to OP when the loop is in step.
    pub fn follow_clock(&mut self, phase: Duration) -> &mut Self {
        self.clock_phase = Some(phase);
        self
    }

    /// The phase error up to which the loop counts as in step; a fiftieth of the period if not
    /// stated. A reading of the clock is not used if its frame was under way for too long: for more
    /// than ten times that, from its sending to its answer.
    pub fn clock_tolerance(&mut self, tolerance: Duration) -> &mut Self {
        self.clock_tolerance = Some(tolerance);
        self
    }

    /// How long to wait for an answer, as a part of the period; default 0.8.
    pub fn patience(&mut self, part: f64) -> &mut Self {
        self.patience = part;
        self
    }

    /// How many cycles in a row may have no answer or a wrong working counter, after good ones;
    /// default 10. 0 ends the link at the first.
    ///
    /// Each such cycle fills a bucket by 10, and each good one takes 1 out; the link ends when it
    /// holds more than 10 times this number. So fewer in a row end it while earlier ones are not
    /// outweighed, and it ends as well if more than one cycle in 11 fails for long. Before OP, a
    /// wrong working counter does not count while all subdevices answer: see
    /// [`start_within`](Self::start_within).
    pub fn tolerate(&mut self, cycles: u32) -> &mut Self {
        self.tolerated = cycles;
        self
    }

    /// How long the bus may take from the first cycle until all subdevices are in OP; default 10 s.
    pub fn start_within(&mut self, limit: Duration) -> &mut Self {
        self.start_limit = limit;
        self
    }

    /// Keeps `what` until the process has ended and the outputs are safe, such as the handle of a
    /// power supply.
    pub fn keep(&mut self, what: impl Send + 'static) -> &mut Self {
        self.kept.push(Box::new(what));
        self
    }

    /// The text of an error for an invalid setting.
    fn wrong(&self) -> Option<&'static str> {
        if let Some(wrong) = wrong_period(self.period, &self.ages) {
            return Some(wrong);
        }
        if !(self.patience > 0.0 && self.patience < 1.0) {
            return Some(
                "the part of the period for which an answer is awaited is more than 0 and less than 1",
            );
        }
        if self.clock_phase.is_some_and(|phase| phase >= self.period) {
            return Some("the phase to the reference clock is less than a period");
        }
        if self.clock_phase.is_none() && self.bus.syncs.contains(&true) {
            return Some(
                "subdevices are to make SYNC0 pulses, but the link does not follow the clock",
            );
        }
        None
    }

    /// Whether there is a clock to be followed, and clocks for all pulses.
    fn check_clocks(&self) -> Result<(), LinkError> {
        let why = match self.bus.reference {
            Some(DcSupport::Bits64 | DcSupport::RefOnly) => None,
            Some(_) => Some("has 32 bits, which is too short"),
            None => Some("is missing"),
        };
        if let Some(why) = why {
            return Err(LinkError::NoClock { why });
        }
        let both = self.bus.syncs.iter().zip(&self.bus.can_sync);
        match both.into_iter().position(|(syncs, can)| *syncs && !can) {
            Some(position) => Err(LinkError::NoSync {
                position,
                found: self.bus.found[position].clone(),
            }),
            None => Ok(()),
        }
    }

    /// Brings the bus to SAFE-OP, and makes the process. For set-up: blocks, and allocates.
    ///
    /// # Errors
    ///
    /// The bus does not have what is connected, a setting is invalid, or a subdevice does not reach
    /// SAFE-OP.
    pub fn process(self) -> Result<BusProcess, LinkError> {
        if let Some(wrong) = self.wrong() {
            return Err(LinkError::Setting(wrong));
        }
        self.ends.check(&self.bus.found)?;
        let follower = self.follower()?;
        let safe = self.ends.safe_outputs(&self.bus.found);
        let Bus {
            main,
            mut exchange,
            group,
            found,
            device,
            reference,
            ..
        } = self.bus;
        let step = "going to SAFE-OP";
        let running = match self.clock_phase {
            None => {
                let going = Box::pin(group.into_safe_op(&main));
                block_on(&mut exchange, going).map(|group| match reference {
                    Some(_) => Running::Free(Box::new(group)),
                    None => Running::Clockless(Box::new(group)),
                })
            }
            Some(phase) => {
                let settings = DcConfiguration {
                    // The library goes back from there to a multiple of the period.
                    start_delay: START_DELAY + self.period,
                    sync0_period: self.period,
                    sync0_shift: phase,
                };
                let going = Box::pin(async {
                    let group: Group<_, _> = group.configure_dc_sync(&main, settings).await?;
                    group.into_safe_op(&main).await
                });
                block_on(&mut exchange, going).map(|group| Running::Clocked(Box::new(group)))
            }
        };
        let running = running.map_err(|failed: Failed| {
            let (step, error): (_, StepError) = failed.at(step);
            LinkError::Step { step, error }
        })?;
        let inputs: usize = found.iter().map(|each| each.inputs).sum();
        let port = exchange.port.try_clone().map_err(LinkError::Socket)?;
        // Process data begins with all inputs.
        let neutral = Neutral::new(port, inputs as u32, &safe);
        if let Some(device) = &device {
            let neutral = neutral.clone();
            device
                .on_emergency("outputs safe", move |_| neutral.engage())
                .map_err(LinkError::Emergency)?;
        }
        let parts = Parts {
            name: self.name,
            period: self.period,
            patience: self.patience,
            tolerated: self.tolerated,
            start_limit: self.start_limit,
            ends: self.ends,
            ages: self.ages,
            found,
            device,
            kept: self.kept,
        };
        Ok(BusProcess::new(
            parts, main, exchange, running, neutral, follower,
        ))
    }

    /// What keeps the loop in step with the reference clock.
    fn follower(&self) -> Result<Option<Follower>, LinkError> {
        let Some(phase) = self.clock_phase else {
            return Ok(None);
        };
        self.check_clocks()?;
        let tolerance = self.clock_tolerance.unwrap_or(self.period / 50);
        let follower = Follower::new(self.period)
            .map_err(|_| LinkError::Setting("a bus' period is more than 0"))?;
        Ok(Some(follower.phase(phase).tolerance(tolerance)))
    }
}

/// The text of an error for a period that does not fit, also to the ages of outputs.
pub(crate) fn wrong_period(period: Duration, ages: &[Option<Duration>]) -> Option<&'static str> {
    if period.is_zero() || period > Duration::from_secs(4) {
        return Some("a bus' period is more than 0, and at most 4 s");
    }
    let is_short = |age: &Option<Duration>| age.is_some_and(|age| age < period);
    ages.iter()
        .any(is_short)
        .then_some("the greatest age of set-points is a period of the link or more")
}

luna_platform::debug_fields!(Link, |link| name: link.name, bus: link.bus);

//! The process that a bus is.

mod cycle;
mod ends;
mod failures;
mod running;
mod start;

pub(crate) use ends::Ends;
pub(crate) use running::Running;

use crate::bus::BusDevice;
use crate::exchange::Exchange;
use crate::link::wrong_period;
use crate::{Fault, Found, Health, Neutral};
use cycle::Cycles;
use ethercrab::MainDevice;
use luna::devices::Device;
use luna::time::Follower;
use luna::{Error, Process};
use luna_platform::clock::Clock;
use std::any::Any;
use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

/// A bus as a process: see [`Link::process`](crate::Link::process).
///
/// It ends, with all outputs at their safe values and the bus in SAFE-OP, when all writers of its
/// outputs are gone; without outputs, when all readers of its inputs are. Real-time path: yes, all
/// of a cycle; O(subdevices, and connected values), no allocation; one system call to send a
/// frame, one to receive each that has come, one that finds none before the cycle's first frame and
/// before each wait, and those of [`readable`](luna::external::readable) to wait.
#[must_use = "a link is a process: spawn it"]
pub struct BusProcess {
    parts: Parts,
    cycles: Cycles,
    neutral: Neutral,
    health: Arc<Health>,
    is_run: bool,
}

/// What the link was given.
pub(crate) struct Parts {
    pub(crate) name: String,
    pub(crate) period: Duration,
    pub(crate) patience: f64,
    pub(crate) tolerated: u32,
    pub(crate) start_limit: Duration,
    pub(crate) ends: Ends,
    /// Of set-points, in the order of the outputs.
    pub(crate) ages: Vec<Option<Duration>>,
    pub(crate) found: Vec<Found>,
    /// Until the outputs are safe at the end.
    pub(crate) device: Option<Device<BusDevice>>,
    pub(crate) kept: Vec<Box<dyn Any + Send>>,
}

impl BusProcess {
    pub(crate) fn new(
        parts: Parts,
        main: Box<MainDevice<'static>>,
        exchange: Exchange,
        running: Running,
        neutral: Neutral,
        follower: Option<Follower>,
    ) -> Self {
        let health = exchange.health.clone();
        let cycles = Cycles::new(&parts, main, exchange, running, neutral.clone(), follower);
        Self {
            parts,
            cycles,
            neutral,
            health,
            is_run: false,
        }
    }

    /// A handle that makes the bus safe: for [`on_emergency`](luna::System::on_emergency), unless
    /// the bus was opened by [`open`](crate::open()), which registers it.
    pub fn neutral(&self) -> Neutral {
        self.neutral.clone()
    }

    /// What it counts.
    pub fn health(&self) -> Arc<Health> {
        self.health.clone()
    }
}

impl Process for BusProcess {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        if !self.cycles.is_simulated() {
            // A failure here occurs again at the first wait, which reports it.
            let _ = luna::external::prepare_files();
        }
        async move {
            let ended = self.go_on().await;
            self.disarm();
            match ended {
                Ok(()) => Ok(()),
                Err(Stop::Luna(error)) => Err(error),
                Err(Stop::Fault(fault)) => Err(self.fail(fault)),
            }
        }
    }

    /// The outputs are safe, whatever has ended the link; then the bus can be opened again.
    fn post_run(&mut self) {
        self.disarm();
        self.parts.device = None;
        self.parts.kept.clear();
    }
}

impl Drop for BusProcess {
    fn drop(&mut self) {
        if !self.neutral.is_engaged() {
            self.disarm();
        }
    }
}

enum Stop {
    Luna(Error),
    Fault(Fault),
}

impl From<Fault> for Stop {
    fn from(fault: Fault) -> Stop {
        Stop::Fault(fault)
    }
}

impl BusProcess {
    /// Makes the bus safe. If the system refuses, the watchdogs remain.
    fn disarm(&self) {
        let _ = self.neutral.try_engage();
    }

    async fn go_on(&mut self) -> Result<(), Stop> {
        if std::mem::replace(&mut self.is_run, true) {
            return Err(Fault::RunTwice.into());
        }
        if Clock::is_virtual_here() && !self.cycles.is_simulated() {
            return Err(Fault::VirtualTime.into());
        }
        let mut tick = luna::periodic(&self.parts.name, self.parts.period).map_err(Stop::Luna)?;
        if self.cycles.follows() && tick.period() != self.parts.period {
            return Err(Fault::Period {
                configured: self.parts.period,
                given: tick.period(),
            }
            .into());
        }
        // A system file may have given the loop another period.
        if let Some(why) = wrong_period(tick.period(), &self.parts.ages) {
            return Err(Fault::Setting {
                given: tick.period(),
                why,
            }
            .into());
        }
        self.cycles
            .wait_for(tick.period().mul_f64(self.parts.patience));
        self.parts
            .ends
            .set_greatest_ages(&self.parts.ages, tick.period());
        loop {
            let slot = tick.next().await;
            self.health.cycles.add();
            let ends = &mut self.parts.ends;
            let have_ended = ends.take(self.cycles.is_driving())?;
            if have_ended || self.neutral.is_engaged() {
                return Ok(());
            }
            self.cycles.write(ends);
            let time = self.cycles.exchange().await?;
            // The subdevices have left OP for it.
            if self.neutral.is_engaged() {
                return Ok(());
            }
            let is_read = self.cycles.judge(ends).await?;
            if !is_read && ends.outputs.is_empty() {
                return Ok(());
            }
            self.cycles.follow(&mut tick, &slot, time);
        }
    }

    /// Ends a link that cannot go on. First its channels are poisoned: no process that runs for the
    /// emergency receives an old value.
    fn fail(&self, fault: Fault) -> Error {
        self.parts.ends.poison();
        // It allocates; there is nothing left to be in time for.
        luna::realtime::off_path(|| match &self.parts.device {
            Some(device) => device.lost(Error::other(fault)),
            None => luna::emergency(Error::other(fault)),
        })
    }
}

luna_platform::debug_fields!(
    BusProcess, |process|
    name: process.parts.name,
    health: process.health
);

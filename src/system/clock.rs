//! The clock of a system: the machine's, or one of its own.

use super::System;
use crate::error::{Error, Result};
use crate::time::{StampClock, StampError, StampSource};
use luna_core::{ClockDriver, DrivenClock, Pace, ProcessRegistry, Simulation};
use std::fmt;
use std::sync::Arc;

/// How many turns are taken at one instant of a virtual clock before that is called a livelock, if
/// not stated.
const MAX_TURNS: u64 = 1_000_000_000;

/// The clock that a system is to go by.
#[derive(Debug, Default)]
pub(crate) enum ClockPlan {
    #[default]
    Real,
    Virtual,
    Driven(DrivenClock),
}

impl ClockPlan {
    pub(crate) fn kind(&self) -> ClockKind {
        match self {
            ClockPlan::Real => ClockKind::Real,
            ClockPlan::Virtual => ClockKind::Virtual,
            ClockPlan::Driven(_) => ClockKind::Driven,
        }
    }

    /// Starts what runs the processes, unless that is threads of their own.
    pub(super) fn start(
        self,
        registry: &Arc<ProcessRegistry>,
        most_turns: Option<u64>,
    ) -> Result<Option<Simulation>> {
        let pace = match self {
            ClockPlan::Real => return Ok(None),
            ClockPlan::Virtual => Pace::Jumping,
            ClockPlan::Driven(clock) => Pace::Driven(clock),
        };
        Simulation::start(pace, registry.clone(), most_turns.unwrap_or(MAX_TURNS))
            .map(Some)
            .map_err(|error| Error::not_started("the virtual clock", error))
    }
}

/// The clock of a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum ClockKind {
    /// The machine's.
    #[default]
    Real,
    /// One that jumps to the next deadline when no process can run:
    /// [`System::virtual_clock`](crate::System::virtual_clock).
    Virtual,
    /// One that a simulator moves: [`System::driven_clock`](crate::System::driven_clock).
    Driven,
}

impl ClockKind {
    /// Whether its time is not the machine's.
    pub fn is_virtual(self) -> bool {
        self != ClockKind::Real
    }
}

impl fmt::Display for ClockKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ClockKind::Real => "real",
            ClockKind::Virtual => "virtual",
            ClockKind::Driven => "driven",
        })
    }
}

impl System {
    /// Runs the system on a clock of its own: when no process can run, time jumps to the next
    /// deadline, so hours take moments, and every run is the same.
    ///
    /// Processes, loops, delays and timeouts behave as on the real clock; only the threads differ.
    /// One thread runs all executors and OS-thread processes, the one of the highest policy first,
    /// of equals the one that was described first. Computing takes no time. Policies, cores and
    /// locked memory are not requested. A blocking call within an OS-thread process stops all, so
    /// it goes through [`blocking`](crate::blocking), and one that waits for a channel panics as on
    /// an executor. `docs/time.md` describes the rest.
    ///
    /// Call it before the executors and threads are described: later descriptions may name cores
    /// that this machine has not.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use std::time::Duration;
    ///
    /// let mut system = System::new("simulated");
    /// system.virtual_clock();
    /// let main = system.executor("main").build()?;
    /// main.process("patient").spawn(async {
    ///     luna::after(Duration::from_secs(24 * 3600)).await;
    ///     Ok(())
    /// })?;
    /// assert_eq!(system.run()?.elapsed, Duration::from_secs(24 * 3600));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn virtual_clock(&mut self) -> &mut Self {
        self.plan.settings().clock = ClockPlan::Virtual;
        self
    }

    /// States which clock the system's stamps are of, those that other computers read: checks it,
    /// and gives their source, for the links to those computers. The report then says how good it
    /// was. A system that states none has stamps of CLOCK_MONOTONIC.
    ///
    /// # Errors
    ///
    /// For TAI a [`StampError`]: nothing keeps it on this machine, or the system runs on a virtual
    /// clock.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::time::StampClock;
    ///
    /// let mut system = System::new("arm");
    /// // On a machine that PTP or NTP keeps: `StampClock::Tai`.
    /// let stamps = system.stamp_clock(StampClock::Monotonic)?;
    /// let main = system.executor("main").build()?;
    /// main.process("arm").spawn(async move {
    ///     println!("{:?}", stamps.now());
    ///     Ok(())
    /// })?;
    /// let report = system.run()?;
    /// assert_eq!(report.stamps.unwrap().at_first.clock, StampClock::Monotonic);
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn stamp_clock(&mut self, clock: StampClock) -> Result<StampSource, StampError> {
        let mut settings = self.plan.settings();
        if clock == StampClock::Tai && settings.clock.kind().is_virtual() {
            return Err(StampError::VirtualClock);
        }
        let source = clock.source()?;
        settings.stamps = Some(source.state()?);
        Ok(source)
    }

    /// Runs the system on a clock that moves only as a simulator commands, in lock-step with it;
    /// the rest is as with a [virtual clock](Self::virtual_clock). The simulator keeps the driver.
    /// If that is dropped, the processes that still live are cancelled, and the system ends as
    /// [`End::Undriven`](crate::End::Undriven). A second call makes a new clock; the driver of the
    /// first is notified that its system has ended.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::End;
    /// use std::sync::Arc;
    /// use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
    /// use std::time::Duration;
    ///
    /// let period = Duration::from_millis(1);
    /// let mut system = System::new("plant and controller");
    /// let mut driver = system.driven_clock();
    /// let cycles = Arc::new(AtomicU64::new(0));
    /// let counted = cycles.clone();
    /// let main = system.executor("main").build()?;
    /// main.process("controller").spawn(async move {
    ///     let mut tick = luna::periodic("control", period)?;
    ///     loop {
    ///         tick.next().await;
    ///         counted.fetch_add(1, Relaxed);
    ///     }
    /// })?;
    /// let simulator = std::thread::spawn(move || {
    ///     for step in 1..=1000 {
    ///         driver.advance_by(period)?;
    ///         assert_eq!(cycles.load(Relaxed), step);
    ///     }
    ///     Ok::<(), luna::system::DriveError>(())
    /// });
    /// let report = system.run()?;
    /// simulator.join().unwrap().unwrap();
    /// assert_eq!((report.end, report.elapsed), (End::Undriven, Duration::from_secs(1)));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn driven_clock(&mut self) -> ClockDriver {
        let (driver, clock) = ClockDriver::new();
        let former = std::mem::replace(&mut self.plan.settings().clock, ClockPlan::Driven(clock));
        drop(former);
        if self.plan.has_begun() {
            // The clock will never be used: its driver is notified.
            self.plan.settings().clock = ClockPlan::Real;
        }
        driver
    }

    /// Sets the highest number of polls at one instant of a virtual clock, at least one; 1 000 000
    /// 000 if not stated. Time does not move while any process can run, so a process that yields
    /// for ever would stop it for good. After that many polls the system ends with
    /// [`Error::Livelock`]. Does nothing on the real clock.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna::Error;
    ///
    /// let mut system = System::new("restless");
    /// system.virtual_clock().most_turns_at_an_instant(1000);
    /// let main = system.executor("main").build()?;
    /// main.process("spinner").spawn(async {
    ///     let start = luna::now();
    ///     while luna::now() == start {
    ///         luna::yield_now().await;
    ///     }
    ///     Ok(())
    /// })?;
    /// assert!(matches!(system.run(), Err(Error::Livelock { turns: 1000, .. })));
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn most_turns_at_an_instant(&mut self, turns: u64) -> &mut Self {
        self.plan.settings().most_turns = Some(turns.max(1));
        self
    }
}

//! The report of a system that has ended, and its parts.
//!
//! [`Report`] is what [`System::run`](crate::System::run) returns. What each subject reports is
//! here too: loops and their late cycles, budgets, timers, safety, logging, replay.
//!
//! ```
//! use luna::prelude::*;
//! use luna::report::{End, LoopReport, Report};
//! use std::time::Duration;
//!
//! let mut system = System::new("servo");
//! let main = system.executor("main").build()?;
//! main.process("loop").spawn(async {
//!     let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
//!     for _ in 0..5 {
//!         tick.next().await;
//!     }
//!     Ok(())
//! })?;
//! let report: Report = system.run()?;
//! assert_eq!(report.end, End::Completed);
//! let one: &LoopReport = &report.loops["loop"];
//! assert_eq!(one.cycles, 5);
//! println!("at most {:?} late", one.wake_latency.max());
//! # Ok::<(), luna::Error>(())
//! ```

pub use crate::csp::failed_at::EndedAt;
pub use crate::safety::budget::BudgetReport;
pub use crate::safety::emergency::{FunctionOutcome, FunctionReport};
pub use crate::safety::report::SafetyReport;
pub use crate::time::accounting::UsageSince;
pub use crate::time::late_cycle::{LateCause, LateCauseKind, LateCycle, RanInstead, StolenTime};
pub use crate::time::manager::{CallbackReport, TimersReport};
pub use crate::time::stamp::StampReport;
pub use crate::time::statistics::{Distribution, LoopReport};
pub use luna_config::deployment::{DeploymentReport, Override};
#[cfg(feature = "events")]
pub use luna_logger::EventsReport;
#[cfg(feature = "logger")]
pub use luna_logger::{LoggingReport, MessagesReport, SignalReport};
pub use luna_machine::facts::RealTimeShare;
pub use luna_machine::shortfall::Shortfall;
pub use luna_machine::usage::ThreadUsage;
pub use luna_replay::RecordReport;

use crate::system::{ClockKind, Member};
use crate::time::{how_to_find_out, short};
use luna_core::Exit;
use luna_error::Deadlock;
use luna_machine::signals;
use luna_platform::thread::Policy;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

/// How many ends at channels the table shows.
const ENDS_SHOWN: usize = 8;
/// How many late cycles of a loop the table shows.
const CYCLES_SHOWN: usize = 2;

/// What a system did. Its `Display` is a table: a row for each thread and each loop, overruns of
/// budgets, and the causes of the latest cycles.
///
/// ```
/// use luna::prelude::*;
/// use luna::{End, Exit};
///
/// let mut system = System::new("greeter");
/// let main = system.executor("main").build()?;
/// main.process("hello").spawn(async { Ok(()) })?;
/// let report = system.run()?;
/// assert_eq!(report.end, End::Completed);
/// assert_eq!(report.processes[0].exit, Some(Exit::Completed));
/// assert!(report.to_string().contains("main"));
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Report {
    /// The system's name.
    pub system: String,
    /// How the system came to its end.
    pub end: End,
    /// Which clock it went by.
    pub clock: ClockKind,
    /// The clock of its stamps, if it has [stated](crate::System::stamp_clock) one.
    pub stamps: Option<StampReport>,
    /// From the release of the processes until the last one had ended, on the system's clock.
    pub elapsed: Duration,
    /// The same on the machine's: what a system on a virtual clock really took.
    pub really_elapsed: Duration,
    /// The executors and OS threads, in the order of their making, with what they obtained.
    pub threads: Vec<ThreadReport>,
    /// The processes, in the order of their spawning; but those that were spawned on an executor
    /// while the system ran and ended long before its end are only counted, in `earlier`.
    pub processes: Vec<ProcessReport>,
    /// What became of the others, if there were more than the system
    /// [remembers](crate::System::remember_ended).
    pub earlier: EarlierProcesses,
    /// The channels at which processes have ended, since an operation found them closed or
    /// poisoned: the first 64.
    pub ended_at: Vec<EndedAt>,
    /// The periodic loops, by their names.
    pub loops: BTreeMap<String, LoopReport>,
    /// The processes that others [stood in](crate::System::stand_in) for, by name.
    pub stand_ins: Vec<String>,
    /// The [system file](crate::System::deployment_from), if there was one, with what it has
    /// changed.
    pub deployment: Option<DeploymentReport>,
    /// What the system as a whole was not given: locked memory, short wake-ups, the emergency
    /// manager's priority.
    pub shortfalls: Vec<Shortfall>,
    /// The deadlock that the system came to, if it did. A thread outside of it may have ended that
    /// later.
    pub deadlock: Option<Deadlock>,
    /// What the timer manager did, if the system has one.
    pub timers: Option<TimersReport>,
    /// How safe it was, and how it went with the emergency functions.
    pub safety: SafetyReport,
    /// What became of the log of signals and messages, if there was one.
    #[cfg(feature = "logger")]
    pub logging: Option<LoggingReport>,
    /// The recording or replay, if there was one.
    pub record: Option<RecordReport>,
    /// SIGINT, SIGTERM or SIGHUP came when the processes had ended and the emergency functions
    /// could not run any more: it ended the wait for what records the run, and has no other effect,
    /// unless the program has a handler of its own for it. A program that would run another system
    /// is to end instead.
    pub late_signal: Option<i32>,
}

/// How a system came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum End {
    /// All processes ended by themselves.
    #[default]
    Completed,
    /// A signal came (SIGINT is 2, SIGTERM 15, SIGHUP 1): the emergency functions ran, then all
    /// processes were cancelled.
    Signal(i32),
    /// A process panicked: the emergency functions ran, then all others were cancelled.
    Panic,
    /// Every process waited for another, and the system was [`strict`](crate::System::strict): the
    /// emergency functions ran, then all were cancelled.
    Deadlock,
    /// A process overran a budget with the policy
    /// [`OnOverrun::Emergency`](crate::safety::OnOverrun::Emergency): the emergency functions ran,
    /// then all were cancelled.
    Overrun,
    /// A process raised it by [`luna::emergency`](crate::emergency()), a driver by
    /// [`Safety::raise`](crate::safety::Safety::raise), or the parent process died: the emergency
    /// functions ran, then all others were cancelled.
    Emergency,
    /// The [`ClockDriver`](crate::system::ClockDriver) was dropped, so time would never have gone
    /// on: the processes that still lived were cancelled.
    Undriven,
    /// More turns were taken at one instant of a virtual clock than
    /// [allowed](crate::System::most_turns_at_an_instant): all processes were cancelled.
    Livelock,
}

/// An executor or OS thread.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ThreadReport {
    /// Its name.
    pub name: String,
    /// The policy that it had, read back from the system.
    pub policy: Policy,
    /// The core that it was pinned to.
    pub core: Option<usize>,
    /// What was requested and not granted.
    pub shortfalls: Vec<Shortfall>,
    /// Whether it did not end within the time that the end of a system is given, and was left to
    /// itself.
    pub abandoned: bool,
    /// How long it had the processor from the release of its processes to their end, as the kernel
    /// counts it: what the processes did, and what it took to dispatch them, to put the thread to
    /// sleep and to wake it. `None` where the system does not count it, on a virtual clock, and for
    /// a detached thread.
    pub processor_time: Option<Duration>,
    /// How much of its core real-time threads may have, if this one has used that up, to within 2 %
    /// of the run: then it stood still until the kernel's period was over. `None` in a run that is
    /// shorter than a period, and where the kernel does not say.
    pub limit: Option<RealTimeShare>,
}

/// A process.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ProcessReport {
    /// Its name.
    pub name: String,
    /// How it ended; `None` if it did not.
    pub exit: Option<Exit>,
    /// Whether it ended with an error: one that its body returned, although that counts as
    /// [`Exit::Completed`], or a cancellation, an overrun or a panic.
    pub failed: bool,
    /// How often it was given the processor.
    pub polls: u64,
    /// The longest that it kept it, if its polls were timed.
    pub longest_poll: Option<Duration>,
    /// How it kept each of its budgets.
    pub budgets: Vec<BudgetReport>,
}

/// What became of the processes that a system does not remember one by one.
///
/// ```
/// use luna::prelude::*;
///
/// let mut system = System::new("many");
/// system.remember_ended(10);
/// let main = system.executor("main").build()?;
/// let own = main.clone();
/// main.process("parent").spawn(async move {
///     for number in 0..25 {
///         let child = own.process(&format!("child {number}")).spawn(async { Ok(()) })?;
///         own.process_handle(child).expect("it has just been spawned").join().await;
///     }
///     Ok(())
/// })?;
/// let report = system.run()?;
/// assert_eq!(report.processes.len(), 11); // the parent and ten of its children
/// assert_eq!((report.earlier.number(), report.earlier.completed), (15, 15));
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct EarlierProcesses {
    /// How many returned, without an error.
    pub completed: u64,
    /// How many returned an error, or were ended for an overrun of a loop.
    pub failed: u64,
    /// How many were cancelled.
    pub cancelled: u64,
    /// How many panicked.
    pub panicked: u64,
    /// How often all of them together were given the processor.
    pub polls: u64,
    /// The longest poll of one process, of those that were timed.
    pub longest_poll: Option<Duration>,
    /// How often all of them together overran a budget.
    pub overruns: u64,
}

impl EarlierProcesses {
    /// How many there were.
    pub fn number(&self) -> u64 {
        self.completed + self.failed + self.cancelled + self.panicked
    }

    /// Counts one that has ended, with an error of its own or without.
    #[inline]
    pub(crate) fn count(&mut self, process: &Member, overruns: u64) {
        let handle = &process.handle;
        let as_what = match handle.exit() {
            Some(Exit::Panicked(_)) => &mut self.panicked,
            Some(Exit::Cancelled) => &mut self.cancelled,
            _ if process.has_failed => &mut self.failed,
            _ => &mut self.completed,
        };
        *as_what += 1;
        self.polls += handle.polls();
        self.longest_poll = self.longest_poll.max(handle.longest_poll());
        self.overruns += overruns;
    }
}

impl fmt::Display for EarlierProcesses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} processes that ended earlier: {} completed",
            self.number(),
            self.completed
        )?;
        let others = [
            (self.failed, "failed"),
            (self.cancelled, "cancelled"),
            (self.panicked, "panicked"),
        ];
        for (number, what) in others.into_iter().filter(|(number, _)| *number > 0) {
            write!(f, ", {number} {what}")?;
        }
        if self.overruns > 0 {
            write!(f, ", {} overruns", self.overruns)?;
        }
        Ok(())
    }
}

impl Report {
    /// Every request that was not granted, with the name of its executor, thread or process.
    pub fn all_shortfalls(&self) -> impl Iterator<Item = (&str, &Shortfall)> {
        let of_system = self.shortfalls.iter().map(|one| ("system", one));
        let of_threads = self.threads.iter().flat_map(|thread| {
            let shortfalls = thread.shortfalls.iter();
            shortfalls.map(|one| (thread.name.as_str(), one))
        });
        of_system.chain(of_threads)
    }
}

/// As in the first line of a report: "completed", "ended by a panic".
impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            End::Completed => f.write_str("completed"),
            End::Signal(number) => write!(f, "ended by {}", signals::name(*number)),
            End::Panic => f.write_str("ended by a panic"),
            End::Deadlock => f.write_str("ended by a deadlock"),
            End::Overrun => f.write_str("ended by an overrun"),
            End::Emergency => f.write_str("ended by an emergency"),
            End::Undriven => f.write_str("ended with the driver of its clock"),
            End::Livelock => f.write_str("ended by a livelock"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "system `{}`: {} after {:.3} s",
            self.system,
            self.end,
            self.elapsed.as_secs_f64()
        )?;
        if self.clock.is_virtual() {
            write!(
                f,
                " on a {} clock, which took {:.3} s; policies, cores and locked memory were not asked for",
                self.clock,
                self.really_elapsed.as_secs_f64()
            )?;
        }
        writeln!(f)?;
        if let Some(number) = self.late_signal {
            let name = signals::name(number);
            writeln!(
                f,
                "  {name} came after the end, and ended the wait for recordings"
            )?;
        }
        if let Some(stamps) = &self.stamps {
            writeln!(f, "  {stamps}")?;
        }
        if !self.stand_ins.is_empty() {
            writeln!(f, "stand-ins for: {}", self.stand_ins.join(", "))?;
        }
        for thread in &self.threads {
            if self.clock.is_virtual() && !thread.abandoned {
                writeln!(
                    f,
                    "  {:<16} on the thread of the {} clock",
                    thread.name, self.clock
                )?;
                continue;
            }
            let core = thread
                .core
                .map_or("any core".to_owned(), |core| format!("core {core}"));
            let abandoned = if thread.abandoned {
                ", did not end and was left to itself"
            } else {
                ""
            };
            writeln!(
                f,
                "  {:<16} {}, {core}{abandoned}",
                thread.name, thread.policy
            )?;
            if let (Some(limit), Some(time)) = (&thread.limit, thread.processor_time) {
                let percent = 100.0 * time.as_secs_f64() / self.really_elapsed.as_secs_f64();
                writeln!(
                    f,
                    "  {} had {core} for {percent:.1} % of the run. Real-time threads may have {limit}, \
                     then they stand still: docs/realtime.md#throttling",
                    thread.name
                )?;
            }
        }
        if let Some(deployment) = &self.deployment {
            writeln!(f, "  {}", deployment.to_string().replace('\n', "\n  "))?;
        }
        for (who, shortfall) in self.all_shortfalls() {
            // The remedy was printed at the start.
            writeln!(
                f,
                "  best effort: {who}: no {}: {}",
                shortfall.what(),
                shortfall.why()
            )?;
        }
        if let Some(deadlock) = &self.deadlock {
            writeln!(f, "  {}", deadlock.to_string().replace('\n', "\n  "))?;
        }
        for process in &self.processes {
            for budget in process.budgets.iter().filter(|one| one.overruns > 0) {
                writeln!(f, "  process `{}`: {budget}", process.name)?;
            }
        }
        for end in self.ended_at.iter().take(ENDS_SHOWN) {
            writeln!(f, "  {end}")?;
        }
        if self.ended_at.len() > ENDS_SHOWN {
            let more = self.ended_at.len() - ENDS_SHOWN;
            writeln!(f, "  {more} more ended at channels: Report::ended_at")?;
        }
        self.safety.fmt(f)?;
        if self.earlier.number() > 0 {
            writeln!(f, "  {}", self.earlier)?;
        }
        if let Some(timers) = &self.timers {
            writeln!(f, "  {}", timers.to_string().replace('\n', "\n  "))?;
        }
        #[cfg(feature = "logger")]
        if let Some(recording) = &self.logging {
            writeln!(f, "  {}", recording.to_string().replace('\n', "\n  "))?;
        }
        if self.loops.is_empty() {
            return Ok(());
        }
        writeln!(f)?;
        writeln!(
            f,
            "{:<16} {:>9} {:>9} {:>7} | {:>36} | {:>30}",
            "loop", "period", "cycles", "missed", "wake-up latency, µs", "cycle time, µs"
        )?;
        writeln!(
            f,
            "{:<16} {:>9} {:>9} {:>7} | {:>8} {:>8} {:>8} {:>9} | {:>9} {:>8} {:>11}",
            "", "µs", "", "", "p50", "p99", "p99.9", "max", "mean", "stddev", "max"
        )?;
        for (name, one) in &self.loops {
            let (wake, cycle) = (&one.wake_latency, &one.cycle_time);
            writeln!(
                f,
                "{:<16} {:>9} {:>9} {:>7} | {:>8} {:>8} {:>8} {:>9} | {:>9.1} {:>8.1} {:>11}",
                name,
                micros(one.period),
                one.cycles,
                one.missed,
                percentile(wake, 50.0),
                percentile(wake, 99.0),
                percentile(wake, 99.9),
                micros(wake.max()),
                cycle.mean_nanos() / 1e3,
                cycle.stddev_nanos() / 1e3,
                micros(cycle.max()),
            )?;
        }
        for (name, one) in self.loops.iter().filter(|(_, one)| one.late > 0) {
            writeln!(
                f,
                "{name}: {} of {} cycles more than {} late, the worst:",
                one.late,
                one.cycles,
                short(one.late_after)
            )?;
            for cycle in one.late_cycles.iter().take(CYCLES_SHOWN) {
                writeln!(f, "  {cycle}")?;
            }
        }
        let shown = self
            .loops
            .values()
            .flat_map(|one| one.late_cycles.iter().take(CYCLES_SHOWN));
        if let Some(line) = how_to_find_out(shown) {
            writeln!(f, "{line}")?;
        }
        Ok(())
    }
}

fn percentile(times: &Distribution, percent: f64) -> String {
    micros(times.percentile(percent))
}

fn micros(duration: Duration) -> String {
    format!("{:.1}", duration.as_nanos() as f64 / 1e3)
}

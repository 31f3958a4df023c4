//! LUNA: a hard real-time, multi-core, CSP-capable execution framework for Linux.
//!
//! A machine's software is written as *processes*: async functions that communicate over *channels*
//! and nothing else. A [`System`] defines in one place where each of them runs: on an *executor*,
//! which is one OS thread, pinned to a core, with a scheduling policy of its own, that runs many
//! processes by priority; or on an OS thread alone. Periodic loops wait for absolute slots
//! ([`periodic`]) and keep histograms of their latencies, which are in the [`Report`].
//!
//! ```
//! use luna::prelude::*;
//! use std::time::Duration;
//!
//! let mut system = System::new("servo");
//! let control = system.executor("control").core(0).policy(Policy::fifo(80)).build()?;
//! let (setpoint, setpoints) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
//!
//! control.process("loop").priority(20).spawn(async move {
//!     let mut tick = luna::periodic("loop", Duration::from_millis(1))?;
//!     let mut target = 0.0;
//!     while target < 1.0 {
//!         tick.next().await;
//!         if let Ok(new) = setpoints.try_recv() {
//!             target = new;
//!         }
//!     }
//!     Ok(())
//! })?;
//! system.thread("console").process("operator").spawn(async move {
//!     setpoint.send(1.0).await?;
//!     Ok(())
//! })?;
//!
//! let report = system.run()?; // where a policy is refused, it says so and does its best
//! assert!(report.loops["loop"].cycles >= 1);
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! Channels, alternatives, barriers and locks come from the crate `luna-channels`, which can be
//! used alone, and their examples on these pages name it: read `luna` for `luna_channels` there,
//! since what they name is here under the same name ([`sync`] is `luna_channels::lock_sync`).
//! Signals are those of `luna-logger`; the hub and the recorder in their examples are what a
//! [`System`] makes.

mod csp;
#[cfg(unix)]
pub mod devices;
mod error;
#[cfg(unix)]
pub mod external;
mod logging;
mod notice;
pub mod parameters;
pub mod prelude;
pub mod record;
mod report;
mod safety;
mod system;
mod time;

pub use csp::composition::{self, Composition};
pub use csp::named::{Named, named};
pub use csp::par::{ParAll, par_all, par_for};
pub use csp::process::{IntoProcess, Process, run};
pub use error::{Error, Errors, OtherError, Result, SetupError, Several};
#[cfg(feature = "events")]
pub use logging::EventsReport;
#[cfg(feature = "logger")]
pub use logging::{
    FileSink, Logging, LoggingReport, MessagesReport, SignalReport, Sink, StartError, TcpSink, Tee,
    UdpSink, WriterSink, install_facades,
};
pub use logging::{Level, RegisterError, Sample, Signal, SignalBuilder, message};
pub use luna_channels::lock_sync as sync;
pub use luna_channels::{AcceptOp, Call, CallError, CallOp, Client, Reply, Server, call_channel};
pub use luna_channels::{
    After, Buffer, BufferError, Extended, Guard, Incoming, Receiver, RecvError, RecvOp,
    RecvTimeout, RecvTimeoutError, SendError, SendOp, SendTimeout, SendTimeoutError, Sender,
    TryRecvError, TrySendError, When, after, alt, at, buffered, channel, inspect, pri_alt,
    try_buffered,
};
pub use luna_channels::{
    Alternative, AlternativeRecv, Barrier, ChannelEnd, Ended, LocalBarrier, LocalSync, Party,
    SyncOp,
};
pub use luna_core::current::{ProcessId, on_path, refused_boosts};
pub use luna_core::path::off_path;
pub use luna_executors::{
    Blocking, ClockDriver, DriveError, Exit, Join, ProcessHandle, ProcessState, YieldNow, blocking,
    yield_now,
};
#[cfg(unix)]
pub use luna_executors::{FileError, FileReady, prepare_files, readable, writable};
pub use luna_platform::panics::catch as catch_panic;
pub use luna_platform::shortfall::Shortfall;
pub use luna_platform::thread::{AttributeError, Policy, PolicyError};
pub use luna_platform::usage::ThreadUsage;
pub use parameters::{Parameter, ParameterBuilder, Parameters};
pub use report::{EarlierProcesses, End, ProcessReport, Report, ThreadReport};
pub use safety::{Bite, Watchdog, WatchdogProcess};
pub use safety::{BudgetKind, BudgetOverrun, BudgetReport, OnOverrun};
pub use safety::{
    Cause, Degree, EmergencyTrigger, FunctionOutcome, FunctionReport, Guardian, ResetError,
    SafeStateEntered, Safety, SafetyEvent, SafetyFunction, SafetyReport, SafetyState, emergency,
    guard, safety,
};
pub use system::deadlock::{self, Deadlock};
pub use system::{ClockKind, Executor, ExecutorBuilder, Observer, ProcessBuilder, System, Thread};
pub use time::{
    CallbackReport, Cycle, Distribution, Expiry, Firing, Instant, LateCause, LateCauseKind,
    LateCycle, LoopReport, NextTick, Overrun, Periodic, RanInstead, StolenTime, Tick, TickReport,
    Ticks, Timer, TimerCallback, TimerManager, Timers, TimersReport, UsageSince, now, periodic,
    ticks,
};

#[doc(hidden)]
pub use csp::par as __par;

/// The guide's programs are tests.
#[cfg(doctest)]
#[doc = include_str!("../docs/guide.md")]
struct Guide;

#[cfg(doctest)]
#[doc = include_str!("../docs/loops.md")]
struct LoopsPage;

#[cfg(doctest)]
#[doc = include_str!("../docs/budgets.md")]
struct BudgetsPage;

#[cfg(doctest)]
#[doc = include_str!("../docs/failures.md")]
struct FailuresPage;

#[cfg(doctest)]
#[doc = include_str!("../docs/safety.md")]
struct SafetyPage;

#[cfg(doctest)]
#[doc = include_str!("../docs/time.md")]
struct TimePage;

#[cfg(all(doctest, feature = "toml"))]
#[doc = include_str!("../docs/parameters.md")]
struct ParametersPage;

#[cfg(all(doctest, feature = "logger"))]
#[doc = include_str!("../docs/logger.md")]
struct LoggerPage;

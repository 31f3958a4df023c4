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
//! # Where a name is
//!
//! Each name is in one module. The root has the 43 that most programs write as well: the system and
//! its end ([`System`], [`Executor`], [`Policy`], [`Report`], [`End`]), processes and their
//! composition ([`Process`], [`run`], [`par!`], [`named`], [`blocking`], [`yield_now`], [`Exit`]),
//! channels, their ends and the errors of send and receive, choice ([`alt!`], [`pri_alt!`],
//! [`Alternative`]), [`Barrier`], time ([`now`], [`after`], [`at`], [`periodic`], [`ticks`],
//! [`Timer`]), [`Parameter`], [`Signal`], [`emergency`], [`Error`] and [`Result`]. The
//! [`prelude`] has the types among them that a program names again and again.
//!
//! What a program names once or never is in a module alone: futures and guards that operations
//! return, parts of the report, what configures or observes a system, and subjects that not every
//! program has (safety, logging, replay, devices). Names that mean the same as in std, tokio or
//! futures are theirs.
//!
//! Channels, alternatives, barriers and locks come from the crate `luna-channels`, which can be
//! used alone, and their examples on these pages name it: read `luna` for `luna_channels` there,
//! since what they name is here too ([`sync`] has what is in `luna_channels::lock_sync`). Signals
//! are those of `luna-logger`; the hub and the recorder in their examples are what a [`System`]
//! makes.

pub mod alternative;
pub mod channel;
mod csp;
#[cfg(unix)]
pub mod devices;
pub mod error;
#[cfg(unix)]
pub mod external;
pub mod inspect;
pub mod log;
mod notice;
pub mod parameters;
pub mod prelude;
pub mod process;
pub mod realtime;
pub mod replay;
pub mod report;
pub mod safety;
pub mod sync;
pub mod system;
pub mod time;

#[doc(inline)]
pub use alternative::{Alternative, alt, pri_alt};
#[doc(inline)]
pub use channel::{
    Buffer, Receiver, RecvError, RecvTimeoutError, SendError, SendTimeoutError, Sender,
    TryRecvError, TrySendError, buffered, channel,
};
#[doc(inline)]
pub use error::{Error, Result};
#[doc(inline)]
pub use log::Signal;
#[doc(inline)]
pub use parameters::Parameter;
#[doc(inline)]
pub use process::{Exit, Process, blocking, named, par_all, par_for, run, yield_now};
#[doc(inline)]
pub use report::{End, Report};
#[doc(inline)]
pub use safety::emergency;
#[doc(inline)]
pub use sync::Barrier;
#[doc(inline)]
pub use system::{Executor, Policy, System};
#[doc(inline)]
pub use time::{Instant, Periodic, Timer, after, at, now, periodic, ticks};

#[doc(hidden)]
pub use luna_config::file;

#[doc(hidden)]
#[allow(deprecated, reason = "their names stay for one release")]
pub use sync::{LocalBarrier, LocalSync};

#[doc(hidden)]
pub use csp::par as __par;

/// The programs on the pages of the documentation are tests.
#[cfg(doctest)]
#[doc = include_str!("../docs/processes-and-channels.md")]
#[doc = include_str!("../docs/loops.md")]
#[doc = include_str!("../docs/budgets.md")]
#[doc = include_str!("../docs/failures.md")]
#[doc = include_str!("../docs/safety.md")]
#[doc = include_str!("../docs/time.md")]
#[doc = include_str!("../docs/clocks.md")]
#[cfg_attr(feature = "toml", doc = include_str!("../docs/parameters.md"))]
#[cfg_attr(feature = "toml", doc = include_str!("../docs/system-file.md"))]
#[cfg_attr(feature = "logger", doc = include_str!("../docs/logger.md"))]
struct Pages;

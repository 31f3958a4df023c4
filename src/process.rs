//! Processes: what can be one, how processes are composed, and how one ends.
//!
//! A process is an async block or a type with three phases ([`Process`]). [`par!`](crate::par) runs
//! branches in parallel, [`par_all`] and [`par_for`] collections of them; [`run`] runs one process
//! without a [`System`](crate::System). A [`ProcessHandle`] stands for a process that was spawned.
//!
//! ```
//! use luna::prelude::*;
//! use luna::process::{Exit, ProcessState};
//!
//! let mut system = System::new("handles");
//! let main = system.executor("main").build()?;
//! let id = main.process("child").spawn(async { Ok(()) })?;
//! system.run()?;
//! let child = system.process_handle(id).expect("it was spawned");
//! assert_eq!(child.state(), ProcessState::Ended);
//! assert_eq!(child.exit(), Some(Exit::Completed));
//! # Ok::<(), luna::Error>(())
//! ```

pub use crate::csp::named::{Named, named};
pub use crate::csp::par::{ParAll, par_all, par_for};
pub use crate::csp::process::{IntoProcess, Process};
pub use crate::csp::supervised::run;
pub use luna_core::current::ProcessId;
pub use luna_core::{
    Blocking, Exit, Join, ProcessHandle, ProcessState, YieldNow, blocking, yield_now,
};

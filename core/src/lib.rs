//! The core of LUNA: processes, the executors that run them, and what the constructs between
//! processes are made of.
//!
//! An [`Executor`] is one OS thread that runs many prioritized processes, each an async block; an
//! [`OsThread`] runs one process alone, which may make blocking calls; [`block_on`] runs one on the
//! calling thread. A blocking call from a process of an executor goes to a buddy thread:
//! [`blocking`]; one that waits for files and sockets awaits [`readable`] and [`writable`].
//! Processes are seen from outside through a [`ProcessHandle`].
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use luna_core::{Executor, Exit, ProcessSpec, yield_now};
//! use luna_platform::thread::Attributes;
//!
//! let executor = Executor::start(Attributes::new("control"))?;
//! let process = executor.spawn(ProcessSpec::new("counter").level(20), || async {
//!     for _ in 0..3 {
//!         yield_now().await;
//!     }
//! });
//! executor.release();
//! assert_eq!(process.wait(), Exit::Completed);
//! assert_eq!(process.polls(), 4);
//! # Ok(()) }
//! ```
//!
//! - [`current`]: the process that this thread polls, how it is woken, and its priority. Only this
//!   module knows how a process becomes ready.
//! - [`wait_list`], [`timer_queue`]: intrusive lists of waiting operations, and deadlines.
//! - [`biased_lock`]: the lock of channels, select states and timer queues, biased towards the
//!   executor that alone uses it.
//! - [`deferred_free`]: memory off the real-time path.
//! - [`park`], [`spin`]: how threads wait and spin.
//! - [`events`], [`replay_log`], [`path`]: recording, replaying and checking a run.
//! - `model_local` (private): thread-locals that a model checker sees.

#![cfg_attr(
    not(feature = "std"),
    no_std,
    allow(dead_code, reason = "files and simulations use a part"),
    allow(
        rustdoc::broken_intra_doc_links,
        reason = "the pages speak of what `std` has"
    )
)]
#![allow(
    clippy::new_without_default,
    reason = "what is made here belongs to one thread or system: made on purpose, not by default"
)]

// The model is the same whichever tool checks it: shuttle has loom's names.
#[cfg(shuttle)]
extern crate shuttle as loom;

extern crate alloc;

#[cfg(all(test, not(feature = "std")))]
compile_error!("the unit tests need `std`: tests without it are in the package `luna-bare`");

#[cfg(not(loom))]
mod arc_cache;
pub mod biased_lock;
pub mod current;
pub mod deferred_free;
pub mod events;
mod model_local;
pub mod park;
pub mod path;
pub mod replay_log;
pub mod spin;
pub mod timer_queue;
pub mod wait_list;
pub mod waiting;

#[cfg_attr(loom, allow(dead_code, reason = "the models use a part"))]
mod inbound;
#[cfg_attr(loom, allow(dead_code, reason = "the models use a part"))]
mod quiescence;
#[cfg_attr(loom, allow(dead_code, reason = "the models use a part"))]
mod remote_wakes;

#[cfg(all(feature = "std", not(loom)))]
mod blocking;
#[cfg(not(loom))]
mod call_count;
#[cfg(not(loom))]
mod deadlines;
#[cfg(not(loom))]
mod executor;
#[cfg(all(feature = "std", unix, not(loom)))]
mod file_watch;
#[cfg(all(feature = "std", unix, not(loom)))]
mod files;
#[cfg(not(loom))]
mod interference;
#[cfg(all(feature = "std", not(loom)))]
mod os_thread;
mod process;
#[cfg(all(feature = "std", not(loom)))]
mod simulation;
#[cfg(not(loom))]
mod yield_now;

/// Where files have no descriptors nothing waits for them.
#[cfg(all(any(not(feature = "std"), not(unix)), not(loom)))]
mod file_watch {
    use crate::executor::Shared;
    use alloc::sync::Arc;
    use luna_platform::bell::Bell;
    use luna_platform::on_drop::OnDrop;

    pub(crate) fn enter(_: &Bell, _: Option<Arc<Shared>>) -> OnDrop<fn()> {
        OnDrop::new(|| ())
    }

    pub(crate) fn glance(_: &Bell) {}

    pub(crate) fn is_waiting(_: &Bell) -> bool {
        false
    }
}

/// Without threads there are no simulations.
#[cfg(all(not(feature = "std"), not(loom)))]
mod simulation {
    use alloc::boxed::Box;
    use luna_platform::clock::Clock;

    pub(crate) enum Stage {}

    impl Stage {
        pub(crate) fn begin_call(&self) -> u64 {
            match *self {}
        }

        pub(crate) fn clock(&self) -> Clock {
            match *self {}
        }

        pub(crate) fn call_done(&self, _: u64, _: Box<dyn FnOnce() + Send>) {
            match *self {}
        }
    }
}

#[cfg(all(test, loom))]
mod loom_tests;

#[cfg(all(feature = "std", not(loom)))]
pub use {
    blocking::{Blocking, MAX_BUDDIES, NoBuddy, blocking, prepare_blocking},
    os_thread::{Nested, OsThread, block_on, block_on_patiently},
    simulation::{
        ClockDriver, DriveError, DrivenClock, Pace, Simulation, SimulationHandle, Standstill,
    },
};
#[cfg(not(loom))]
pub use {
    call_count::UnderWay,
    current::has_given_up,
    executor::{Announced, Executor, ExecutorHandle, make_room},
    interference::{Interference, Turn, interference, look_at_clock},
    process::{
        Exit, ExitValue, Join, Name, PollMonitor, ProcessHandle, ProcessRegistry, ProcessSpec,
        ProcessState, Quiescent, Verdict, panic_message, poll_monitor,
    },
    yield_now::{YieldNow, yield_now},
};
#[cfg(all(feature = "std", unix, not(loom)))]
pub use {
    file_watch::prepare_files,
    files::{FileError, FileReady, readable, writable},
};

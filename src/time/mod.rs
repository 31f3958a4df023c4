//! Time as processes see it: the clock, delays and deadlines, timers, periodic loops, and the timer
//! manager.
//!
//! All of it is the system's time: that of the machine, or of a virtual clock. `docs/loops.md` and
//! `docs/time.md` have more.
//!
//! ```
//! use luna::prelude::*;
//! use luna::time::{Cycle, Overrun, now, periodic};
//! use std::time::Duration;
//!
//! let mut system = System::new("servo");
//! system.virtual_clock();
//! let main = system.executor("main").build()?;
//! main.process("loop").spawn(async {
//!     let begin = now();
//!     let mut tick = periodic("loop", Duration::from_millis(1))?.overrun(Overrun::CatchUp);
//!     for _ in 0..1000 {
//!         let _: Cycle = tick.next().await;
//!     }
//!     assert_eq!(now() - begin, Duration::from_secs(1));
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

pub(crate) mod accounting;
mod follower;
mod grid;
mod late;
pub(crate) mod late_cycle;
pub(crate) mod manager;
mod period;
mod periodic;
mod registry;
mod spin;
pub(crate) mod stamp;
pub(crate) mod statistics;
mod timer;

pub(crate) use accounting::{Accounting, UsageSince, short};
pub use follower::{FollowState, Followed, Follower, LeaderTick};
pub(crate) use late::Witness;
pub(crate) use late_cycle::{StolenTime, how_to_find_out};
pub use luna_channels::{After, after, at};
pub use luna_machine::tai::Synchronization;
pub use luna_platform::clock::Instant;
pub use luna_replay::now;
pub use manager::{Firing, TimerCallback, TimerManager, Timers};
pub(crate) use manager::{MAX_CALLBACKS, Manager, ManagerThread};
pub use periodic::{Cycle, Overrun, Periodic, periodic};
pub(crate) use registry::{LoopName, Scope};
pub use stamp::{Conversion, Stamp, StampClock, StampError, StampSource, StampState};
pub use timer::{Expiry, NextTick, Tick, Ticks, Timer, ticks};

//! Safety blocks: they stand between a controller and an actuator and let no harmful value pass.
//!
//! A *block* is a type with a [`step`](Block::step) from a [`Sample`] to a [`Verdict`]. It has no
//! clock, no channel, and only its own state, so it can be tested exhaustively, and used anywhere.
//! A [`Chain`] is a series of blocks, with a [`Response`] to the verdicts of each: a warning,
//! neutral until it has recovered, a safe state, or an emergency. [`Chain::process`] makes it a
//! process between two channels.
//!
//! | block | guards against | found |
//! | --- | --- | --- |
//! | [`Limit`], [`RateLimit`] | values too large, or changing too fast | in the same sample |
//! | [`EndStop`] | motion into an end stop; out of it is allowed | in the same sample |
//! | [`Range`], [`MaxRate`] | impossible measurements | in the same sample |
//! | [`Frozen`], [`Noise`], [`Disagreement`] | frozen, noisy, unequal sensors | in a set time |
//! | [`Blocked`] | output without motion | within a set time |
//! | [`Timeout`] | set-points that stop coming | at a set time |
//! | [`Agreement`] | one of two channels that fails | in the same round, or within a set time |
//! | [`DeadMan`] | an absent operator | at a set time |
//!
//! `docs/safety-blocks.md` describes their parameters, bounds, and what each does not detect.
//! Values that are not finite are faults for all of them, and never passed on. Parameters are
//! checked when a block is created ([`SettingError`]). All steps are O(1), and allocate nothing.
//!
//! ```
//! use luna::prelude::*;
//! use luna_plants::{Motor, PAN, PlantLink};
//! use luna_safety_blocks::{Blocked, Chain, EndStop, RateLimit, Reaction};
//! use std::time::Duration;
//!
//! let ms = Duration::from_millis(1);
//! let mut system = System::new("axis");
//! system.virtual_clock();
//! let main = system.executor("main").build()?;
//! let register = || luna::buffered::<f64>(Buffer::overwrite_oldest(1));
//! let ((measured, angles), (safe, duties), (asked, wanted)) =
//!     (register(), register(), luna::channel());
//!
//! let mut motor = PlantLink::new("motor", Motor::new(PAN));
//! motor.actuator("duty", duties)?;
//! motor.sensor("angle", measured)?;
//! motor.at_end(|motor| assert!(motor.state().angle < PAN.end_stop));
//! main.process("motor").spawn(motor.periodic(ms)?)?;
//!
//! // Between the controller and the motor.
//! let chain = Chain::new(0.0)?
//!     .then("slew", RateLimit::new(100.0)?.free_to(0.0)?, Reaction::Warn)?
//!     .then("stops", EndStop::new(-1.3, 1.3)?, Reaction::Warn)?
//!     .then("motion", Blocked::new(0.3, 2e-3, 500 * ms)?, Reaction::Emergency)?;
//! main.process("safety").spawn(chain.process(wanted, safe).feedback(angles, 5 * ms)?)?;
//!
//! // A controller gone mad.
//! main.process("controller").spawn(async move {
//!     let mut tick = luna::periodic("controller", ms)?;
//!     for _ in 0..2000 {
//!         tick.next().await;
//!         asked.send(0.2).await?;
//!     }
//!     Ok(())
//! })?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```

mod agreement;
mod block;
mod blocks;
mod chain;
mod dead_man;
mod fault;
mod lasting;
mod monitor;
mod process;
mod response;
mod setting;
mod timeout;

pub use agreement::{Agreement, Vote};
pub use block::{Block, Sample, Verdict};
pub use blocks::{Blocked, Disagreement, EndStop, Frozen, Limit, MaxRate, Noise, Range, RateLimit};
pub use chain::Chain;
pub use dead_man::DeadMan;
pub use fault::{Channel, Fault, Finding, Which};
pub use monitor::Monitor;
pub use process::{AgreementProcess, ChainProcess, DeadManProcess, Signal};
pub use response::{Alarm, Reaction, Reactor, Recovery, Response};
pub use setting::{Given, SettingError};
pub use timeout::Timeout;

/// The programs of the page are tests.
#[cfg(doctest)]
#[doc = include_str!("../../docs/safety-blocks.md")]
struct Page;

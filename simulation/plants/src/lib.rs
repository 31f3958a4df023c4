//! Simulated plants for LUNA, which replace hardware.
//!
//! A *plant* is a simulated machine, or a part of one: it has *inputs*, which actuators apply, and
//! *outputs*, which sensors read, each a [`Port`] with a name, a unit and a range. A [`PlantLink`]
//! connects it to the channels of control processes, which need not know whether they use it or
//! hardware. It advances by the system's clock ([`PlantLink::periodic`]) or by exchanges
//! ([`PlantLink::lock_step`]). A failure raises an emergency, and wrong values are never passed on.
//!
//! ```
//! use luna::prelude::*;
//! use luna_plants::{Motor, PAN, PlantLink};
//! use std::time::Duration;
//!
//! let mut system = System::new("pan");
//! let main = system.executor("main").build()?;
//! let (duty, duties) = luna::channel::<f64>();
//! let (angle, angles) = luna::channel::<f64>();
//! main.process("control").spawn(async move {
//!     for _ in 0..500 {
//!         let angle = angles.recv().await?;
//!         duty.send(2.0 * (0.5 - angle)).await?;
//!     }
//!     Ok(())
//! })?;
//! let mut motor = PlantLink::new("motor", Motor::new(PAN));
//! motor.actuator("duty", duties)?;
//! motor.sensor("angle", angle)?;
//! motor.at_end(|motor| assert!((motor.state().angle - 0.5).abs() < 0.1));
//! main.process("motor").spawn(motor.lock_step(Duration::from_millis(1))?)?;
//! system.run()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! Implement [`Plant`] for your own. Included are [`Motor`] with gear, friction, end stops and
//! limits; [`PanTilt`], Jiwy's mechanism; [`FirstOrderLag`], [`DeadTime`], and [`Series`] of two.
//! All are deterministic; their steps allocate nothing.
//!
//! # Features
//!
//! `fmi`, off by default: co-simulation FMUs as plants (module `fmu`). Building it needs libclang.

mod dead_time;
mod encoder;
mod error;
#[cfg(feature = "fmi")]
pub mod fmu;
mod lag;
mod link;
pub mod motor;
mod pan_tilt;
mod plant;
mod port;
mod series;
mod single;

pub use dead_time::DeadTime;
pub use encoder::{COUNTS_PER_MOTOR_TURN, Decoder, Encoder};
pub use error::{ConnectError, PlantError, PlantFailure, Side};
pub use lag::FirstOrderLag;
pub use link::{EnableLine, Measured, PlantLink, PlantProcess};
pub use motor::{Motor, MotorParameters, MotorState};
pub use pan_tilt::{PAN, PanTilt, TILT};
pub use plant::{Checked, Plant};
pub use port::{Outside, Port};
pub use series::Series;

/// The programs of the page are tests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/simulation.md")]
struct Page;

/// Random cases from the seed `LUNA_SEED`; without it always the same.
#[cfg(test)]
fn seeded() -> proptest::test_runner::Config {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    proptest::test_runner::Config {
        rng_seed: proptest::test_runner::RngSeed::Fixed(seed.unwrap_or(20_261_121)),
        failure_persistence: None,
        ..Default::default()
    }
}

//! Simulated plants for LUNA, and how they take the place of hardware.

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

/// Random cases from the seed `LUNA_SEED`, and without one always the same.
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

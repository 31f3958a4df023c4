//! What the tests share.

use proptest::test_runner::{Config, RngSeed};

/// Random cases from the seed `LUNA_SEED`, else always the same; it is printed, for when a test fails.
pub(crate) fn seeded() -> Config {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok())
        .unwrap_or(20_261_121);
    println!("LUNA_SEED={seed}");
    Config {
        rng_seed: RngSeed::Fixed(seed),
        failure_persistence: None,
        ..Config::default()
    }
}

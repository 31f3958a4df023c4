//! What the tests share.

use proptest::test_runner::{Config, RngSeed};

/// Random cases from the seed `LUNA_SEED`; without it always the same. The seed is printed for
/// failing tests.
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

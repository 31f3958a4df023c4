//! What the tests share.

#[path = "../../../tests/shared/mod.rs"]
mod shared;
#[path = "../../../tests/shared/spawn.rs"]
mod spawn;

use proptest::test_runner::{Config, RngSeed};
pub(crate) use spawn::SpawnOk;

/// Random cases from the seed `LUNA_SEED`; without it always the same. The seed is printed for
/// failing tests.
pub(crate) fn seeded() -> Config {
    let seed = shared::seed_or_else(|| 20_261_121);
    Config {
        rng_seed: RngSeed::Fixed(seed),
        failure_persistence: None,
        ..Config::default()
    }
}

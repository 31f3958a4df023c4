//! Random networks of processes, run by the real runtime and checked against an operational model.
//! Each trace must be one that the model allows. A network that must deadlock is found stuck, and
//! one that cannot deadlock ends. See `docs/internals/proof.md`.
//!
//! `LUNA_SEED` sets the seed, `LUNA_NETWORKS` how many networks; network `i` of seed `s` is network
//! 0 of seed `s + i`.

mod cases;
mod choose;
mod job;
mod mutants;
mod operate;
mod play;
mod run;
mod tally;

use check::{End, Fate, check, fate};
use generate::Random;
pub(crate) use luna_operational::{check, generate, network, simulate};
use run::{Bench, Placement};
use std::collections::BTreeMap;
use std::sync::{Mutex, OnceLock};
use tally::Tally;

/// How many networks an ordinary run of the tests takes.
const NETWORKS: u64 = 5_000;

/// Networks with more states than this are not followed along all paths. Their traces are checked
/// all the same.
const MAX_STATES: usize = 300;

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok()?.parse().ok()
}

/// LUNA_SEED from the environment, otherwise a seed of the clock, for all tests. It is printed, for
/// when a test fails.
fn seeds(networks: u64) -> impl Iterator<Item = u64> {
    static FIRST: OnceLock<u64> = OnceLock::new();
    let first = *FIRST.get_or_init(|| {
        let since = std::time::UNIX_EPOCH.elapsed();
        let of_clock = since.map_or(1, |since| since.as_nanos() as u64);
        number("LUNA_SEED").unwrap_or(of_clock)
    });
    let networks = number("LUNA_NETWORKS").unwrap_or(networks);
    println!("LUNA_SEED={first} LUNA_NETWORKS={networks}");
    (0..networks).map(move |number| first.wrapping_add(number))
}

/// How many networks of each kind there were.
type Fates = BTreeMap<Option<Fate>, u32>;

/// What the network of a seed must come to; found out once for all tests.
fn fate_of(seed: u64, network: &network::Network) -> Option<Fate> {
    static KNOWN: Mutex<BTreeMap<u64, Option<Fate>>> = Mutex::new(BTreeMap::new());
    if let Some(&known) = KNOWN.lock().unwrap().get(&seed) {
        return known;
    }
    let found = fate(network, MAX_STATES);
    KNOWN.lock().unwrap().insert(seed, found);
    found
}

#[track_caller]
fn assert_foretold(fate: Option<Fate>, end: End, seed: u64, network: &network::Network) {
    let foretold = match fate {
        Some(Fate::Ends) => end == End::Complete,
        Some(Fate::Deadlocks) => end == End::Stuck,
        Some(Fate::Either) | None => true,
    };
    assert!(
        foretold,
        "{fate:?}, but {end:?}: LUNA_SEED={seed} LUNA_NETWORKS=1\n{network}"
    );
}

/// The checker accepts what the model does, and what the model foretells of it comes true.
#[test]
fn the_model_agrees_with_itself() {
    let mut fates = Fates::new();
    for seed in seeds(300) {
        let network = generate::network(seed);
        let (trace, end) = simulate::simulate(&network, &mut Random::new(!seed));
        if let Err(refusal) = check(&network, &trace, end) {
            panic!("LUNA_SEED={seed} LUNA_NETWORKS=1\n{network}{trace:?}\n{end:?}: {refusal}");
        }
        let fate = fate_of(seed, &network);
        *fates.entry(fate).or_default() += 1;
        assert_foretold(fate, end, seed, &network);
    }
    println!("{fates:?}");
}

fn run_networks(placement: Placement) {
    // Bias from the first operation on: the networks take the fast path and the slow path, and each
    // bias is revoked.
    luna_core::biased_lock::bias_after(1);
    let bench = Bench::new();
    let mut fates = Fates::new();
    let mut tally = Tally::default();
    let (mut networks, mut stuck, mut undecided, mut most) = (0, 0, 0, 0);
    for seed in seeds(NETWORKS) {
        let network = generate::network(seed);
        let fate = fate_of(seed, &network);
        *fates.entry(fate).or_default() += 1;
        match bench.run(&network, placement, fate == Some(Fate::Ends)) {
            Ok(seen) => {
                stuck += u64::from(seen.end == End::Stuck);
                most = most.max(seen.states.unwrap_or(0));
                undecided += u64::from(seen.states.is_none());
                networks += 1;
                tally.count(&network, &seen.trace);
                assert_foretold(fate, seen.end, seed, &network);
            }
            Err(failed) => panic!("{placement:?}, LUNA_SEED={seed} LUNA_NETWORKS=1\n{failed}"),
        }
    }
    println!(
        "{placement:?}: foretold {fates:?}; {stuck} deadlocked; at most {most} states at once"
    );
    println!("{tally:#?}");
    assert!(
        undecided * 100 <= networks,
        "{undecided} of {networks} runs stayed undecided"
    );
    // A few networks, as when a failure is run again, need not show everything.
    if networks >= NETWORKS {
        tally.assert_complete();
    }
}

#[test]
fn on_one_executor() {
    run_networks(Placement::OneExecutor);
}

#[test]
fn on_two_executors() {
    run_networks(Placement::TwoExecutors);
}

#[test]
fn on_threads() {
    run_networks(Placement::Threads);
}

#[test]
fn on_executors_and_threads() {
    run_networks(Placement::Mixed);
}

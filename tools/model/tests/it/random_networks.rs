//! Random networks: SPIN comes to the same verdict as the exploration, from a translation that
//! shares no more with it than the places of the bodies.

use crate::random::{Random, model};
use crate::{is_long, number, seed, skip};
use luna_model::{FindingKind, Model, SpinError};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

/// Networks with more states than this are left out.
const MAX_STATES: usize = 20_000;

/// What comes first: after a broken assertion there is no run that could deadlock.
fn verdict<'a>(kinds: impl Iterator<Item = &'a FindingKind> + Clone) -> &'static str {
    let has = |kind: FindingKind| kinds.clone().any(|found| *found == kind);
    if has(FindingKind::Assertion) {
        "assertion"
    } else if has(FindingKind::Deadlock) {
        "deadlock"
    } else {
        "holds"
    }
}

/// The verdict of both, nothing for a network that is too large; else the program that is missing.
fn compare(seed: u64) -> Result<Option<&'static str>, &'static str> {
    let text = model(&mut Random(seed));
    let read = Model::parse("random.toml", &text);
    let read = read.unwrap_or_else(|problem| panic!("{problem}, LUNA_SEED={seed}\n{text}"));
    let explored = read.explore(MAX_STATES);
    if !explored.is_complete {
        return Ok(None);
    }
    let own = verdict(explored.findings.iter().map(|found| &found.kind));
    let spin = match read.check_with_spin() {
        Ok(spin) => spin,
        Err(SpinError::Missing { program, .. }) => return Err(program),
        Err(error) => panic!("{error}: LUNA_SEED={seed} LUNA_SPIN_NETWORKS=1\n{text}"),
    };
    assert!(
        spin.incomplete.is_empty(),
        "{spin:?}: LUNA_SEED={seed}\n{text}"
    );
    let theirs = verdict(spin.findings.iter().map(|found| &found.kind));
    assert_eq!(
        own,
        theirs,
        "LUNA_SEED={seed} LUNA_SPIN_NETWORKS=1\n{text}\n{explored:#?}\n{spin:#?}\n{}",
        read.to_promela()
    );
    Ok(Some(own))
}

/// `LUNA_SEED` sets the seed, `LUNA_SPIN_NETWORKS` how many; network `i` of seed `s` is network 0 of
/// seed `s + i`.
#[test]
fn spin_comes_to_the_verdict_of_the_exploration() {
    let networks = number("LUNA_SPIN_NETWORKS").unwrap_or(if is_long() { 1000 } else { 12 });
    let first = seed();
    let next = AtomicU64::new(0);
    // The time is that of C compilers: two at a time.
    let work = || -> Result<Vec<Option<&'static str>>, &'static str> {
        let mut found = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= networks {
                return Ok(found);
            }
            found.push(compare(first.wrapping_add(number))?);
        }
    };
    let halves = std::thread::scope(|scope| {
        let threads = [scope.spawn(work), scope.spawn(work)];
        threads.map(|thread| thread.join().expect("an assertion of the thread, above"))
    });
    let mut verdicts = BTreeMap::new();
    for half in halves {
        match half {
            Ok(found) => found.into_iter().for_each(|found| {
                *verdicts.entry(found.unwrap_or("left out")).or_insert(0_u64) += 1;
            }),
            Err(program) => return skip(&format!("{program} is missing")),
        }
    }
    println!("{verdicts:?}");
    let left_out = verdicts.get("left out").copied().unwrap_or(0);
    assert!(networks < 10 || left_out * 5 <= networks, "{verdicts:?}");
}

/// Without SPIN, so that there may be many: none makes the exploration panic, and each finding is
/// told.
#[test]
fn random_networks_are_explored_and_told() {
    let first = seed();
    let mut verdicts = BTreeMap::new();
    for seed in (0..300).map(|number| first.wrapping_add(number)) {
        let text = model(&mut Random(seed));
        let read = Model::parse("random.toml", &text);
        let read = read.unwrap_or_else(|problem| panic!("{problem}, LUNA_SEED={seed}\n{text}"));
        let explored = read.explore(1000);
        for finding in &explored.findings {
            assert!(
                !finding.there.is_empty(),
                "{finding:?}, LUNA_SEED={seed}\n{text}"
            );
        }
        let kinds = explored.findings.iter().map(|found| &found.kind);
        *verdicts.entry(verdict(kinds)).or_insert(0_u64) += 1;
    }
    println!("{verdicts:?}");
    assert!(verdicts.values().all(|count| *count >= 5), "{verdicts:?}");
}

//! The export to CSPm. FDR is not to be had here, so the tests read what is written with a parser
//! of their own, and explore it by the operational semantics of CSP: it must come to the verdicts
//! of the model's exploration.

mod component;
mod explore;
mod lexer;
mod names;
mod parser;
mod rules;
mod syntax;
mod value;

use crate::random::{Random, model};
use crate::{is_long, seed};
use explore::{Verdict, verdict};
use luna_model::{Exploration, FindingKind, Model};
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

/// Properties of random networks, in which each process has two variables of 0 to 2.
const PROPERTIES: [&str; 8] = [
    "p0.x <= 1",
    "p0.x == p0.y || p1.y == 0",
    "!(p0@act && p1@act)",
    "p0@act || p0.x != 1",
    "p1@act || p2@act || p1.x + p2.x <= 1",
    "2 / p1.x >= 1 || p0.x == 0",
    "p1.y * p2.y != 2",
    "p3.x - p2.x < 1 + p0.y",
];

/// Networks with more states than this are left out.
const MAX_STATES: usize = 3_000;
/// What a model does in one step may be several events: a branch of `par` begins and ends by some.
const MAX_EXPORTED_STATES: usize = 60_000;

/// What the exploration says, as the assertions of the export would.
fn expected(explored: &Exploration, text: &str) -> Verdict {
    let has = |kind| explored.findings.iter().any(|found| found.kind == kind);
    let exported = text
        .lines()
        .filter_map(|line| line.strip_prefix("-- Always: "));
    let holds = |title: &str| !has(FindingKind::Always(title.to_owned()));
    Verdict {
        is_deadlock_free: !has(FindingKind::Deadlock),
        is_divergence_free: !has(FindingKind::Livelock),
        is_unbroken: !has(FindingKind::Assertion),
        always: exported.map(holds).collect(),
    }
}

/// Both verdicts. Nothing if there are too many states.
fn compare(model: &Model, most: usize, described: &str) -> Option<Verdict> {
    let text = model
        .to_cspm()
        .unwrap_or_else(|error| panic!("{error}\n{described}"));
    let script = parser::parse(&text);
    names::check(&script);
    let explored = model.explore(most);
    if !explored.is_complete {
        return None;
    }
    let wanted = expected(&explored, &text);
    let mut found = verdict(&script, most.max(MAX_EXPORTED_STATES))?;
    // After a broken assertion the exploration does not go on.
    if !wanted.is_unbroken {
        found.is_divergence_free = wanted.is_divergence_free;
        for (found, wanted) in found.always.iter_mut().zip(&wanted.always) {
            *found |= *wanted;
        }
    }
    assert_eq!(found, wanted, "{described}\n{text}\n{explored:#?}");
    Some(wanted)
}

fn example(name: &str) -> Model {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../examples/models")
        .join(name);
    let text = fs::read_to_string(&path).expect("the example is there");
    Model::parse(name, &text).unwrap_or_else(|problem| panic!("{problem}"))
}

#[test]
fn exported_examples_have_the_verdicts_of_the_exploration() {
    let right = Verdict {
        is_deadlock_free: true,
        is_divergence_free: true,
        is_unbroken: true,
        always: Vec::new(),
    };
    for (name, is_deadlock_free) in [
        ("philosophers.toml", false),
        ("philosophers-repaired.toml", true),
        ("commstime.toml", true),
        ("sorting-pump.toml", true),
        ("sieve.toml", true),
    ] {
        let expected = Verdict {
            is_deadlock_free,
            always: vec![true; usize::from(name == "philosophers-repaired.toml")],
            ..right.clone()
        };
        assert_eq!(
            compare(&example(name), 200_000, name),
            Some(expected),
            "{name}"
        );
    }
}

#[test]
fn exported_random_networks_have_the_verdicts_of_the_exploration() {
    let first = seed();
    let networks = if is_long() { 5000 } else { 100 };
    let mut verdicts = BTreeMap::new();
    let mut properties = [0_u64; 2];
    for seed in (0..networks).map(|number| first.wrapping_add(number)) {
        let mut text = model(&mut Random(seed));
        let read = Model::parse("random.toml", &text);
        let mut read = read.unwrap_or_else(|problem| panic!("{problem}, LUNA_SEED={seed}\n{text}"));
        text.push_str("[check.always]\n");
        for property in PROPERTIES {
            // Not each model has what each property names.
            let longer = format!("{text}'{property}' = '{property}'\n");
            if let Ok(with_it) = Model::parse("random.toml", &longer) {
                (text, read) = (longer, with_it);
            }
        }
        let found = compare(&read, MAX_STATES, &format!("LUNA_SEED={seed}\n{text}"));
        for holds in found.iter().flat_map(|found| &found.always) {
            properties[usize::from(*holds)] += 1;
        }
        let found = found.map(|found| Verdict {
            always: Vec::new(),
            ..found
        });
        *verdicts.entry(format!("{found:?}")).or_insert(0_u64) += 1;
    }
    println!("{verdicts:#?}, properties: {properties:?}");
    assert!(
        properties.iter().all(|count| *count * 4 > networks),
        "{properties:?}"
    );
    let left_out = verdicts.get("None").copied().unwrap_or(0);
    assert!(left_out * 4 <= networks, "{verdicts:?}");
}

//! The printed tables.

use crate::Outcome;
use crate::compiled_in::Pair;
use crate::gate;
use crate::recorded::Recorded;
use std::collections::BTreeMap;
use std::path::Path;

/// How many frames around an atomic instruction are printed.
const FRAMES: usize = 4;
/// Functions with less than this fraction of an operation's instructions are not printed.
const LEAST: f64 = 0.005;

/// A line for each operation: the recorded count, the present one, and the difference.
pub(crate) fn comparison(outcomes: &[Outcome<'_>], recorded: &Recorded) {
    println!(
        "{:36} {:>10} {:>10} {:>8}   {:>14}",
        "instructions an operation", "recorded", "now", "%", "atomic ones"
    );
    for outcome in outcomes {
        let now = outcome.figures();
        let old = recorded.figures.get(&outcome.operation.name).copied();
        let (before, percent, atomics) = match old {
            Some(old) => (
                format!("{:.1}", old.instructions),
                format!("{:+.2}", 100.0 * gate::change(old, now)),
                format!("{:.2}", old.atomics),
            ),
            None => ("-".to_owned(), "-".to_owned(), "-".to_owned()),
        };
        let line = format!(
            "{:36} {before:>10} {:>10.1} {percent:>8}   {atomics:>6} {:>7.2}   {}",
            outcome.operation.name,
            now.instructions,
            now.atomics,
            outcome.verdict(recorded).text(),
        );
        println!("{}", line.trim_end());
    }
}

/// A line for each operation: the counts without the events and with them, and the difference.
pub(crate) fn pairs(pairs: &[Pair]) {
    println!(
        "{:36} {:>10} {:>10} {:>8}   {:>14}",
        "instructions an operation", "without", "events", "%", "atomic ones"
    );
    for pair in pairs {
        let line = format!(
            "{:36} {:>10.1} {:>10.1} {:>+8.2}   {:>6.2} {:>7.2}   {}",
            pair.name,
            pair.without.instructions,
            pair.with.instructions,
            100.0 * pair.change(),
            pair.without.atomics,
            pair.with.atomics,
            if pair.is_too_much() { "TOO MUCH" } else { "" },
        );
        println!("{}", line.trim_end());
    }
}

/// For each operation the functions that execute most of its instructions, and all its atomic
/// instructions.
pub(crate) fn details(outcomes: &[Outcome<'_>]) {
    for outcome in outcomes {
        let figures = outcome.figures();
        println!(
            "=== {}: {:.1} instructions, {:.2} of them atomic",
            outcome.operation.name, figures.instructions, figures.atomics
        );
        let mut functions: BTreeMap<String, f64> = BTreeMap::new();
        for (place, share) in &outcome.counted.places {
            let name = if outcome.program == Path::new(&place.object) {
                share.function.clone()
            } else {
                let library = Path::new(&place.object).file_name().unwrap_or_default();
                format!("{} ({})", share.function, library.display())
            };
            *functions.entry(name).or_default() += share.times;
        }
        let mut functions: Vec<_> = functions.into_iter().collect();
        functions.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (name, times) in functions {
            if times >= LEAST * figures.instructions {
                println!("{times:10.1}  {name}");
            }
        }
        for atomic in &outcome.atomics {
            println!("{:10.2}  atomic: {}", atomic.times, atomic.mnemonic);
            for frame in atomic.frames.iter().take(FRAMES) {
                println!("{:10}      {frame}", "");
            }
        }
        println!();
    }
}

//! Compares the counts with CSP events compiled in, but not recorded, with those without them.

use crate::gate::{change, rounding};
use crate::operations::Operations;
use crate::recorded::Figures;
use crate::{Outcome, count_all, table};

/// The feature of the operations' program.
const FEATURE: &str = "events";

/// How much more an operation may execute.
const MAX: f64 = 0.05;

/// An operation without the events, and with them.
#[derive(Debug)]
pub(crate) struct Pair {
    pub(crate) name: String,
    pub(crate) without: Figures,
    pub(crate) with: Figures,
}

impl Pair {
    /// How much more it executes, as a share.
    pub(crate) fn change(&self) -> f64 {
        change(self.without, self.with)
    }

    /// Whether it exceeds the limit. Events that are not recorded need no atomic instruction.
    pub(crate) fn is_too_much(&self) -> bool {
        let atomics = self.without.atomics;
        self.change() > MAX || self.with.atomics > atomics + rounding(atomics)
    }
}

/// Counts without the events and holds the counts against the recorded ones. Then counts with the
/// events and compares. Returns whether both are within their limits.
///
/// # Errors
///
/// As of [`count_all`].
pub(crate) fn judge(parts: &[String]) -> Result<bool, String> {
    // One after the other: they are built to one place.
    let operations = Operations::build(&[])?;
    let outcomes = count_all(&operations, &operations.select(parts)?)?;
    let is_as_recorded = crate::judge(&operations, &outcomes)?;
    let without = figures(&outcomes);
    let operations = Operations::build(&[FEATURE])?;
    let with = figures(&count_all(&operations, &operations.select(parts)?)?);
    let pairs: Vec<Pair> = without
        .into_iter()
        .zip(with)
        .map(|((name, without), (_, with))| Pair {
            name,
            without,
            with,
        })
        .collect();
    println!();
    table::pairs(&pairs);
    let failures = pairs.iter().filter(|pair| pair.is_too_much()).count();
    println!(
        "\nevents that are not recorded: {} passed, {failures} failed",
        pairs.len() - failures
    );
    Ok(is_as_recorded && failures == 0)
}

fn figures(outcomes: &[Outcome<'_>]) -> Vec<(String, Figures)> {
    outcomes
        .iter()
        .map(|outcome| (outcome.operation.name.clone(), outcome.figures()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(instructions: f64, atomics: f64) -> Pair {
        let without = Figures {
            instructions: 400.0,
            atomics: 4.0,
        };
        let with = Figures {
            instructions,
            atomics,
        };
        Pair {
            name: String::new(),
            without,
            with,
        }
    }

    #[test]
    fn a_twentieth_more_is_too_much_and_an_atomic_instruction_is() {
        assert!(!pair(419.0, 4.0).is_too_much());
        assert!(pair(421.0, 4.0).is_too_much());
        assert!(!pair(300.0, 3.0).is_too_much());
        assert!(pair(400.0, 4.3).is_too_much());
    }
}

//! Goals of figures, and their outcomes.

use serde::{Deserialize, Serialize};

use super::{Case, row::Row};
use crate::primitives::PRIMITIVES;

/// What a case is to reach.
#[derive(Debug, Clone)]
pub enum Goal {
    /// A figure of the reference machine, in the case's unit. The ratios to the
    /// [primitives](crate::primitives) of the same run are printed too, since this machine differs.
    AtMost(f64),
    /// A multiple of another case of the same rounds.
    Times {
        /// How many times.
        factor: f64,
        /// The other case's name.
        name: &'static str,
        /// The other case's peer.
        peer: &'static str,
        /// The other case's size.
        size: Option<u64>,
        /// The base of the multiple, as text.
        of: &'static str,
    },
}

/// The outcome of a goal, as in the JSON file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Outcome {
    /// The goal as text, such as `at most 34 ns/cycle`.
    pub goal: String,
    /// The result divided by the goal: met up to 1. The median of the rounds' ratios if the goal is
    /// a multiple of another case.
    pub ratio: f64,
    /// Whether it is met.
    pub met: bool,
    /// The figure as a multiple of each primitive of the same run.
    pub primitives: Vec<(String, f64)>,
}

/// The outcomes of the goals of `case`, with the samples at `index`; goals that refer to an omitted
/// case are omitted.
pub(super) fn outcomes(case: &Case, index: usize, cases: &[Case], rows: &[Row]) -> Vec<Outcome> {
    let mine = &rows[index];
    let judge = |goal: &Goal| match *goal {
        Goal::AtMost(limit) => {
            let primitives = rows.iter().filter(|row| row.name == PRIMITIVES);
            Some(Outcome {
                goal: format!("at most {} {}", plain(limit), case.unit),
                ratio: mine.median / limit,
                met: mine.median <= limit,
                primitives: primitives
                    .map(|row| (row.peer.clone(), mine.median / row.median))
                    .collect(),
            })
        }
        Goal::Times {
            factor,
            name,
            peer,
            size,
            of,
        } => {
            let other = cases
                .iter()
                .position(|case| case.name == name && case.peer == peer && case.size == size)?;
            let rounds = mine.rounds.iter().zip(&rows[other].rounds);
            let ratios: Vec<f64> = rounds.map(|(mine, other)| mine / other / factor).collect();
            let ratio = super::median(&ratios);
            Some(Outcome {
                goal: format!("at most {} × {of}", plain(factor)),
                ratio,
                met: ratio <= 1.0,
                primitives: Vec::new(),
            })
        }
    };
    case.goals.iter().filter_map(judge).collect()
}

fn plain(figure: f64) -> String {
    format!("{figure:.3}")
        .trim_end_matches('0')
        .trim_end_matches('.')
        .to_owned()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn case(name: &'static str, peer: &'static str) -> Case {
        Case::new(name, peer, "ns/message", |_| Duration::ZERO)
    }

    #[test]
    fn absolute_with_primitives() {
        let cases = [
            case("a", "LUNA").goal(Goal::AtMost(40.0)),
            case(PRIMITIVES, "bare poll"),
        ];
        let rows = [
            Row::new(&cases[0], vec![60.0]),
            Row::new(&cases[1], vec![5.0]),
        ];
        let outcome = &outcomes(&cases[0], 0, &cases, &rows)[0];
        assert_eq!(outcome.goal, "at most 40 ns/message");
        assert_eq!((outcome.ratio, outcome.met), (1.5, false));
        assert_eq!(outcome.primitives, [("bare poll".to_owned(), 12.0)]);
    }

    #[test]
    fn a_multiple_is_taken_round_by_round() {
        let goal = Goal::Times {
            factor: 2.0,
            name: "b",
            peer: "bare",
            size: None,
            of: "the bare one",
        };
        let cases = [case("a", "LUNA").goal(goal), case("b", "bare")];
        let rows = [
            // Both are four times as fast in the second round: the ratio of the medians would be
            // meaningless.
            Row::new(&cases[0], vec![400.0, 90.0, 110.0]),
            Row::new(&cases[1], vec![200.0, 50.0, 50.0]),
        ];
        let outcome = &outcomes(&cases[0], 0, &cases, &rows)[0];
        assert_eq!(outcome.goal, "at most 2 × the bare one");
        assert_eq!((outcome.ratio, outcome.met), (1.0, true));
        assert!(outcomes(&cases[0], 0, &cases[..1], &rows[..1]).is_empty());
    }
}

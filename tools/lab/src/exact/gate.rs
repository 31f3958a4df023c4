//! Compares latencies with the recorded ones.

use super::recorded::Figures;
use super::rows::{Goal, Which};
use std::collections::BTreeMap;

/// How much a median may exceed the recorded one, as a fraction of it.
///
/// The same programs give the same figures. Programs that are arranged otherwise in memory, and begin
/// at another phase of the kernel's tick, differed by up to 1.5 %.
const MEDIAN: f64 = 0.03;
/// A smaller difference of a median, in µs, is none: 100 instructions.
const LEAST: f64 = 0.2;

/// The verdict on a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Same,
    /// Below what is recorded, by more than the tolerance: record it, so that it stays.
    Faster,
    /// It is not recorded.
    New,
    SlowerMedian,
    SlowerMax,
}

impl Verdict {
    /// Judges; `longest` is how much the longest latency may exceed the recorded one, as a fraction.
    pub(crate) fn of(recorded: Option<Figures>, now: Figures, longest: f64) -> Verdict {
        let Some(old) = recorded else {
            return Verdict::New;
        };
        let median = match (old.p50, now.p50) {
            (Some(old), Some(now)) if (now - old).abs() >= LEAST => now / old - 1.0,
            _ => 0.0,
        };
        let max = now.max / old.max - 1.0;
        if median > MEDIAN {
            Verdict::SlowerMedian
        } else if max > longest {
            Verdict::SlowerMax
        } else if median < -MEDIAN || max < -longest {
            Verdict::Faster
        } else {
            Verdict::Same
        }
    }

    /// Whether the change has to be made deliberately, by recording it.
    pub(crate) fn is_failure(self) -> bool {
        !matches!(self, Verdict::Same | Verdict::Faster)
    }

    pub(crate) fn text(self) -> &'static str {
        match self {
            Verdict::Same => "",
            Verdict::Faster => "faster: record it",
            Verdict::New => "NOT RECORDED",
            Verdict::SlowerMedian => "SLOWER",
            Verdict::SlowerMax => "SLOWER AT WORST",
        }
    }
}

/// How a row stands to its goal.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Standing {
    pub(crate) is_met: bool,
    /// The goal, and what was reached.
    pub(crate) text: String,
}

impl Standing {
    /// Compares; `None` where there is no figure to compare with.
    pub(crate) fn of(
        goal: Goal,
        now: Figures,
        all: &BTreeMap<String, Figures>,
    ) -> Option<Standing> {
        let of = all.get(goal.of)?;
        let median = || Some((now.p50?, of.p50?));
        let pairs = match goal.which {
            Which::Median => vec![("p50", median()?)],
            Which::Max => vec![("max", (now.max, of.max))],
            Which::Both => vec![("p50", median()?), ("max", (now.max, of.max))],
        };
        let is_met = pairs
            .iter()
            .all(|(_, (now, of))| *now <= goal.factor * of + goal.plus);
        let mut figures = Vec::new();
        let mut names = Vec::new();
        for (name, (now, of)) in pairs {
            names.push(name);
            figures.push(if goal.plus > 0.0 {
                format!("{:+.2} µs", now - of)
            } else {
                format!("{:.2}", now / of)
            });
        }
        let limit = if goal.plus > 0.0 {
            format!("{} + {:.1} µs", goal.of, goal.plus)
        } else {
            format!("{} × {}", goal.factor, goal.of)
        };
        Some(Standing {
            is_met,
            text: format!("{} ≤ {limit}: {}", names.join(", "), figures.join(", ")),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(p50: f64, max: f64) -> Figures {
        Figures {
            p50: Some(p50),
            p99: Some(p50),
            max,
        }
    }

    #[test]
    fn what_is_slower_beyond_the_tolerance_fails_and_faster_does_not() {
        let old = Some(figures(10.0, 20.0));
        for (now, verdict) in [
            (figures(10.2, 20.5), Verdict::Same),
            (figures(9.9, 19.5), Verdict::Same),
            (figures(10.4, 20.0), Verdict::SlowerMedian),
            (figures(10.0, 21.1), Verdict::SlowerMax),
            (figures(9.6, 20.0), Verdict::Faster),
            (figures(10.0, 18.9), Verdict::Faster),
        ] {
            assert_eq!(Verdict::of(old, now, 0.05), verdict, "{now:?}");
        }
        assert!(Verdict::SlowerMax.is_failure() && !Verdict::Faster.is_failure());
        assert!(Verdict::of(None, figures(1.0, 1.0), 0.05).is_failure());
    }

    #[test]
    fn a_longest_alone_is_judged() {
        let only = |max| Figures {
            p50: None,
            p99: None,
            max,
        };
        assert_eq!(
            Verdict::of(Some(only(10.0)), only(10.1), 0.05),
            Verdict::Same
        );
        assert_eq!(
            Verdict::of(Some(only(10.0)), only(12.0), 0.05),
            Verdict::SlowerMax
        );
    }

    #[test]
    fn goals_are_factors_of_another_row_or_differences_to_it() {
        let all = BTreeMap::from([("futex".to_owned(), figures(8.0, 10.0))]);
        let goal = |which, factor, plus| Goal {
            which,
            factor,
            of: "futex",
            plus,
        };
        let standing = |goal, now| Standing::of(goal, now, &all).unwrap();
        let both = goal(Which::Both, 1.05, 0.0);
        assert!(standing(both, figures(8.4, 10.5)).is_met);
        let missed = standing(both, figures(8.0, 11.0));
        assert_eq!(missed.text, "p50, max ≤ 1.05 × futex: 1.00, 1.10");
        assert!(!missed.is_met && standing(goal(Which::Max, 1.2, 0.0), figures(99.0, 11.9)).is_met);
        let noticed = standing(goal(Which::Median, 1.0, 2.4), figures(10.3, 99.0));
        assert!(
            noticed.is_met && noticed.text.ends_with("futex + 2.4 µs: +2.30 µs"),
            "{noticed:?}"
        );
        assert_eq!(
            Standing::of(both, figures(1.0, 1.0), &BTreeMap::new()),
            None
        );
    }
}

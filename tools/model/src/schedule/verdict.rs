//! What follows from a bound, and what to change.

use super::around::{Around, Gap};
use super::plan::Row;
use super::{NoBound, Task};
use std::time::Duration;

/// What is known of a part's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// It has no deadline.
    Nothing,
    /// Its bound is within its deadline.
    Holds,
    /// Its bound is beyond its deadline.
    Exceeds,
    /// There is no bound.
    Unbounded,
    /// A response was measured that is longer than its bound.
    Contradicted,
    /// Too little is known for a bound.
    Unknown,
}

impl Verdict {
    /// The verdict in a word.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Nothing => "-",
            Self::Holds => "holds",
            Self::Exceeds => "exceeds",
            Self::Unbounded => "unbounded",
            Self::Contradicted => "contradicted",
            Self::Unknown => "unknown",
        }
    }

    /// Whether something has to be changed.
    #[must_use]
    pub const fn is_bad(self) -> bool {
        matches!(self, Self::Exceeds | Self::Unbounded | Self::Contradicted)
    }
}

/// What was found of a row.
pub(super) struct Found<'a> {
    pub(super) row: &'a Row,
    /// None if it is no task.
    pub(super) bound: Option<Result<Duration, NoBound>>,
    pub(super) around: Option<&'a Around>,
    pub(super) tasks: &'a [Task],
    /// The name of a task.
    pub(super) names: &'a dyn Fn(usize) -> &'a str,
    /// What may run before it besides, and what to state.
    pub(super) open: Option<String>,
}

type Judged = (Option<Duration>, Verdict, Option<String>);

impl Found<'_> {
    pub(super) fn judge(self) -> Judged {
        let row = self.row;
        let missing = self.missing();
        let Some(deadline) = row.deadline else {
            // What wakes it, and how late it may be, is of interest only if it is known.
            return match self.bound {
                Some(Ok(bound)) if missing.is_none() => {
                    let contradiction = self.contradiction(bound);
                    let verdict = contradiction.as_ref().map(|_| Verdict::Contradicted);
                    let verdict = verdict.unwrap_or(Verdict::Nothing);
                    (Some(bound), verdict, contradiction)
                }
                _ => (None, Verdict::Nothing, None),
            };
        };
        let bound = match (missing, self.bound) {
            (Some(missing), _) => return (None, Verdict::Unknown, Some(missing)),
            (None, None) => return (None, Verdict::Unknown, None),
            (None, Some(Ok(bound))) => bound,
            (None, Some(Err(no_bound))) => {
                let (verdict, advice) = self.without(no_bound);
                return (None, verdict, Some(advice));
            }
        };
        let (verdict, advice) = match self.contradiction(bound) {
            Some(contradiction) => (Verdict::Contradicted, Some(contradiction)),
            None if bound <= deadline => (Verdict::Holds, None),
            None => (Verdict::Exceeds, Some(self.change(bound - deadline))),
        };
        (Some(bound), verdict, advice)
    }

    /// That the recording has a longer response.
    fn contradiction(&self, bound: Duration) -> Option<String> {
        let measured = self.row.measured.filter(|measured| *measured > bound)?;
        Some(format!(
            "it took {measured:?} in the recording: the timer was later than `latency`, a job \
             waited for other processes, or something ran on its core that the model does not have: raise `latency`, or \
             look at the recording with `luna convert`"
        ))
    }

    /// What the row itself lacks.
    fn missing(&self) -> Option<String> {
        let row = self.row;
        let text = match (&row.executor, row.core) {
            (None, _) => "it names no executor: write `on = \"…\"` in its part".to_owned(),
            (Some(executor), None) => {
                format!("`{executor}` is on no core: write `core = …` in its table")
            }
            (Some(executor), Some(_)) if self.bound.is_none() => match &row.policy {
                Some(policy) => format!("no bound covers `{policy}` of `{executor}`"),
                None => format!(
                    "the policy of `{executor}` is not known: write `policy = \"fifo:80\"` in its \
                     table"
                ),
            },
            _ if matches!(self.bound, Some(Err(NoBound::Ordinary))) => return None,
            _ if row.period.is_none() && !row.is_seen => {
                "it has a deadline and no period: write `period = \"…\"`, or give a recording"
                    .to_owned()
            }
            _ if row.cost.is_none() => {
                "its cost is not known: write `cost = \"…\"` in its part, or use --costs".to_owned()
            }
            _ => self.open.clone()?,
        };
        Some(text)
    }

    fn without(&self, no_bound: NoBound) -> (Verdict, String) {
        let on = self.row.executor.as_deref().unwrap_or("");
        match no_bound {
            NoBound::Ordinary => (
                Verdict::Unbounded,
                format!(
                    "`{on}` has no real-time policy: write `policy = \"fifo:80\"` in its table"
                ),
            ),
            NoBound::Overload { .. } | NoBound::TooLong { .. } => {
                (Verdict::Unbounded, no_bound.to_string())
            }
            NoBound::Unknown(Gap::Demand(task)) => {
                let name = (self.names)(task);
                (
                    Verdict::Unknown,
                    format!(
                        "`{name}` runs before it, and its period or its cost is not known: state \
                         both, or give a recording"
                    ),
                )
            }
            NoBound::Unknown(Gap::Poll(task)) => {
                let name = (self.names)(task);
                (
                    Verdict::Unknown,
                    format!(
                        "it may have to wait for a poll of `{name}`, whose length is not known: \
                         state its `longest_poll`"
                    ),
                )
            }
        }
    }

    /// What to change so that it needs `excess` less.
    fn change(&self, excess: Duration) -> String {
        let mut advice = format!("it needs {excess:?} less: ");
        let Some(around) = self.around else {
            return advice + "lower its cost, or allow it more time";
        };
        let poll = |task: usize| self.tasks[task].longest_poll.unwrap_or_default();
        if let Some(other) = around.blocking
            && poll(other) > excess
        {
            let (name, most) = ((self.names)(other), poll(other) - excess);
            advice += &format!(
                "split the polls of less urgent processes of its executor to at most {most:?} \
                 (`{name}` has one of {:?}), or ",
                poll(other)
            );
        }
        let rivals = around.beside.iter().chain(&around.above);
        let share = |task: usize| {
            let demand = self.tasks[task].demand.as_ref();
            demand.map_or(0.0, super::Demand::utilization)
        };
        match rivals.max_by(|one, other| share(**one).total_cmp(&share(**other))) {
            Some(rival) => {
                let (name, share) = ((self.names)(*rival), share(*rival) * 100.0);
                advice += &format!(
                    "move `{name}`, which takes {share:.1} % of the core before it, to another \
                     core, or lower costs"
                );
            }
            None => advice += "lower its cost, or allow it more time",
        }
        advice
    }
}

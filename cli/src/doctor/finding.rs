//! What is found: one line of a diagnosis, and what makes such a line.

use super::machine::Machine;
use luna_machine::facts::{Unread, UnreadReason};
use serde::Serialize;

/// The verdict of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Verdict {
    /// As it should be.
    Good,
    /// Not known.
    Unknown,
    /// A loop keeps its period, but could keep it better.
    CouldBeBetter,
    /// A loop cannot be kept, or not always.
    Bad,
}

impl Verdict {
    /// In the words of the table.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Unknown => "unknown",
            Self::CouldBeBetter => "could be better",
            Self::Bad => "bad",
        }
    }
}

/// What part of the diagnosis a finding belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Part {
    /// Read from the machine's files.
    Machine,
    /// Measured.
    Measurement,
    /// A component of the library at work.
    SelfTest,
}

/// One line of the diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Finding {
    /// Stable, unique within a diagnosis, and the heading under which `docs/realtime.md` has more.
    pub(crate) name: String,
    /// See [`Part`].
    pub(crate) part: Part,
    /// See [`Verdict`].
    pub(crate) verdict: Verdict,
    /// What was read or measured, or why nothing was.
    pub(crate) read: String,
    /// The file or the call that it was read from.
    pub(crate) from: String,
    /// How it bears on timing.
    pub(crate) why: &'static str,
    /// What to do, with the command or kernel parameter; for what is unknown, how to know. Nothing
    /// for what is good.
    pub(crate) advice: Option<String>,
    /// Of a measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) ns: Option<Times>,
}

/// Measured times, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(crate) struct Times {
    /// How many were measured.
    pub(crate) samples: usize,
    /// The shortest.
    pub(crate) min: u64,
    /// The median.
    pub(crate) p50: u64,
    /// 99 of 100 are.
    pub(crate) p99: u64,
    /// The longest.
    pub(crate) max: u64,
}

/// What a check saw.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) verdict: Verdict,
    pub(crate) read: String,
    pub(crate) from: String,
    pub(crate) advice: Option<String>,
}

impl Seen {
    /// As it should be.
    pub(crate) fn good(read: impl Into<String>, from: impl Into<String>) -> Seen {
        Seen {
            verdict: Verdict::Good,
            read: read.into(),
            from: from.into(),
            advice: None,
        }
    }

    /// Could be better: see the advice.
    pub(crate) fn better(
        read: impl Into<String>,
        from: impl Into<String>,
        advice: impl Into<String>,
    ) -> Seen {
        Seen {
            verdict: Verdict::CouldBeBetter,
            advice: Some(advice.into()),
            ..Seen::good(read, from)
        }
    }

    /// Bad, until the advice is followed.
    pub(crate) fn bad(
        read: impl Into<String>,
        from: impl Into<String>,
        advice: impl Into<String>,
    ) -> Seen {
        Seen {
            verdict: Verdict::Bad,
            ..Seen::better(read, from, advice)
        }
    }

    /// What was read does not show it; the advice says how to find out.
    pub(crate) fn unknown(
        read: impl Into<String>,
        from: impl Into<String>,
        advice: impl Into<String>,
    ) -> Seen {
        Seen {
            verdict: Verdict::Unknown,
            ..Seen::better(read, from, advice)
        }
    }

    /// The finding of this name.
    pub(crate) fn finding(self, name: impl Into<String>, part: Part, why: &'static str) -> Finding {
        Finding {
            name: name.into(),
            part,
            verdict: self.verdict,
            read: self.read,
            from: self.from,
            why,
            advice: self.advice,
            ns: None,
        }
    }
}

/// One look at the machine's files. A new finding is one more of these in a list of `checks`.
#[derive(Debug)]
pub(crate) struct Check {
    /// The finding's.
    pub(crate) name: &'static str,
    /// The finding's.
    pub(crate) why: &'static str,
    /// How to find out if the files do not show it.
    pub(crate) otherwise: &'static str,
    /// An error makes the finding an unknown one.
    pub(crate) look: fn(&Machine) -> Result<Seen, Unread>,
}

impl Check {
    /// Looks.
    pub(crate) fn find(&self, machine: &Machine) -> Finding {
        let seen = (self.look)(machine).unwrap_or_else(|unread| {
            let how = match unread.reason {
                UnreadReason::NotPermitted => format!(
                    "run `sudo luna doctor`, which may read it; or {}",
                    self.otherwise
                ),
                _ => self.otherwise.to_owned(),
            };
            Seen::unknown(unread.to_string(), unread.file, how)
        });
        seen.finding(self.name, Part::Machine, self.why)
    }
}

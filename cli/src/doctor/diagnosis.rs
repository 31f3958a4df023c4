//! All findings, and what they come to. As JSON this is what `luna doctor --json` prints; its keys are stable.

use super::finding::{Finding, Part, Verdict};
use super::machine::Machine;
use serde::Serialize;

/// Rises when a key changes its meaning or goes.
const SCHEMA: u32 = 1;

/// Without these nothing can be said.
const ESSENTIAL: [&str; 2] = ["preemption", "real-time-policy"];

/// What the findings come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Fitness {
    /// Nothing is bad.
    Fit,
    /// Something is bad.
    Unfit,
    /// A self-test failed or hung.
    Broken,
    /// Nothing is bad, but too little could be read: the preemption model, or whether SCHED_FIFO can be had.
    Unknown,
}

impl Fitness {
    /// Besides, 2 is for a command line that cannot be used.
    fn exit_code(self) -> u8 {
        match self {
            Self::Fit => 0,
            Self::Unfit => 1,
            Self::Broken => 3,
            Self::Unknown => 4,
        }
    }
}

/// How many findings have which verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub(crate) struct Counts {
    pub(crate) good: usize,
    pub(crate) could_be_better: usize,
    pub(crate) bad: usize,
    pub(crate) unknown: usize,
}

/// The whole diagnosis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Diagnosis {
    /// Of this form: 1.
    pub(crate) schema: u32,
    /// Of the library.
    pub(crate) version: &'static str,
    pub(crate) fitness: Fitness,
    pub(crate) exit_code: u8,
    /// The core that was looked at as the real-time one.
    pub(crate) core: usize,
    /// Whether it was this machine, and not a copy of another's files.
    pub(crate) this_machine: bool,
    pub(crate) counts: Counts,
    /// In the order of [`Part`].
    pub(crate) findings: Vec<Finding>,
}

impl Diagnosis {
    /// Sums up.
    pub(crate) fn of(findings: Vec<Finding>, machine: &Machine) -> Diagnosis {
        let mut counts = Counts::default();
        let mut fitness = Fitness::Fit;
        for finding in &findings {
            match finding.verdict {
                Verdict::Good => counts.good += 1,
                Verdict::Unknown => counts.unknown += 1,
                Verdict::CouldBeBetter => counts.could_be_better += 1,
                Verdict::Bad => {
                    counts.bad += 1;
                    fitness = match (fitness, finding.part) {
                        (_, Part::SelfTest) | (Fitness::Broken, _) => Fitness::Broken,
                        _ => Fitness::Unfit,
                    };
                }
            }
        }
        let is_essential = |finding: &&Finding| ESSENTIAL.contains(&finding.name.as_str());
        let mut essential = findings.iter().filter(is_essential);
        if fitness == Fitness::Fit && essential.any(|one| one.verdict == Verdict::Unknown) {
            fitness = Fitness::Unknown;
        }
        Diagnosis {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            fitness,
            exit_code: fitness.exit_code(),
            core: machine.core,
            this_machine: machine.source.is_machine(),
            counts,
            findings,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_platform::facts::Source;

    fn fitness(findings: &[(&str, Part, Verdict)]) -> (Fitness, u8) {
        let findings = findings.iter().map(|&(name, part, verdict)| Finding {
            name: name.to_owned(),
            part,
            verdict,
            read: String::new(),
            from: String::new(),
            why: "",
            advice: None,
            ns: None,
        });
        let machine = Machine::new(Source::folder("/no/such/folder"), Some(0));
        let diagnosis = Diagnosis::of(findings.collect(), &machine);
        let counts = diagnosis.counts;
        assert_eq!(
            counts.good + counts.could_be_better + counts.bad + counts.unknown,
            diagnosis.findings.len()
        );
        (diagnosis.fitness, diagnosis.exit_code)
    }

    #[test]
    fn the_worst_decides() {
        use Part::{Machine, Measurement, SelfTest};
        use Verdict::{Bad, CouldBeBetter, Good, Unknown};
        let fit = [("a", Machine, Good), ("swap", Machine, CouldBeBetter)];
        assert_eq!(fitness(&fit), (Fitness::Fit, 0));
        let some_unknown = [("turbo", Machine, Unknown), ("x", SelfTest, Unknown)];
        assert_eq!(fitness(&some_unknown), (Fitness::Fit, 0));
        let unfit = [("a", Measurement, Bad), ("preemption", Machine, Unknown)];
        assert_eq!(fitness(&unfit), (Fitness::Unfit, 1));
        for broken in [
            [("a", SelfTest, Bad), ("b", Machine, Bad)],
            [("a", Machine, Bad), ("b", SelfTest, Bad)],
        ] {
            assert_eq!(fitness(&broken), (Fitness::Broken, 3));
        }
        for essential in ESSENTIAL {
            let unknown = [("a", Machine, Good), (essential, Machine, Unknown)];
            assert_eq!(fitness(&unknown), (Fitness::Unknown, 4));
        }
    }
}

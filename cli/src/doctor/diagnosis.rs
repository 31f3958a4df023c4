//! All findings, and what they come to. As JSON this is what `luna doctor --json` prints; its keys
//! are stable.

use super::finding::{Finding, Part, Verdict};
use super::machine::Machine;
use serde::Serialize;

/// Rises when a key changes its meaning or goes.
const SCHEMA: u32 = 2;

/// Without these no verdict is possible.
const ESSENTIAL: [&str; 2] = ["preemption", "real-time-policy"];

/// The verdict of all findings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Fitness {
    /// Nothing is bad, and nothing that was found could be better.
    Fit,
    /// Nothing is bad, but something could be better: a virtual machine, a core that is not
    /// isolated.
    FitWithFindings,
    /// Something is bad.
    Unfit,
    /// A self-test failed or hung.
    Broken,
    /// Nothing is bad, but too little could be read: the preemption model, or whether SCHED_FIFO
    /// can be had.
    Unknown,
}

impl Fitness {
    /// Besides, 2 is for a command line that cannot be used.
    fn exit_code(self) -> u8 {
        match self {
            Self::Fit | Self::FitWithFindings => 0,
            Self::Unfit => 1,
            Self::Broken => 3,
            Self::Unknown => 4,
        }
    }
}

/// How many findings of the machine and of the measurements have which verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub(crate) struct Counts {
    pub(crate) good: usize,
    pub(crate) could_be_better: usize,
    pub(crate) bad: usize,
    pub(crate) unknown: usize,
}

/// How many self-tests ended how. They are about the library, not about the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub(crate) struct SelfTests {
    pub(crate) passed: usize,
    pub(crate) failed: usize,
    pub(crate) not_run: usize,
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
    pub(crate) self_tests: SelfTests,
    /// In the order of [`Part`].
    pub(crate) findings: Vec<Finding>,
}

impl Diagnosis {
    /// Sums up.
    pub(crate) fn of(findings: Vec<Finding>, machine: &Machine) -> Diagnosis {
        let mut counts = Counts::default();
        let mut self_tests = SelfTests::default();
        for finding in &findings {
            let count = match (finding.part, finding.verdict) {
                (Part::SelfTest, Verdict::Bad) => &mut self_tests.failed,
                (Part::SelfTest, Verdict::Unknown) => &mut self_tests.not_run,
                (Part::SelfTest, _) => &mut self_tests.passed,
                (_, Verdict::Good) => &mut counts.good,
                (_, Verdict::Unknown) => &mut counts.unknown,
                (_, Verdict::CouldBeBetter) => &mut counts.could_be_better,
                (_, Verdict::Bad) => &mut counts.bad,
            };
            *count += 1;
        }
        let is_essential = |finding: &&Finding| ESSENTIAL.contains(&finding.name.as_str());
        let mut essential = findings.iter().filter(is_essential);
        let too_little_is_known = essential.any(|one| one.verdict == Verdict::Unknown);
        let fitness = if self_tests.failed > 0 {
            Fitness::Broken
        } else if counts.bad > 0 {
            Fitness::Unfit
        } else if too_little_is_known {
            Fitness::Unknown
        } else if counts.could_be_better > 0 {
            Fitness::FitWithFindings
        } else {
            Fitness::Fit
        };
        Diagnosis {
            schema: SCHEMA,
            version: env!("CARGO_PKG_VERSION"),
            fitness,
            exit_code: fitness.exit_code(),
            core: machine.core,
            this_machine: machine.source.is_machine(),
            counts,
            self_tests,
            findings,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use luna_machine::facts::Source;

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
        let (counts, tests) = (diagnosis.counts, diagnosis.self_tests);
        let all = diagnosis.findings.len();
        let of_library = |finding: &&Finding| finding.part == Part::SelfTest;
        let self_tests = diagnosis.findings.iter().filter(of_library).count();
        assert_eq!(tests.passed + tests.failed + tests.not_run, self_tests);
        assert_eq!(
            counts.good + counts.could_be_better + counts.bad + counts.unknown,
            all - self_tests
        );
        (diagnosis.fitness, diagnosis.exit_code)
    }

    #[test]
    fn the_worst_decides() {
        use Part::{Machine, Measurement, SelfTest};
        use Verdict::{Bad, CouldBeBetter, Good, Unknown};
        assert_eq!(fitness(&[("a", Machine, Good)]), (Fitness::Fit, 0));
        let fit = [("a", Machine, Good), ("swap", Machine, CouldBeBetter)];
        assert_eq!(fitness(&fit), (Fitness::FitWithFindings, 0));
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

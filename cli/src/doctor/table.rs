//! A diagnosis as text for people.

use super::diagnosis::{Diagnosis, Fitness};
use super::finding::{Finding, Part, Verdict};
use crate::columns::of_texts;

/// The widths of the verdicts and of the names.
const HEAD: [u16; 2] = [16, 24];
/// The width of what stands before an explanation.
const MORE: u16 = 22;

/// Draws it: one line for what is good, more for the rest; with `explain` also why each finding
/// matters.
pub(crate) fn draw(diagnosis: &Diagnosis, explain: bool) -> String {
    let whose = match diagnosis.this_machine {
        true => "this machine",
        false => "the machine whose files these are",
    };
    let title = format!(
        "luna doctor: {whose}, with core {} for real time",
        diagnosis.core
    );
    let mut text = of_texts([], [vec![title]]);
    for (part, title) in [
        (Part::Machine, "the machine"),
        (Part::Measurement, "measured"),
        (Part::SelfTest, "self-test"),
    ] {
        let of_part = diagnosis
            .findings
            .iter()
            .filter(|finding| finding.part == part);
        let drawn: String = of_part.map(|finding| draw_one(finding, explain)).collect();
        if !drawn.is_empty() {
            text += &format!("\n{title}\n{drawn}");
        }
    }
    text + "\n" + &of_texts([], [vec![summary(diagnosis)]])
}

fn draw_one(finding: &Finding, explain: bool) -> String {
    let read = match finding.from.starts_with('/') && finding.read.contains(&finding.from) {
        true => finding.read.clone(),
        false => format!("{} ({})", finding.read, finding.from),
    };
    let verdict = finding.verdict.word().to_owned();
    let mut text = of_texts(HEAD, [vec![verdict, finding.name.clone(), read]]);
    let mut add = |word: &str, more: &str| {
        let row = vec![format!("{word:>21}"), more.to_owned()];
        text += &of_texts([MORE], [row]);
    };
    if explain || finding.verdict != Verdict::Good {
        add("why:", finding.why);
    }
    if let Some(advice) = &finding.advice {
        let word = match finding.verdict {
            Verdict::Unknown => "know:",
            _ => "do:",
        };
        add(word, advice);
    }
    text
}

fn summary(diagnosis: &Diagnosis) -> String {
    let counts = diagnosis.counts;
    let verdict = match diagnosis.fitness {
        Fitness::Fit => "fit: nothing is bad",
        Fitness::FitWithFindings => "fit with findings: nothing is bad, something could be better",
        Fitness::Unfit => "unfit: something is bad",
        Fitness::Unknown => "unknown: too little could be read",
        Fitness::Broken => "broken: a self-test did not pass",
    };
    let tests = diagnosis.self_tests;
    let self_tests = match tests.passed + tests.failed + tests.not_run {
        0 => String::new(),
        _ => format!(
            " Self-tests: {} passed, {} failed, {} not run.",
            tests.passed, tests.failed, tests.not_run
        ),
    };
    format!(
        "{verdict}. {} good, {} could be better, {} bad, {} unknown. docs/realtime.md has more on each of them.{self_tests} Exit code {}.",
        counts.good, counts.could_be_better, counts.bad, counts.unknown, diagnosis.exit_code
    )
}

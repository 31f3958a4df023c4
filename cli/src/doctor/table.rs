//! A diagnosis as text for people, at most 110 columns wide.

use super::diagnosis::{Diagnosis, Fitness};
use super::finding::{Finding, Part, Verdict};
use std::fmt::Write;

/// No line is longer.
pub(crate) const WIDTH: usize = 110;
/// Of the names.
const NAME: usize = 23;
/// Of the verdicts, with the gap behind them.
const VERDICT: usize = 16;

/// Draws it: one line for what is good, more for the rest; with `explain` also why each finding
/// matters.
pub(crate) fn draw(diagnosis: &Diagnosis, explain: bool) -> String {
    let mut text = String::new();
    let whose = match diagnosis.this_machine {
        true => "this machine",
        false => "the machine whose files these are",
    };
    let title = format!(
        "luna doctor: {whose}, with core {} for real time",
        diagnosis.core
    );
    wrap(&mut text, "", &title);
    for (part, title) in [
        (Part::Machine, "the machine"),
        (Part::Measurement, "measured"),
        (Part::SelfTest, "self-test"),
    ] {
        let mut of_part = diagnosis
            .findings
            .iter()
            .filter(|finding| finding.part == part)
            .peekable();
        if of_part.peek().is_some() {
            let _ = writeln!(text, "\n{title}");
        }
        for finding in of_part {
            draw_one(&mut text, finding, explain);
        }
    }
    text.push('\n');
    wrap(&mut text, "", &summary(diagnosis));
    text
}

fn draw_one(text: &mut String, finding: &Finding, explain: bool) {
    let head = format!(
        "{:<VERDICT$}{:<NAME$} ",
        finding.verdict.word(),
        finding.name
    );
    let read = match finding.from.starts_with('/') && finding.read.contains(&finding.from) {
        true => finding.read.clone(),
        false => format!("{} ({})", finding.read, finding.from),
    };
    wrap(text, &head, &read);
    let margin = " ".repeat(VERDICT);
    if explain || finding.verdict != Verdict::Good {
        wrap(text, &format!("{margin} why: "), finding.why);
    }
    if let Some(advice) = &finding.advice {
        let word = match finding.verdict {
            Verdict::Unknown => "know",
            _ => "do",
        };
        wrap(text, &format!("{margin}{word:>4}: "), advice);
    }
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

/// Adds `words` behind `head`, on as many lines as it takes, the later ones below the first word.
fn wrap(text: &mut String, head: &str, words: &str) {
    let margin = head.chars().count().min(WIDTH / 2);
    let mut line = head.to_owned();
    let mut length = head.chars().count();
    let mut is_empty = true;
    for word in words.split_whitespace() {
        let mut rest: &str = word;
        loop {
            let size = rest.chars().count();
            let gap = usize::from(!is_empty);
            if length + gap + size <= WIDTH {
                line.push_str(&" ".repeat(gap));
                line.push_str(rest);
                length += gap + size;
                is_empty = false;
                break;
            }
            if is_empty {
                // Longer than a line: cut.
                let room = WIDTH.saturating_sub(length).max(1);
                let cut = rest
                    .char_indices()
                    .nth(room)
                    .map_or(rest.len(), |(at, _)| at);
                line.push_str(&rest[..cut]);
                rest = &rest[cut..];
                is_empty = false;
                length = WIDTH;
                if rest.is_empty() {
                    break;
                }
            }
            let _ = writeln!(text, "{}", line.trim_end());
            line = " ".repeat(margin);
            length = margin;
            is_empty = true;
        }
    }
    let _ = writeln!(text, "{}", line.trim_end());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(head: &str, words: &str) -> Vec<String> {
        let mut text = String::new();
        wrap(&mut text, head, words);
        text.lines().map(str::to_owned).collect()
    }

    #[test]
    fn long_texts_go_on_below_their_first_word() {
        let words = ["word"; 40].join(" ");
        let lines = lines("  head ", &words);
        assert!(lines.len() > 1);
        assert!(lines.iter().all(|line| line.chars().count() <= WIDTH));
        assert!(lines[0].starts_with("  head word"));
        assert!(lines[1].starts_with("       word"));
        let joined = lines.join(" ").replace("head", "");
        assert_eq!(joined.split_whitespace().count(), 40);
    }

    #[test]
    fn a_word_longer_than_a_line_is_cut_and_nothing_is_lost() {
        let word = "ä".repeat(300);
        let lines = lines("head ", &word);
        assert!(lines.iter().all(|line| line.chars().count() <= WIDTH));
        let letters = lines.join("").matches('ä').count();
        assert_eq!(letters, 300);
        assert_eq!(super::tests::lines("a ", ""), ["a"]);
    }
}

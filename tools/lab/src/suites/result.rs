//! What a test program printed.

use super::left_out::LeftOut;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt::Write;

/// How many lines of a program without libtest are shown when it fails.
const SHOWN: usize = 60;

/// The outcome of a test program.
#[derive(Debug)]
pub(crate) struct Outcome {
    has_harness: bool,
    left_out: Vec<LeftOut>,
    /// What libtest left out itself by these.
    filtered: u64,
    ignored: usize,
    passed: usize,
    /// The failed tests, with what each printed.
    failed: Vec<(String, String)>,
    running: BTreeSet<String>,
    /// The harness has said how the whole ended.
    has_suite_ended: bool,
    /// What is no event.
    other: Vec<String>,
    ended: Result<u8, String>,
}

impl Outcome {
    /// Of a program that prints the events of libtest, or whose exit code says all.
    pub(crate) fn new(has_harness: bool, left_out: Vec<LeftOut>) -> Outcome {
        Outcome {
            has_harness,
            left_out,
            filtered: 0,
            ignored: 0,
            passed: 0,
            failed: Vec::new(),
            running: BTreeSet::new(),
            has_suite_ended: false,
            other: Vec::new(),
            ended: Err("it did not begin".to_owned()),
        }
    }

    /// Takes a line of its output.
    pub(crate) fn add(&mut self, line: &str) {
        let event = serde_json::from_str::<Value>(line).unwrap_or_default();
        let text = |key: &str| event[key].as_str().unwrap_or_default();
        match (text("type"), text("event")) {
            ("test", "started") => {
                self.running.insert(text("name").to_owned());
            }
            ("test", "ok") => {
                self.running.remove(text("name"));
                self.passed += 1;
            }
            ("test", "ignored") => {
                self.running.remove(text("name"));
                self.ignored += 1;
            }
            ("test", "failed") => {
                self.running.remove(text("name"));
                self.failed
                    .push((text("name").to_owned(), text("stdout").to_owned()));
            }
            ("suite", "ok" | "failed") => {
                self.has_suite_ended = true;
                self.filtered = event["filtered_out"].as_u64().unwrap_or(0);
            }
            ("suite", _) | ("test", "timeout") => {}
            _ => self.other.push(line.to_owned()),
        }
    }

    /// Takes the program's exit code, or why there is none.
    pub(crate) fn end(&mut self, ended: Result<u8, String>) {
        self.ended = ended;
    }

    pub(crate) fn is_passed(&self) -> bool {
        let has_run = !self.has_harness || self.has_suite_ended && self.running.is_empty();
        self.ended == Ok(0) && self.failed.is_empty() && has_run
    }

    /// Counts, on one line.
    pub(crate) fn summary(&self) -> String {
        let (passed, failed) = (self.passed, self.failed.len());
        let mut text = match self.has_harness {
            true => format!("{passed} passed, {failed} failed"),
            false => (if self.is_passed() { "passed" } else { "failed" }).to_owned(),
        };
        let left_out = self.filtered + self.ignored as u64;
        if left_out > 0 {
            let _ = write!(text, ", {left_out} left out");
        }
        if !self.running.is_empty() {
            let _ = write!(text, ", {} not ended", self.running.len());
        }
        text
    }

    /// What failed and why, which tests were running, and what was left out: lines for a person.
    pub(crate) fn details(&self) -> String {
        let mut text = String::new();
        let mut line = |said: &str| {
            text.push_str("    ");
            text.push_str(said);
            text.push('\n');
        };
        for test in &self.left_out {
            line(&format!("left out: {}: {}", test.name, test.reason));
        }
        for (name, output) in &self.failed {
            line(&format!("failed: {name}"));
            output.lines().for_each(|said| line(&format!("    {said}")));
        }
        if self.is_passed() {
            return text;
        }
        for name in &self.running {
            line(&format!("running at the end: {name}"));
        }
        match &self.ended {
            Err(reason) => reason.lines().for_each(&mut line),
            Ok(code) if *code != 0 => line(&format!("exit code {code}")),
            Ok(_) => {}
        }
        let from = self.other.len().saturating_sub(SHOWN);
        self.other[from..].iter().for_each(|said| line(said));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(lines: &[&str], ended: Result<u8, String>) -> Outcome {
        let mut outcome = Outcome::new(true, Vec::new());
        lines.iter().for_each(|line| outcome.add(line));
        outcome.end(ended);
        outcome
    }

    const STARTED: &str = r#"{ "type": "test", "event": "started", "name": "a::one" }"#;
    const OK: &str = r#"{ "type": "test", "name": "a::one", "event": "ok" }"#;
    const FAILED: &str =
        r#"{ "type": "test", "name": "a::two", "event": "failed", "stdout": "panicked\n" }"#;
    const SUITE: &str = r#"{ "type": "suite", "event": "ok", "passed": 1, "failed": 0, "ignored": 0, "filtered_out": 3 }"#;

    #[test]
    fn tests_are_counted() {
        let outcome = after(&[STARTED, OK, SUITE], Ok(0));
        assert!(outcome.is_passed());
        assert_eq!(outcome.summary(), "1 passed, 0 failed, 3 left out");
        assert_eq!(outcome.details(), "");
    }

    #[test]
    fn a_failed_test_shows_what_it_printed() {
        let outcome = after(&[STARTED, OK, FAILED], Ok(101));
        assert!(!outcome.is_passed());
        assert_eq!(outcome.summary(), "1 passed, 1 failed");
        let details = outcome.details();
        assert!(
            details.contains("failed: a::two\n        panicked\n"),
            "{details}"
        );
    }

    #[test]
    fn tests_that_do_not_end_are_named() {
        let outcome = after(&[STARTED], Err("it did not end in 9 s".to_owned()));
        assert!(!outcome.is_passed());
        assert_eq!(outcome.summary(), "0 passed, 0 failed, 1 not ended");
        let details = outcome.details();
        assert!(
            details.contains("running at the end: a::one\n    it did not end in 9 s"),
            "{details}"
        );
    }

    #[test]
    fn a_program_that_dies_is_no_success() {
        assert!(!after(&[STARTED, OK], Ok(139)).is_passed());
        assert!(!after(&[], Err("panic".to_owned())).is_passed());
    }
}

//! The library at work on this machine: a small, real check of every component, each bounded in
//! time.

mod choice;
mod communication;
mod execution;
mod locks;
mod outside;
mod platform;
mod safety;
mod time;

use super::finding::{Finding, Part, Seen};
use luna::System;
use std::fmt;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// A check that takes longer hangs: they take milliseconds, and a second or two on a machine that
/// is very busy.
const PATIENCE: Duration = Duration::from_secs(20);
const REPORT_IT: &str = "the library does not work here: report it with this output";

/// A check of one component. A new component is one more of these in a list of this folder.
#[derive(Debug)]
pub(crate) struct Test {
    name: &'static str,
    component: &'static str,
    /// What it shows.
    shows: &'static str,
    /// Returns in a few words what was done.
    run: fn() -> Outcome,
}

type Outcome = Result<String, Trouble>;

/// Why a check did not pass.
#[derive(Debug)]
enum Trouble {
    /// The library is wrong here, or the machine.
    Failed(String),
    /// It needs what this machine or this user has not.
    CannotRun { why: String, how: String },
}

impl From<luna::Error> for Trouble {
    fn from(error: luna::Error) -> Self {
        Self::Failed(error.to_string())
    }
}

/// All of them, in the order in which they run.
fn all() -> impl Iterator<Item = &'static Test> {
    [
        platform::TESTS,
        communication::TESTS,
        choice::TESTS,
        locks::TESTS,
        execution::TESTS,
        time::TESTS,
        safety::TESTS,
        outside::TESTS,
    ]
    .into_iter()
    .flatten()
}

/// Runs all.
pub(crate) fn run_all() -> Vec<Finding> {
    all().map(|test| run_one(test, PATIENCE)).collect()
}

/// Runs one on a thread of its own, which is detached if it hangs.
fn run_one(test: &Test, patience: Duration) -> Finding {
    let (report, reported) = mpsc::channel();
    let run = test.run;
    let started = Instant::now();
    let spawned = thread::Builder::new()
        .name(test.name.to_owned())
        .spawn(move || drop(report.send(run())));
    let outcome = match spawned {
        Ok(_) => reported.recv_timeout(patience),
        Err(error) => Ok(Err(Trouble::CannotRun {
            why: format!("the system made no thread: {error}"),
            how: "raise the limits on threads (ulimit -u, the group's pids.max)".to_owned(),
        })),
    };
    let took = started.elapsed().as_millis();
    let from = test.component;
    let seen = match outcome {
        Ok(Ok(done)) => Seen::good(format!("{done}, in {took} ms"), from),
        Ok(Err(Trouble::Failed(why))) => {
            Seen::bad(format!("failed after {took} ms: {why}"), from, REPORT_IT)
        }
        Ok(Err(Trouble::CannotRun { why, how })) => {
            Seen::unknown(format!("not run: {why}"), from, how)
        }
        Err(RecvTimeoutError::Timeout) => {
            let seconds = patience.as_secs_f32();
            Seen::bad(format!("hangs: no end within {seconds} s"), from, REPORT_IT)
        }
        // Only a panic drops the sender before it has sent.
        Err(RecvTimeoutError::Disconnected) => {
            Seen::bad(format!("panicked after {took} ms"), from, REPORT_IT)
        }
    };
    seen.finding(test.name, Part::SelfTest, test.shows)
}

/// An error unless both are the same.
fn same<T: PartialEq + fmt::Debug>(what: &str, got: T, expected: T) -> luna::Result<()> {
    if got == expected {
        return Ok(());
    }
    Err(luna::Error::other(format!(
        "{what}: got {got:?} instead of {expected:?}"
    )))
}

/// An error unless the condition holds.
fn ensure(is_so: bool, what: &str) -> luna::Result<()> {
    same(what, is_so, true)
}

/// Runs a system of one executor.
fn on_one_executor<T>(
    build: impl FnOnce(&luna::Executor) -> luna::Result<T>,
) -> luna::Result<luna::Report> {
    let mut system = System::new("self-test");
    build(&system.executor("main").build()?)?;
    system.run()
}

/// Where the two ends of a channel are.
#[derive(Debug, Clone, Copy)]
enum Ends {
    OneExecutor,
    TwoExecutors,
    ExecutorAndThread,
}

/// Runs a system of two processes.
fn run_both(
    ends: Ends,
    left: impl Future<Output = luna::Result<()>> + Send + 'static,
    right: impl Future<Output = luna::Result<()>> + Send + 'static,
) -> luna::Result<luna::Report> {
    let mut system = System::new("self-test");
    let here = system.executor("here").build()?;
    here.process("left").spawn(left)?;
    match ends {
        Ends::OneExecutor => here.process("right").spawn(right)?,
        Ends::TwoExecutors => {
            let there = system.executor("there").build()?;
            there.process("right").spawn(right)?
        }
        Ends::ExecutorAndThread => system.thread("there").process("right").spawn(right)?,
    };
    system.run()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::finding::Verdict;
    use std::collections::HashSet;

    fn within(patience: Duration, run: fn() -> Outcome) -> Finding {
        let test = Test {
            name: "one",
            component: "x",
            shows: "y",
            run,
        };
        run_one(&test, patience)
    }

    fn one(run: fn() -> Outcome) -> Finding {
        within(PATIENCE, run)
    }

    #[test]
    fn a_hang_a_failure_and_a_panic_are_told_apart() {
        let hangs = within(Duration::from_millis(50), || {
            loop {
                thread::park();
            }
        });
        assert_eq!(hangs.verdict, Verdict::Bad);
        assert!(hangs.read.contains("hangs"), "{hangs:?}");
        let fails = one(|| Ok(same("sum", 3, 4).map(|()| String::new())?));
        assert_eq!(fails.verdict, Verdict::Bad);
        assert!(fails.read.contains("sum: got 3 instead of 4"), "{fails:?}");
        let panics = one(|| std::panic::resume_unwind(Box::new("as the test wants")));
        assert_eq!(panics.verdict, Verdict::Bad);
        assert!(panics.read.contains("panicked"), "{panics:?}");
        let cannot = one(|| {
            Err(Trouble::CannotRun {
                why: "no core".to_owned(),
                how: "buy one".to_owned(),
            })
        });
        assert_eq!(cannot.verdict, Verdict::Unknown);
        assert_eq!(cannot.advice.as_deref(), Some("buy one"));
    }

    #[test]
    fn names_are_unique() {
        let names: Vec<_> = all().map(|test| test.name).collect();
        assert_eq!(names.iter().collect::<HashSet<_>>().len(), names.len());
    }

    /// As a test too: the library works where its tests run.
    #[test]
    fn all_pass_here_or_say_what_they_need() {
        for finding in run_all() {
            assert_ne!(finding.verdict, Verdict::Bad, "{finding:?}");
            if finding.verdict == Verdict::Unknown {
                let text = format!("skipped: self-test {}: {}\n", finding.name, finding.read);
                // Not by a macro: the harness captures its output.
                let _ = std::io::Write::write_all(&mut std::io::stderr(), text.as_bytes());
            }
        }
    }
}

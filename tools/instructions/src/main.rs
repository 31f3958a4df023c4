//! Counts exactly what LUNA's hot operations execute: instructions, and atomic read-modify-writes
//! among them.

mod atomics;
mod callgrind;
mod compiled_in;
mod gate;
mod operations;
mod profile;
mod recorded;
mod table;

use crate::atomics::{Atomic, Objects};
use crate::callgrind::Counted;
use crate::gate::Verdict;
use crate::operations::{Operation, Operations, hindrance};
use crate::recorded::{Figures, Recorded};
use std::env;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

const USAGE: &str = "\
Counts what LUNA's hot operations execute, in Valgrind's callgrind.

Usage: luna-instructions [gate | show | record | events] [OPERATION]...

  gate     holds the counts against the recorded ones, and fails when they differ by too much (default)
  show     prints where an operation's instructions and atomic read-modify-writes are
  record   writes the counts to tools/instructions/recorded.txt
  events   as gate; then counts with CSP events compiled in and not recorded,
           and fails when these counts exceed those without events by too much

An OPERATION is a part of a name; without any, all are counted.";

/// An operation with what was counted of it.
struct Outcome<'a> {
    operation: &'a Operation,
    counted: Counted,
    atomics: Vec<Atomic>,
    program: &'a Path,
    c_library: &'a str,
}

impl Outcome<'_> {
    fn verdict(&self, recorded: &Recorded) -> Verdict {
        let old = recorded.figures.get(&self.operation.name).copied();
        let is_own = self.counted.is_own(self.program);
        if !is_own && recorded.c_library != self.c_library && old.is_some() {
            return Verdict::OtherLibrary;
        }
        Verdict::of(old, self.figures())
    }

    fn figures(&self) -> Figures {
        Figures {
            instructions: self.counted.instructions,
            // From a positive zero, which is what the empty sum is not.
            atomics: self.atomics.iter().fold(0.0, |sum, one| sum + one.times),
        }
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let (command, parts) = match arguments.split_first() {
        None => ("gate", &[][..]),
        Some((command, parts)) => (command.as_str(), parts),
    };
    match run(command, parts) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::from(2)
        }
    }
}

/// Executes the command line. Returns whether the counts are within their limits.
fn run(command: &str, parts: &[String]) -> Result<bool, String> {
    let examine = match command {
        "gate" | "events" => judge,
        "show" => show,
        "record" => record,
        _ => return Err(USAGE.to_owned()),
    };
    if let Some(reason) = hindrance() {
        println!("skipped: instruction counts: {reason}");
        return Ok(matches!(command, "gate" | "events"));
    }
    if command == "events" {
        return compiled_in::judge(parts);
    }
    let operations = Operations::build(&[])?;
    let outcomes = count_all(&operations, &operations.select(parts)?)?;
    examine(&operations, &outcomes)
}

/// Counts all operations, as many at a time as there are cores: other load does not change the
/// counts.
fn count_all<'a>(
    operations: &'a Operations,
    chosen: &[&'a Operation],
) -> Result<Vec<Outcome<'a>>, String> {
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<Result<Counted, String>>>> =
        chosen.iter().map(|_| Mutex::new(None)).collect();
    let count_some = || {
        while let Some(index) = Some(next.fetch_add(1, Ordering::Relaxed))
            && let Some(operation) = chosen.get(index)
        {
            let counted = callgrind::count(&operations.program, operation);
            *results[index].lock().expect("no counting thread panics") = Some(counted);
        }
    };
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(count_some);
        }
    });
    let mut objects = Objects::default();
    let mut outcomes = Vec::new();
    for (operation, result) in chosen.iter().zip(results) {
        let counted = result
            .into_inner()
            .expect("no counting thread panics")
            .expect("every operation was counted")?;
        let atomics = objects.atomics(&counted)?;
        outcomes.push(Outcome {
            operation,
            program: &operations.program,
            counted,
            atomics,
            c_library: &operations.c_library,
        });
    }
    Ok(outcomes)
}

fn show(_: &Operations, outcomes: &[Outcome<'_>]) -> Result<bool, String> {
    table::details(outcomes);
    Ok(true)
}

fn record(operations: &Operations, outcomes: &[Outcome<'_>]) -> Result<bool, String> {
    let mut recorded = Recorded::load()?;
    let is_other =
        recorded.compiler != operations.compiler || recorded.c_library != operations.c_library;
    if is_other && outcomes.len() != operations.all.len() {
        return Err(format!(
            "the figures are of {} and {}, this is {} and {}: record all operations",
            recorded.compiler, recorded.c_library, operations.compiler, operations.c_library
        ));
    }
    table::comparison(outcomes, &recorded);
    recorded.compiler = operations.compiler.clone();
    recorded.c_library = operations.c_library.clone();
    // Operations that do not exist any more are removed.
    let is_one = |name: &String| operations.all.iter().any(|one| one.name == *name);
    recorded.figures.retain(|name, _| is_one(name));
    for outcome in outcomes {
        let name = outcome.operation.name.clone();
        recorded.figures.insert(name, outcome.figures());
    }
    recorded.save(operations.all.iter().map(|operation| &*operation.name))?;
    println!("\nrecorded in {}", recorded::path().display());
    Ok(true)
}

fn judge(operations: &Operations, outcomes: &[Outcome<'_>]) -> Result<bool, String> {
    let recorded = Recorded::load()?;
    table::comparison(outcomes, &recorded);
    println!();
    if recorded.compiler != operations.compiler {
        println!(
            "not judged: the figures are recorded for {}, and this is {}",
            recorded.compiler, operations.compiler
        );
        return Ok(true);
    }
    if recorded.c_library != operations.c_library {
        println!(
            "what the C library has a share in is recorded for {}, and this is {}",
            recorded.c_library, operations.c_library
        );
    }
    let failures = outcomes
        .iter()
        .filter(|outcome| outcome.verdict(&recorded).is_failure())
        .count();
    if failures > 0 {
        println!(
            "{failures} of {} operations changed. If that is meant: cargo run -p luna-instructions -- record",
            outcomes.len()
        );
    }
    println!("{} passed, {failures} failed", outcomes.len() - failures);
    Ok(failures == 0)
}

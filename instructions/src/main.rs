//! Counts what LUNA's hot operations execute, exactly: instructions, and atomic read-modify-writes among them.

mod atomics;
mod callgrind;
mod gate;
mod laps;
mod operations;
mod profile;
mod recorded;
mod table;

use crate::atomics::{Atomic, Objects};
use crate::callgrind::Counted;
use crate::gate::Verdict;
use crate::operations::Operation;
use crate::recorded::{Figures, Recorded};
use std::env;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

const USAGE: &str = "\
Counts what LUNA's hot operations execute, in Valgrind's callgrind.

Usage: luna-instructions [gate | show | record] [OPERATION]...

  gate     holds the counts against the recorded ones, and fails when they differ by too much (default)
  show     prints where an operation's instructions and atomic read-modify-writes are
  record   writes the counts to instructions/recorded.txt
  list     prints the operations

An OPERATION is a part of a name; without any, all are counted.";

/// An operation with what was counted of it.
struct Outcome {
    operation: &'static Operation,
    counted: Counted,
    atomics: Vec<Atomic>,
}

impl Outcome {
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
    let (command, rest) = match arguments.split_first() {
        None => ("gate", &[][..]),
        Some((command, rest)) => (command.as_str(), rest),
    };
    let outcome = match command {
        callgrind::DO => perform(rest),
        "gate" | "show" | "record" => selected(rest).and_then(|chosen| examine(command, &chosen)),
        "list" => {
            for operation in operations::ALL {
                println!("{}", operation.name);
            }
            Ok(true)
        }
        _ => Err(USAGE.to_owned()),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::from(2)
        }
    }
}

/// Does an operation: what callgrind is to count.
fn perform(arguments: &[String]) -> Result<bool, String> {
    let [name] = arguments else {
        return Err(USAGE.to_owned());
    };
    let operation = operations::ALL
        .iter()
        .find(|operation| operation.name == name)
        .ok_or_else(|| format!("no operation `{name}`"))?;
    (operation.run)(operation.steps).map_err(|error| error.to_string())?;
    Ok(true)
}

/// The operations whose names contain one of `parts`.
fn selected(parts: &[String]) -> Result<Vec<&'static Operation>, String> {
    let is_chosen = |operation: &&Operation| {
        parts.is_empty()
            || parts
                .iter()
                .any(|part| operation.name.contains(part.as_str()))
    };
    let chosen: Vec<_> = operations::ALL.iter().filter(is_chosen).collect();
    if chosen.is_empty() {
        return Err(format!("no operation's name contains {}", parts.join(", ")));
    }
    Ok(chosen)
}

/// Why the counts of this program, or on this machine, would say nothing.
fn hindrance() -> Option<&'static str> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        Some("the figures are those of x86-64 Linux")
    } else if cfg!(debug_assertions) {
        Some("this is not a release build")
    } else if !callgrind::is_there() {
        Some("valgrind is not installed")
    } else {
        None
    }
}

fn examine(command: &str, chosen: &[&'static Operation]) -> Result<bool, String> {
    if let Some(reason) = hindrance() {
        println!("skipped: instruction counts: {reason}");
        return Ok(command == "gate");
    }
    let outcomes = count_all(chosen)?;
    match command {
        "show" => {
            table::details(&outcomes);
            Ok(true)
        }
        "record" => record(&outcomes),
        _ => judge(&outcomes),
    }
}

/// Counts all, as many at a time as there are cores: other programs on the machine do not change a count.
fn count_all(chosen: &[&'static Operation]) -> Result<Vec<Outcome>, String> {
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<Result<Counted, String>>>> =
        chosen.iter().map(|_| Mutex::new(None)).collect();
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some((operation, result)) = {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    chosen.get(index).zip(results.get(index))
                } {
                    let counted = callgrind::count(operation);
                    *result.lock().expect("nobody panics with it") = Some(counted);
                }
            });
        }
    });
    let mut objects = Objects::default();
    let mut outcomes = Vec::new();
    for (operation, result) in chosen.iter().zip(results) {
        let counted = result
            .into_inner()
            .expect("nobody panics with it")
            .expect("every operation was counted")?;
        let atomics = objects.atomics(&counted)?;
        outcomes.push(Outcome {
            operation,
            counted,
            atomics,
        });
    }
    Ok(outcomes)
}

fn record(outcomes: &[Outcome]) -> Result<bool, String> {
    let mut recorded = Recorded::load()?;
    let compiler = env!("LUNA_COMPILER");
    if recorded.compiler != compiler && outcomes.len() != operations::ALL.len() {
        return Err(format!(
            "the figures are of {}, this is {compiler}: record all operations",
            recorded.compiler
        ));
    }
    table::comparison(outcomes, &recorded);
    recorded.compiler = compiler.to_owned();
    for outcome in outcomes {
        let name = outcome.operation.name.to_owned();
        recorded.figures.insert(name, outcome.figures());
    }
    recorded.save(operations::ALL.iter().map(|operation| operation.name))?;
    println!("\nrecorded in {}", recorded::path().display());
    Ok(true)
}

fn judge(outcomes: &[Outcome]) -> Result<bool, String> {
    let recorded = Recorded::load()?;
    table::comparison(outcomes, &recorded);
    let failures = outcomes
        .iter()
        .filter(|outcome| {
            let old = recorded.figures.get(outcome.operation.name).copied();
            Verdict::of(old, outcome.figures()).is_failure()
        })
        .count();
    println!();
    if recorded.compiler != env!("LUNA_COMPILER") {
        println!(
            "not judged: the figures are recorded for {}, and this is {}",
            recorded.compiler,
            env!("LUNA_COMPILER")
        );
        return Ok(true);
    }
    if failures > 0 {
        println!(
            "{failures} of {} operations changed. If that is meant: cargo run --release -p luna-instructions -- record",
            outcomes.len()
        );
    }
    println!("{} passed, {failures} failed", outcomes.len() - failures);
    Ok(failures == 0)
}

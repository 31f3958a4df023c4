//! Each model of `examples/models`: generated, run and recorded, and the recording is a trace of
//! the model. A changed model, or a recording with a communication too many, is rejected.

use crate::generate::{build, generate};
use crate::model_trace::traced;
use crate::package::{cargo, folder};
use crate::run::{example, path, text};
use luna_events::code;
use luna_logger::format::{Reader, Record, Writer};
use std::fs;
use std::path::Path;
use std::process::Output;

/// The package's `main.rs`. Without the variable it is as it was generated; with it, the run is on
/// the virtual clock and the same each time. It ends after so many milliseconds, if that is not 0,
/// and at the latest after 2000 polls at one instant.
const MAIN: &str = r#"
mod generated;

use std::env;
use std::process::ExitCode;
use std::time::Duration;

fn main() -> ExitCode {
    generated::run(|system| {
        let Ok(time) = env::var("VIRTUAL_MS") else {
            return Ok(());
        };
        system.virtual_clock().most_turns_at_an_instant(2000);
        let time = time.parse().map(Duration::from_millis).unwrap_or_default();
        if !time.is_zero() {
            let safety = system.safety();
            system.executor("limit").build()?.process("limit").spawn(async move {
                luna::after(time).await;
                safety.raise(luna::Error::other("the virtual time is over"));
                Ok(())
            })?;
        }
        Ok(())
    })
}
"#;

/// A model, and how its program runs.
struct Example {
    name: &'static str,
    /// Its run on the machine's clock: `--seconds`, and the exit code.
    real: (&'static str, i32),
    /// Its run on the virtual clock: the milliseconds, and what is printed at its end.
    on_virtual: (&'static str, &'static str),
    /// A change of the model that the program does not follow.
    change: (&'static str, &'static str),
}

const EXAMPLES: [Example; 7] = [
    Example {
        name: "philosophers",
        real: ("2", 1),
        on_virtual: ("0", "is deadlocked"),
        change: ("left!; right!;", "right!; left!;"),
    },
    Example {
        name: "philosophers-repaired",
        real: ("0.2", 0),
        on_virtual: ("0", "ended by a livelock"),
        change: ("left!; right!", "right!; left!"),
    },
    Example {
        name: "commstime",
        real: ("0.2", 0),
        on_virtual: ("0", "ended by a livelock"),
        change: ("par { on!x | out!x }", "on!x"),
    },
    Example {
        name: "sorting-pump",
        real: ("60", 0),
        on_virtual: ("0", "completed after"),
        change: ("};\nto!kept", "}"),
    },
    Example {
        name: "sieve",
        real: ("60", 0),
        on_virtual: ("0", "completed after"),
        change: ("prime!p;", ""),
    },
    Example {
        name: "jiwy",
        real: ("0.2", 0),
        on_virtual: ("50", "the virtual time is over"),
        change: ("watched!; position!", "position!; watched!"),
    },
    Example {
        name: "production-cell",
        real: ("0.2", 0),
        on_virtual: ("50", "the virtual time is over"),
        change: ("repair; repaired!", "repair"),
    },
];

/// A copy of a recording in which the first communication comes twice.
fn with_one_too_many(recording: &Path, copy: &Path) {
    let mut reader = Reader::new(fs::File::open(recording).unwrap()).unwrap();
    let mut writer = Writer::new(Vec::new()).unwrap();
    let mut is_done = false;
    while let Some(record) = reader.next().unwrap() {
        writer.put(&record).unwrap();
        if let Record::Event(event) = &record
            && event.code == code::COMMUNICATION
            && !std::mem::replace(&mut is_done, true)
        {
            writer.put(&record).unwrap();
        }
    }
    assert!(is_done, "no communication was recorded");
    fs::write(copy, writer.finish().unwrap()).unwrap();
}

/// Runs a program and records it; on the virtual clock if its milliseconds are given.
fn record(package: &Path, seconds: &str, virtual_ms: Option<&str>, recording: &Path) -> Output {
    let _ = fs::remove_file(recording);
    let mut run = cargo(package, "run");
    run.args(["--quiet", "--", "--seconds", seconds])
        .env("LUNA_LOG", recording)
        .env("LUNA_LOG_EVENTS", "65536");
    if let Some(time) = virtual_ms {
        run.env("VIRTUAL_MS", time);
    }
    run.output().expect("cargo starts")
}

fn runs_as_a_trace_of_its_model(name: &str) {
    let one = EXAMPLES.iter().find(|one| one.name == name);
    let one = one.expect("an example");
    let model = example(&format!("{name}.toml"));
    let package = folder(&format!("traced-{name}"));
    generate(&model, &package);
    fs::write(package.join("src/main.rs"), MAIN).unwrap();
    build(&package);

    // On a busy machine nothing may have happened in this time, or events may be lost: then
    // there is no verdict. A rejection would be wrong.
    let recording = package.join("real.luna");
    let (seconds, code) = one.real;
    let output = record(&package, seconds, None, &recording);
    let printed = text(&output.stdout);
    assert_eq!(output.status.code(), Some(code), "{name}: {printed}");
    let (code, said) = traced(path(&model), &recording, &[]);
    assert_ne!(code, Some(1), "{name}: {said}");

    let recording = package.join("virtual.luna");
    let (time, end) = one.on_virtual;
    let output = record(&package, "60", Some(time), &recording);
    let printed = format!("{}{}", text(&output.stdout), text(&output.stderr));
    assert!(printed.contains(end), "{name}: {printed}");
    let (code, said) = traced(path(&model), &recording, &["--ends"]);
    assert_eq!(code, Some(0), "{name}: {said}");

    let doubled = package.join("doubled.luna");
    with_one_too_many(&recording, &doubled);
    let (code, said) = traced(path(&model), &doubled, &[]);
    assert_eq!(code, Some(1), "{name}: {said}");

    let (from, to) = one.change;
    let text = fs::read_to_string(&model).unwrap();
    assert!(text.contains(from), "{name}");
    let changed = package.join("changed.toml");
    fs::write(&changed, text.replace(from, to)).unwrap();
    let (code, said) = traced(path(&changed), &recording, &[]);
    assert_eq!(code, Some(1), "{name}: {said}");
}

#[test]
fn philosophers_run_as_a_trace_of_their_model() {
    runs_as_a_trace_of_its_model("philosophers");
}

#[test]
fn repaired_philosophers_run_as_a_trace_of_their_model() {
    runs_as_a_trace_of_its_model("philosophers-repaired");
}

#[test]
fn commstime_runs_as_a_trace_of_its_model() {
    runs_as_a_trace_of_its_model("commstime");
}

#[test]
fn the_sorting_pump_runs_as_a_trace_of_its_model() {
    runs_as_a_trace_of_its_model("sorting-pump");
}

#[test]
fn the_sieve_runs_as_a_trace_of_its_model() {
    runs_as_a_trace_of_its_model("sieve");
}

#[test]
fn jiwy_runs_as_a_trace_of_its_model() {
    runs_as_a_trace_of_its_model("jiwy");
}

#[test]
fn the_production_cell_runs_as_a_trace_of_its_model() {
    runs_as_a_trace_of_its_model("production-cell");
}

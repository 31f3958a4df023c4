//! `luna convert`: what it makes is read by the formats' own readers.

mod containers;
mod csv;
mod damage;
mod events;
mod not_finite;
#[cfg(feature = "mcap")]
mod samples;

use crate::run::{luna, path, text};
use luna_logger::Level;
use luna_logger::format::{
    ClockBase, Event, Losing, Record, RunsOn, SignalInfo, Subject, Type, Values, Writer,
};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder that this test alone has, and a recording in it.
fn recording(test: &str) -> (PathBuf, PathBuf) {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("convert-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let file = folder.join("run.luna");
    fs::write(&file, bytes()).unwrap();
    (folder, file)
}

/// The clock's origin, the first sample's time, and the time of day at the origin.
const BASE: u64 = 50_000_000_000;
const UNIX: i64 = 1_700_000_000_000_000_000;

/// Two threads, three signals, one of them a vector; a sample out of order, two at one instant;
/// messages; losses.
fn bytes() -> Vec<u8> {
    let mut writer = Writer::new(Vec::new()).unwrap();
    let signal = |number, element_type, elements, name, unit| {
        Record::Signal(SignalInfo {
            number,
            element_type,
            elements,
            name,
            unit,
            description: "for the test",
        })
    };
    let force = |number: f64| number.to_le_bytes();
    let place = [1i16, -2].map(i16::to_le_bytes).concat();
    let sample = |signal, after: u64, of, bytes| Record::Sample {
        signal,
        time: BASE + after,
        values: Values::from_bytes(of, bytes),
    };
    let message = |after: u64, level, text| Record::Message {
        thread: 1,
        time: BASE + after,
        level,
        process: 7,
        truncated: false,
        target: "arm",
        text,
    };
    for record in [
        Record::Session {
            system: "test",
            clock: ClockBase::Monotonic,
            written_by: "a test",
        },
        Record::Epoch {
            time: BASE,
            unix: UNIX,
        },
        Record::Thread {
            number: 0,
            name: "control",
        },
        Record::Thread {
            number: 1,
            name: "console",
        },
        signal(0, Type::F64, 1, "arm/force", "N"),
        signal(1, Type::I16, 2, "arm/place", ""),
        signal(2, Type::Bool, 1, "arm/\"ok\", or so", ""),
        sample(0, 0, Type::F64, &force(0.1)),
        sample(0, 2_000_000, Type::F64, &force(-2.5e-7)),
        sample(1, 1_000_000, Type::I16, &place),
        sample(2, 1_000_000, Type::Bool, &[1]),
        message(1_500_000, Level::Warn, "too \"hot\", stop"),
        sample(0, 3_000_000, Type::F64, &force(f64::NAN)),
        sample(0, 3_000_000, Type::F64, &force(4.0)),
        message(4_000_000, Level::Info, "two\nlines"),
        Record::Losses {
            of: Losing::Signal(0),
            lost: 3,
        },
        Record::Losses {
            of: Losing::Signal(0),
            lost: 5,
        },
        Record::End {
            time: BASE + 4_000_000,
        },
    ] {
        writer.put(&record).unwrap();
    }
    writer.finish().unwrap()
}

/// Two processes on an executor, and a loop: a communication, and what is around it.
fn events() -> Vec<u8> {
    use luna_events::code;
    let mut writer = Writer::new(Vec::new()).unwrap();
    let name = |subject, number, parent, name| Record::Name {
        subject,
        number,
        parent,
        name,
        runs_on: (subject == Subject::Process).then_some(RunsOn {
            executor: 0,
            level: 16,
        }),
    };
    for record in [
        Record::Session {
            system: "test",
            clock: ClockBase::Monotonic,
            written_by: "a test",
        },
        Record::Epoch {
            time: BASE,
            unix: UNIX,
        },
        Record::Thread {
            number: 0,
            name: "thread of main",
        },
        name(Subject::Executor, 0, 0, "main"),
        name(Subject::Process, 7, 0, "source"),
        name(Subject::Process, 8, 0, "sink, or so"),
        name(Subject::Channel, 3, 0, "force"),
        name(Subject::Loop, 1, 7, "control"),
        name(Subject::SubProcess, 1, 7, "left"),
        name(Subject::SubProcess, 2, 7, "inner"),
        name(Subject::SubProcess, 3, 7, "left"),
    ] {
        writer.put(&record).unwrap();
    }
    for (number, text) in code::NAMES {
        let name = name(Subject::Code, number.into(), 0, text);
        writer.put(&name).unwrap();
    }
    for (after, code, subject, arguments) in [
        (0, code::ASLEEP, 0, [0, 0]),
        (10, code::AWAKE, 0, [0, 0]),
        (11, code::READY, 7, [0, 0]),
        (12, code::RUNNING, 8, [0, 0]),
        (20, code::WAITING, 8, [3, 3]),
        (21, code::RUNNING, 7, [0, 0]),
        (22, code::SUB_RUNNING, 1, [7, 0]),
        (22, code::SUB_RUNNING, 2, [7, 1]),
        (23, code::SUB_WAITING, 2, [3, 3]),
        (24, code::SUB_WAITING, 1, [0, 0]),
        (25, code::SLOT, 1, [41, 250]),
        (30, code::COMMUNICATION, 3, [7, 8]),
        (31, code::READY, 8, [7, 0]),
        (32, code::SUB_DONE, 2, [1, 0]),
        (33, code::SUB_DONE, 1, [0, 0]),
        (34, code::SUB_RUNNING, 3, [7, 0]),
        (35, code::SUB_DONE, 3, [0, 0]),
        (36, code::SUB_WAITING, 99, [0, 0]),
        (40, code::WAITING, 7, [255, 0]),
        (41, code::RUNNING, 8, [0, 0]),
        (50, code::DONE, 8, [1, 0]),
        (55, code::STOLEN, 1, [20, 40]),
        (60, 999, 5, [1, 2]),
    ] {
        let event = Record::Event(Event {
            thread: 0,
            time: BASE + after,
            code,
            subject,
            arguments,
        });
        writer.put(&event).unwrap();
    }
    let losses = Record::Losses {
        of: Losing::Events(0),
        lost: 4,
    };
    writer.put(&losses).unwrap();
    writer.finish().unwrap()
}

fn recording_of_events(test: &str) -> (PathBuf, PathBuf) {
    let (folder, file) = recording(test);
    fs::write(&file, events()).unwrap();
    (folder, file)
}

/// What the schema finds in a trace, if there is one.
pub(crate) fn read_trace(trace: &Path) -> Option<String> {
    read_by_python("read_trace.py", trace)
}

/// The samples in an MCAP file, as Python's packages `mcap` and `mcap-protobuf-support` read it.
#[cfg(feature = "mcap")]
fn read_mcap(file: &Path) -> Option<String> {
    read_by_python("read_mcap.py", file)
}

/// What one of these scripts prints of a file. `.ci/run` makes a Python that has their packages.
fn read_by_python(script: &str, file: &Path) -> Option<String> {
    let Some(python) = std::env::var_os("LUNA_PERFETTO_PYTHON") else {
        eprintln!(
            "skipped: {script}: set LUNA_PERFETTO_PYTHON to a Python with the packages `perfetto`, `mcap` and `mcap-protobuf-support`"
        );
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests")
        .join(script);
    let read = Command::new(python)
        .args([path(&script), path(file)])
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", text(&read.stderr));
    Some(text(&read.stdout).to_owned())
}

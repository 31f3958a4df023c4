//! `luna convert` of several recordings: one trace, with flows between the programs.

use crate::convert::read_trace;
use crate::run::{luna, text};
use crate::trace;
use luna_events::code;
use luna_logger::format::{ClockBase, Event, Record, Subject, Writer};
use std::path::{Path, PathBuf};
use std::process::Output;

/// A time on the clock of both programs, and what the day's clock says then.
const BASE: u64 = 50_000_000_000;
const UNIX: i64 = 1_700_000_000_000_000_000;

/// Names the session of the two.
const SESSION: u64 = 0x1234_5678_9abc_def0;

/// A recording of a program whose link gives or takes these values, so many ns after `BASE`, by a
/// clock that began later than the other's by `behind`.
fn recording(file: &Path, system: &str, is_taken: bool, values: &[(u64, u64)], behind: u64) {
    let mut writer = Writer::new(Vec::new()).unwrap();
    let names = code::NAMES.map(|(number, name)| (Subject::Code, number.into(), name));
    let process = (
        Subject::Process,
        5,
        if is_taken { "link in" } else { "link out" },
    );
    let session = Record::Session {
        system,
        clock: ClockBase::Monotonic,
        written_by: "a test",
    };
    let epoch = Record::Epoch {
        time: BASE - behind,
        unix: UNIX,
    };
    let thread = Record::Thread {
        number: 0,
        name: "main",
    };
    for record in [session, epoch, thread] {
        writer.put(&record).unwrap();
    }
    for (subject, number, name) in names.into_iter().chain([process]) {
        let name = Record::Name {
            subject,
            number,
            parent: 0,
            name,
            runs_on: None,
        };
        writer.put(&name).unwrap();
    }
    for (number, after) in values {
        let event = Record::Event(Event {
            thread: 0,
            time: BASE - behind + after,
            code: code::LINK,
            subject: 5,
            arguments: [*number, code::link::argument(SESSION, is_taken)],
        });
        writer.put(&event).unwrap();
    }
    std::fs::write(file, writer.finish().unwrap()).unwrap();
}

/// Two recordings: values 1 to 3 go from the feeder to the belt. The belt's clock began so much
/// later.
fn two(test: &str, behind: u64) -> (PathBuf, [String; 2]) {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("merge-{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let [feeder, belt] = ["feeder", "belt"].map(|name| folder.join(format!("{name}.luna")));
    recording(&feeder, "feeder", false, &[(1, 100), (2, 200), (3, 300)], 0);
    recording(&belt, "belt", true, &[(1, 110), (2, 220), (3, 330)], behind);
    let files = [feeder, belt].map(|path| path.to_str().unwrap().to_owned());
    (folder.join("both.perfetto-trace"), files)
}

/// The times of the flows, after `BASE`.
fn flows(trace: &Path) -> Vec<[u64; 2]> {
    let trace = trace::read(trace);
    let flows = trace
        .flows_between_processes()
        .into_iter()
        .map(|[from, to]| {
            assert_eq!((&*from.0, &*to.0), ("feeder", "belt"));
            [from.1, to.1].map(|time| time - BASE)
        });
    flows.collect()
}

fn convert(trace: &Path, files: &[&str], more: &[&str]) -> Output {
    let to = ["--to", "perfetto", "-o", trace.to_str().unwrap()];
    luna(&[&["convert"], files, &to, more].concat())
}

const IN_STEP: [[u64; 2]; 3] = [[100, 110], [200, 220], [300, 330]];

#[test]
fn a_value_flows_from_one_program_to_the_other_in_either_order_of_recordings() {
    let (trace, [feeder, belt]) = two("flows", 0);
    for files in [[&*feeder, &*belt], [&*belt, &*feeder]] {
        let output = convert(&trace, &files, &[]);
        let error = text(&output.stderr);
        assert_eq!((output.status.code(), error), (Some(0), ""));
        let said = text(&output.stdout);
        assert!(
            said.contains("2 recordings") && said.contains("3 events"),
            "{said}"
        );
        assert_eq!(flows(&trace), IN_STEP);
        if let Some(read) = read_trace(&trace) {
            for line in [
                "process 1 feeder\n",
                "process 2 belt\n",
                "flow link out give value 3 -> link in take value 3\n",
            ] {
                let line = match files[0] == feeder {
                    true => line.to_owned(),
                    false => line
                        .replace("1 feeder", "2 feeder")
                        .replace("2 belt", "1 belt"),
                };
                assert!(read.contains(&line), "{line}: {read}");
            }
        }
    }
    // Of one alone there is none.
    assert_eq!(convert(&trace, &[&feeder], &[]).status.code(), Some(0));
    assert_eq!(flows(&trace), [[0; 2]; 0]);
}

#[test]
fn recordings_of_two_computers_are_put_together_by_the_time_of_the_day_or_by_hand() {
    let (trace, files) = two("clocks", 7_000_000_000);
    let files = [&*files[0], &*files[1]];
    let output = convert(&trace, &files, &[]);
    let error = text(&output.stderr);
    assert!(
        error.contains("belt.luna") && error.contains("--clock wall"),
        "{error}"
    );
    for more in [
        &["--clock", "wall"][..],
        &["--offset", "7"],
        &["--clock", "wall", "--offset", "0"],
    ] {
        let output = convert(&trace, &files, more);
        assert_eq!(text(&output.stderr), "", "{more:?}");
        assert_eq!(flows(&trace), IN_STEP, "{more:?}");
    }
    let output = convert(
        &trace,
        &files,
        &["--clock", "wall", "--offset", "0.00000001"],
    );
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(flows(&trace)[0], [100, 120]);
    // What is chosen by time counts from one instant.
    let chosen = ["--clock", "wall", "--until", "0.000000250"];
    convert(&trace, &files, &chosen);
    assert_eq!(flows(&trace), IN_STEP[..2]);
}

#[test]
fn what_is_chosen_is_in_one_of_the_recordings() {
    let (trace, files) = two("chosen", 0);
    let files = [&*files[0], &*files[1]];
    let output = convert(&trace, &files, &["--process", "link in"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert_eq!(flows(&trace), [[0; 2]; 0], "the other end was left out");
    let output = convert(&trace, &files, &["--process", "robot"]);
    assert_eq!(output.status.code(), Some(2));
    let error = text(&output.stderr);
    assert!(error.contains("link in, link out"), "{error}");
}

#[test]
fn what_cannot_be_is_refused_and_nothing_is_written() {
    let (trace, [feeder, belt]) = two("refused", 0);
    let output = luna(&["convert", &feeder, &belt, "--to", "csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--to perfetto"));
    let output = convert(&trace, &[&feeder, &belt], &["--offset", "1,2"]);
    assert_eq!(output.status.code(), Some(2));
    let output = convert(&trace, &[&feeder, &belt], &["--offset", "soon"]);
    assert_eq!(output.status.code(), Some(2));
    // The second one would be erased before it is read.
    let output = convert(Path::new(&belt), &[&feeder, &belt], &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(std::fs::metadata(&belt).unwrap().len() > 100 && !trace.exists());
}

//! `luna convert`: what it makes is read by the formats' own readers.

use luna_logger::Level;
use luna_logger::format::{
    ClockBase, Event, Losing, Record, RunsOn, SignalInfo, Subject, Type, Values, Writer,
};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn luna(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_luna"))
        .args(arguments)
        .output()
        .expect("the program starts")
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("output is text")
}

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
    use luna_core::events::code;
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

#[test]
fn events_are_rows_in_words() {
    let (folder, file) = recording_of_events("events-csv");
    let output = luna(&["convert", path(&file), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(said.contains("0 messages, 23 events"), "{said}");
    assert!(said.contains("4 events were lost"), "{said}");
    let rows = fs::read_to_string(folder.join("run.events.csv")).unwrap();
    let expected = "time,event,thread,subject,first,second\n\
                    0.000000000,executor asleep,thread of main,main,,\n\
                    0.000000010,executor awake,thread of main,main,,\n\
                    0.000000011,ready,thread of main,source,,\n\
                    0.000000012,running,thread of main,\"sink, or so\",,\n\
                    0.000000020,waiting,thread of main,\"sink, or so\",force,\n\
                    0.000000021,running,thread of main,source,,\n\
                    0.000000022,sub-process running,thread of main,left,source,\n\
                    0.000000022,sub-process running,thread of main,inner,source,left\n\
                    0.000000023,sub-process waiting,thread of main,inner,force,\n\
                    0.000000024,sub-process waiting,thread of main,left,,\n\
                    0.000000025,slot,thread of main,control,41,250\n\
                    0.000000030,communication,thread of main,force,source,\"sink, or so\"\n\
                    0.000000031,ready,thread of main,\"sink, or so\",source,\n\
                    0.000000032,sub-process done,thread of main,inner,dropped,\n\
                    0.000000033,sub-process done,thread of main,left,returned,\n\
                    0.000000034,sub-process running,thread of main,left,source,\n\
                    0.000000035,sub-process done,thread of main,left,returned,\n\
                    0.000000036,sub-process waiting,thread of main,sub-process 99,,\n\
                    0.000000040,waiting,thread of main,source,still ready,\n\
                    0.000000041,running,thread of main,\"sink, or so\",,\n\
                    0.000000050,done,thread of main,\"sink, or so\",error,\n\
                    0.000000055,stolen,thread of main,core 1,20,40\n\
                    0.000000060,event 999,thread of main,5,1,2\n";
    assert_eq!(rows, expected);
}

#[cfg(feature = "mcap")]
#[test]
fn events_are_a_topic() {
    let (folder, file) = recording_of_events("events-mcap");
    let output = luna(&["convert", path(&file), "--to", "mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    let mut events = Vec::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.topic == "/luna/events" {
            let content: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            let schema = message.channel.schema.clone().unwrap();
            let described: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
            let fields = content.as_object().unwrap().keys();
            assert!(fields.clone().count() == 8);
            for name in fields {
                assert!(described["properties"].get(name).is_some(), "{name}");
            }
            events.push((message.log_time - UNIX as u64, content));
        }
    }
    assert_eq!(events.len(), 23);
    let (after, communication) = &events[11];
    assert_eq!(*after, 30);
    assert_eq!(communication["event"], "communication");
    assert_eq!(communication["subject"], "force");
    assert_eq!(communication["first"], "source");
    assert_eq!(communication["second"], "sink, or so");
    assert_eq!(communication["arguments"], serde_json::json!([7, 8]));
    assert_eq!(communication["thread"], "thread of main");
}

#[test]
fn events_are_tracks_by_the_schema_of_perfetto() {
    let (folder, file) = recording_of_events("events-perfetto");
    let output = luna(&["convert", path(&file), "--to", "perfetto"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let trace = folder.join("run.perfetto-trace");
    assert!(fs::metadata(&trace).unwrap().len() > 200);
    let Some(reported) = read_trace(&trace) else {
        return;
    };
    let expected = "process 1 test\n\
                    wall 1700000000000000000\n\
                    thread thread of main\n\
                    track executor main\n\
                    track source\n\
                    track sink, or so\n\
                    track left\n\
                    track inner\n\
                    slice left 22-24 running\n\
                    slice inner 22-23 running\n\
                    slice inner 23-32 waiting for force\n\
                    slice left 24-33 waiting\n\
                    slice left 34-35 running\n\
                    slice executor main 0-10 asleep\n\
                    slice executor main 12-20 sink, or so\n\
                    slice sink, or so 12-20 running\n\
                    slice source 11-21 ready\n\
                    slice sink, or so 20-31 waiting for force\n\
                    slice source 21-40 running\n\
                    slice executor main 21-40 source\n\
                    slice sink, or so 31-41 ready\n\
                    slice sink, or so 41-50 running\n\
                    slice executor main 41-50 sink, or so\n\
                    flow source send force -> sink, or so receive force\n\
                    instant source  25 slot control (first=41, second=250)\n\
                    instant source  30 send force ()\n\
                    instant sink, or so  30 receive force ()\n\
                    instant sink, or so  50 done: error ()\n\
                    instant thread of main  55 stolen core 1 (first=20, second=40)\n\
                    instant thread of main  60 event 999 5 (first=1, second=2)\n";
    let sorted = |text: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    assert_eq!(sorted(&reported), sorted(expected));
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn csv_has_a_row_for_each_instant() {
    let (folder, file) = recording("csv");
    let output = luna(&["convert", path(&file), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    assert!(
        said.contains("6 samples of 3 signals, 2 messages"),
        "{said}"
    );
    assert!(said.contains("5 samples and messages were lost"), "{said}");
    let head = "time [s],arm/force [N],arm/place[0],arm/place[1],\"arm/\"\"ok\"\", or so\"\n";
    let rows = "0.000000000,0.1,,,\n\
                0.001000000,,1,-2,1\n\
                0.002000000,-0.00000025,,,\n\
                0.003000000,NaN,,,\n\
                0.003000000,4,,,\n";
    assert_eq!(
        fs::read_to_string(folder.join("run.csv")).unwrap(),
        format!("{head}{rows}")
    );
    let messages = fs::read_to_string(folder.join("run.messages.csv")).unwrap();
    let expected = "time,level,thread,process,target,text\n\
                    0.001500000,WARN,console,process 7,arm,\"too \"\"hot\"\", stop\"\n\
                    0.004000000,INFO,console,process 7,arm,\"two\nlines\"\n";
    assert_eq!(messages, expected);

    let held = folder.join("held.csv");
    let output = luna(&[
        "convert",
        path(&file),
        "--to",
        "csv",
        "--hold",
        "-o",
        path(&held),
    ]);
    assert_eq!(output.status.code(), Some(0));
    let rows = "0.000000000,0.1,,,\n\
                0.001000000,0.1,1,-2,1\n\
                0.002000000,-0.00000025,1,-2,1\n\
                0.003000000,4,1,-2,1\n";
    assert_eq!(fs::read_to_string(held).unwrap(), format!("{head}{rows}"));
}

/// Converts a recording of events, and a signal of 1 kHz beside them: what is on standard output,
/// and the table.
fn selected(test: &str, options: &[&str]) -> (String, PathBuf) {
    let (folder, file) = recording_of_events(test);
    let base = ["convert", path(&file), "--to", "csv"];
    let output = luna(&[&base, options].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    (text(&output.stdout).to_owned(), folder)
}

#[test]
fn what_is_not_selected_is_left_out() {
    for (options, count) in [
        (&[][..], 23),
        (&["--events", "none"], 0),
        (&["--events", "running,sub*done"], 6),
        (&["--process", "source"], 13),
        (&["--process", "s*"], 18),
        (&["--from", "0.00000002", "--until", "3e-8"], 7),
        (
            &["--events", "slot", "--process", "source", "--from", "0"],
            1,
        ),
    ] {
        let (said, folder) = selected("selected", options);
        let events = match count {
            0 => String::new(),
            1 => ", 1 event".to_owned(),
            count => format!(", {count} events"),
        };
        let head = format!("0 samples of 0 signals, 0 messages{events}\n");
        assert!(said.contains(&head), "{options:?}: {said}");
        let rows = fs::read_to_string(folder.join("run.events.csv"));
        assert_eq!(rows.map_or(1, |rows| rows.lines().count()), count + 1);
    }
    let (folder, file) = recording("selected-signals");
    let base = ["convert", path(&file), "--to", "csv"];
    let only = [
        "--signals",
        "arm/f*",
        "--until",
        "0.003",
        "--process",
        "none",
    ];
    let output = luna(&[&base[..], &only].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let rows = "time [s],arm/force [N]\n0.000000000,0.1\n0.002000000,-0.00000025\n";
    assert_eq!(fs::read_to_string(folder.join("run.csv")).unwrap(), rows);
    assert!(!folder.join("run.messages.csv").exists());
    for (option, name, there) in [
        (
            "--signals",
            "arm/x*",
            "there are arm/\"ok\", or so, arm/force, arm/place",
        ),
        ("--process", "gone", "none at all"),
        ("--per-cycle", "control", "no loop `control`"),
    ] {
        let output = luna(&[&base[..], &[option, name]].concat());
        assert_eq!(output.status.code(), Some(2));
        assert!(
            text(&output.stderr).contains(there),
            "{}",
            text(&output.stderr)
        );
    }
}

/// Two signals of one loop, sampled at instants of their own, and one that is slower.
#[test]
fn a_row_is_a_cycle_on_request() {
    use luna_core::events::code;
    let (folder, file) = recording("per-cycle");
    let mut writer = Writer::new(Vec::new()).unwrap();
    for (number, name) in [(0, "error"), (1, "output"), (2, "slow")] {
        let info = SignalInfo {
            number,
            element_type: Type::F64,
            elements: 1,
            name,
            unit: "",
            description: "",
        };
        writer.put(&Record::Signal(info)).unwrap();
    }
    let a_loop = |number, name| Record::Name {
        subject: Subject::Loop,
        number,
        parent: 7,
        name,
        runs_on: None,
    };
    writer.put(&a_loop(1, "control")).unwrap();
    writer.put(&a_loop(2, "control too")).unwrap();
    let sample = |signal, time, value: f64| (time, signal, value.to_le_bytes());
    for (time, signal, bytes) in [
        sample(0, 5, 9.0),
        sample(0, 1010, 1.0),
        sample(1, 1020, 2.0),
        sample(2, 1030, 3.0),
        sample(1, 1040, 2.5),
        sample(0, 2010, 4.0),
        sample(1, 2020, 5.0),
    ] {
        let values = Values::from_bytes(Type::F64, &bytes);
        writer
            .put(&Record::Sample {
                signal,
                time,
                values,
            })
            .unwrap();
    }
    // Threads are merged round by round: these come late.
    for (time, subject) in [(1000, 1), (1035, 2), (2000, 1), (3000, 1)] {
        let event = Event {
            thread: 0,
            time,
            code: code::SLOT,
            subject,
            arguments: [0, 0],
        };
        writer.put(&Record::Event(event)).unwrap();
    }
    fs::write(&file, writer.finish().unwrap()).unwrap();
    let table = |more: &[&str]| {
        let base = [
            "convert",
            path(&file),
            "--to",
            "csv",
            "--per-cycle",
            "control",
        ];
        let output = luna(&[&base, more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        fs::read_to_string(folder.join("run.csv")).unwrap()
    };
    let rows = "time [s],error,output,slow\n\
                0.000000995,1,2.5,3\n\
                0.000001995,4,5,\n\
                0.000002995,,,\n";
    assert_eq!(table(&[]), rows);
    assert_eq!(
        fs::read_to_string(folder.join("run.events.csv"))
            .unwrap()
            .lines()
            .count(),
        5
    );
    // Cycles are rows also where their events are left out.
    let held = rows.replace("5,\n", "5,3\n").replace(",,,\n", ",4,5,3\n");
    fs::remove_file(folder.join("run.events.csv")).unwrap();
    assert_eq!(table(&["--hold", "--events", "none"]), held);
    assert!(!folder.join("run.events.csv").exists());
}

#[cfg(feature = "mcap")]
#[test]
fn mcap_is_read_by_the_readers_of_its_format() {
    let (folder, file) = recording("mcap");
    let output = luna(&["convert", path(&file), "--to", "mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let bytes = fs::read(folder.join("run.mcap")).unwrap();
    // With the checksums of all sections.
    let messages: Vec<_> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .map(|message| {
            let content: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            assert_eq!(message.channel.message_encoding, "json");
            let schema = message.channel.schema.clone().unwrap();
            assert_eq!(schema.encoding, "jsonschema");
            let described: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
            assert_eq!(described["type"], "object");
            for name in content.as_object().unwrap().keys() {
                assert!(
                    described["properties"].get(name).is_some(),
                    "{name} in {described}"
                );
            }
            let after = message.log_time - UNIX as u64;
            (message.channel.topic.clone(), after, content)
        })
        .collect();
    let of = |topic: &str| -> Vec<_> {
        let all = messages.iter().filter(|message| message.0 == topic);
        all.map(|(_, after, content)| (*after, content["value"].to_string()))
            .collect()
    };
    let expected = [
        (0, "0.1"),
        (2_000_000, "-2.5e-7"),
        (3_000_000, "null"),
        (3_000_000, "4.0"),
    ];
    assert_eq!(
        of("/arm/force"),
        expected.map(|(after, value)| (after, value.to_owned()))
    );
    assert_eq!(of("/arm/place"), [(1_000_000, "[1,-2]".to_owned())]);
    assert_eq!(of("/arm/\"ok\", or so"), [(1_000_000, "true".to_owned())]);
    let log: Vec<_> = messages
        .iter()
        .filter(|message| message.0 == "/luna/log")
        .collect();
    assert_eq!(log.len(), 2);
    assert_eq!(log[0].2["message"], "too \"hot\", stop");
    assert_eq!(
        (&log[0].2["level"], &log[0].2["name"]),
        (&3.into(), &"console: arm".into())
    );
    assert_eq!(log[0].2["timestamp"]["nsec"], 1_500_000);
    let lost = messages
        .iter()
        .rfind(|message| message.0 == "/luna/losses")
        .unwrap();
    assert_eq!(
        (&lost.2["of"], &lost.2["lost"]),
        (&"/arm/force".into(), &5.into())
    );
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert!(
        summary
            .chunk_indexes
            .iter()
            .all(|chunk| chunk.compression == "lz4")
    );
    assert_eq!(summary.stats.unwrap().message_count, 10);
    let unit = summary
        .channels
        .values()
        .find(|channel| channel.topic == "/arm/force")
        .unwrap();
    assert_eq!(unit.metadata["unit"], "N");
}

/// The Python package `perfetto` brings the trace's own schema. `.ci/run` installs it and names a
/// Python that has it.
#[test]
fn perfetto_traces_are_read_by_their_own_schema() {
    let (folder, file) = recording("perfetto");
    let output = luna(&["convert", path(&file), "--to", "perfetto"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let trace = folder.join("run.perfetto-trace");
    assert!(fs::metadata(&trace).unwrap().len() > 200);
    let Some(reported) = read_trace(&trace) else {
        return;
    };
    let expected = "process 1 test\n\
                    wall 1700000000000000000\n\
                    thread control\n\
                    thread console\n\
                    counter arm/force [N]: 0=0.1 2000000=-2.5e-07 3000000=nan 3000000=4.0\n\
                    counter arm/place[0] []: 1000000=1\n\
                    counter arm/place[1] []: 1000000=-2\n\
                    counter arm/\"ok\", or so []: 1000000=1\n\
                    instant console WARN 1500000 too \"hot\", stop (target=arm)\n\
                    instant console INFO 4000000 two lines (target=arm)\n";
    assert_eq!(reported, expected);
}

/// What the schema finds in a trace, if there is one.
pub(crate) fn read_trace(trace: &Path) -> Option<String> {
    let Some(python) = std::env::var_os("LUNA_PERFETTO_PYTHON") else {
        eprintln!(
            "skipped: the trace's schema: set LUNA_PERFETTO_PYTHON to a Python with the package `perfetto`"
        );
        return None;
    };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/read_trace.py");
    let read = Command::new(python)
        .args([script, path(trace)])
        .output()
        .unwrap();
    assert!(read.status.success(), "{}", text(&read.stderr));
    Some(text(&read.stdout).to_owned())
}

#[test]
fn a_truncated_recording_is_converted_as_far_as_it_goes() {
    let (folder, file) = recording("truncated");
    let mut whole = bytes();
    let length = whole.len();
    // A second block with a missing end.
    let second = whole[16..].to_vec();
    whole.extend_from_slice(&second[..second.len() - 9]);
    fs::write(&file, &whole).unwrap();
    for to in ["csv", "perfetto"] {
        let output = luna(&["convert", path(&file), "--to", to]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        assert!(text(&output.stdout).contains("6 samples"));
        let said = text(&output.stderr);
        assert!(said.contains(&format!("(at byte {length})")), "{said}");
    }
    // Damaged is another thing.
    whole[length + 20] ^= 1;
    whole.extend_from_slice(&[0; 9]);
    fs::write(&file, &whole).unwrap();
    let output = luna(&["convert", path(&file), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("damaged"),
        "{}",
        text(&output.stderr)
    );
    assert!(folder.join("run.csv").exists());
}

#[test]
fn what_lies_behind_damage_is_converted() {
    let (folder, file) = recording("damaged");
    let mut whole = bytes();
    let block = whole[16..].to_vec();
    let mut damaged = block.clone();
    damaged[40] ^= 1;
    whole.extend_from_slice(&damaged);
    whole.extend_from_slice(&block);
    fs::write(&file, &whole).unwrap();
    for to in ["csv", "perfetto"] {
        let output = luna(&["convert", path(&file), "--to", to]);
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output.stdout).contains("12 samples of 3 signals, 4 messages"));
        let said = text(&output.stderr);
        let skipped = format!("bytes skipped {}", block.len());
        assert!(
            said.contains("checksum is wrong") && said.contains(&skipped),
            "{said}"
        );
    }
    let csv = fs::read_to_string(folder.join("run.csv")).unwrap();
    assert!(csv.lines().count() > 6, "{csv}");
}

#[test]
fn what_is_no_recording_is_refused_and_nothing_is_written() {
    let (folder, file) = recording("refused");
    let other = folder.join("other.luna");
    fs::write(&other, "time,value\n0,1\n").unwrap();
    let output = luna(&["convert", path(&other), "--to", "csv"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("no recording of LUNA"),
        "{}",
        text(&output.stderr)
    );
    assert!(!folder.join("other.csv").exists());
    let output = luna(&["convert", "/no/such/file", "--to", "csv"]);
    assert_eq!(output.status.code(), Some(2));
    let before = fs::read(&file).unwrap();
    let output = luna(&["convert", path(&file), "--to", "csv", "-o", path(&file)]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read(&file).unwrap(), before);
    assert_eq!(
        luna(&["convert", path(&file)]).status.code(),
        Some(2),
        "--to is missing"
    );
    assert_eq!(
        luna(&["convert", path(&file), "--to", "png"]).status.code(),
        Some(2)
    );
}

//! `luna model schedule`: bounds, verdicts, and what a recording adds.

use luna_core::events::code;
use luna_logger::format::{ClockBase, Event, Record, Subject, Writer};
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};

const MODEL: &str = r#"
name = "arm"

[process.Works]
body = "loop { work }"

[system.part.servo]
process = "Works"
on = "fast"
period = "1 ms"
priority = 20
cost = "120 us"
longest_poll = "40 us"

[system.part.logger]
process = "Works"
on = "fast"
period = "10 ms"
priority = 5
cost = "2 ms"
longest_poll = "300 us"

[executor.fast]
core = 2
policy = "fifo:80"

[schedule]
latency = "20 us"
"#;

/// Runs the command on `model`, with these options.
fn schedule(name: &str, model: &str, options: &[&str]) -> Output {
    let path = file(&format!("{name}.toml"));
    fs::write(&path, model).unwrap();
    Command::new(env!("CARGO_BIN_EXE_luna"))
        .args(["model", "schedule"])
        .arg(&path)
        .args(options)
        .output()
        .expect("the program starts")
}

/// A file that this test alone has.
fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("schedule-{name}"))
}

fn out(output: &Output) -> &str {
    std::str::from_utf8(&output.stdout).expect("output is text")
}

fn err(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).expect("output is text")
}

/// What it has printed, without the ends of lines.
fn flat(output: &Output) -> String {
    let words: Vec<&str> = out(output).split_whitespace().collect();
    words.join(" ")
}

/// The words of the part's row.
fn row<'a>(said: &'a str, part: &str) -> Vec<&'a str> {
    let mut rows = said
        .lines()
        .map(|line| line.split_whitespace().collect::<Vec<_>>());
    rows.find(|words| words.first() == Some(&part))
        .unwrap_or_else(|| panic!("{part} in {said}"))
}

#[test]
fn bounds_within_the_deadlines_exit_with_0() {
    let output = schedule("holds", MODEL, &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(0), "{said}{}", err(&output));
    // A poll of the logger, its own cost, and the latency.
    assert_eq!(
        row(said, "servo"),
        [
            "servo", "fast", "2", "fifo:80", "20", "1000.0", "120.0", "40.0", "440.0", "-",
            "1000.0", "560.0", "holds"
        ]
    );
    // Its own cost, three of the servo, and the latency.
    assert_eq!(row(said, "logger")[8], "2380.0");
    assert!(
        said.contains("core 2: 32.0 % for real-time parts\n"),
        "{said}"
    );
}

#[test]
fn a_bound_beyond_its_deadline_exits_with_1_and_says_what_to_change() {
    let model = MODEL.replacen("priority = 20", "priority = 20\ndeadline = \"400 us\"", 1);
    let output = schedule("exceeds", &model, &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(row(said, "servo")[11..], ["-40.0", "exceeds"]);
    let said = flat(&output);
    assert!(
        said.contains("to at most 260µs (`logger` has one of 300µs)"),
        "{said}"
    );
}

#[test]
fn without_a_policy_or_with_too_much_to_do_there_is_no_bound() {
    for (from, to, why) in [
        (
            "policy = \"fifo:80\"",
            "",
            "write `policy = \"fifo:80\"` in its table",
        ),
        (
            "cost = \"2 ms\"",
            "cost = \"9 ms\"",
            "ask for 102.0 % of the core",
        ),
    ] {
        let output = schedule("none", &MODEL.replacen(from, to, 1), &[]);
        let said = flat(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains("unbounded") && said.contains(why), "{said}");
    }
}

#[test]
fn what_is_not_known_exits_with_4_and_a_file_of_costs_adds_it() {
    let model = MODEL.replacen("cost = \"120 us\"\nlongest_poll = \"40 us\"\n", "", 1);
    let output = schedule("open", &model, &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert_eq!(row(said, "servo").last(), Some(&"unknown"));
    assert!(said.contains("servo: its cost is not known"), "{said}");
    assert!(said.contains("logger: `servo` runs before it"), "{said}");

    let costs = file("costs.toml");
    let path = costs.to_str().expect("a path of this test");
    fs::write(
        &costs,
        "servo = { cost = \"120 us\", longest_poll = \"40 us\" }\n",
    )
    .unwrap();
    let output = schedule("open", &model, &["--costs", path]);
    assert_eq!(output.status.code(), Some(0), "{}", out(&output));
    assert_eq!(row(out(&output), "servo")[8], "440.0");

    fs::write(&costs, "servi = { cost = \"120 us\" }\n").unwrap();
    let output = schedule("open", &model, &["--costs", path]);
    assert_eq!(output.status.code(), Some(2));
    let said = err(&output);
    assert!(
        said.contains(":1:1: the model has no process of this name: `servi`"),
        "{said}"
    );
}

#[test]
fn a_part_without_an_executor_is_not_counted_and_one_without_a_period_named() {
    let extra = "[system.part.stray]\nprocess = \"Works\"\n[system.part.event]\nprocess = \"Works\"\n\
                 on = \"fast\"\npriority = 9\ncost = \"5 us\"\n";
    let output = schedule("stray", &format!("{MODEL}\n{extra}"), &[]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert!(
        said.contains("not counted, since they name no executor: stray"),
        "{said}"
    );
    assert!(said.contains("logger: `event` runs before it"), "{said}");
    // Its poll is known, which is all that the servo needs.
    assert_eq!(row(said, "servo").last(), Some(&"holds"), "{said}");
    assert!(said.contains("and what is not known"), "{said}");
}

#[test]
fn a_part_that_may_wait_for_another_is_named() {
    let model = MODEL
        .replacen("body = \"loop { work }\"", "ports = { out = \"send\" }\nbody = \"loop { out! }\"\n[process.Takes]\nports = { input = \"receive\" }\nbody = \"loop { input? }\"", 1)
        .replace("process = \"Works\"", "process = \"Works\"\nbind = { out = \"c\" }");
    let extra = "[system.channel]\nc = {}\n[system.part.sink]\nprocess = \"Takes\"\nbind = { input = \"c\" }\non = \"other\"\n[executor.other]\n";
    let output = schedule("waits", &format!("{model}\n{extra}"), &[]);
    let said = flat(&output);
    assert_eq!(output.status.code(), Some(0), "{said}{}", err(&output));
    assert!(said.contains("is in no bound: servo, logger"), "{said}");
}

#[test]
fn json_has_the_same() {
    let output = schedule("json", MODEL, &["--json"]);
    let said: serde_json::Value = serde_json::from_str(out(&output)).expect("it is JSON");
    assert_eq!(said["latency_ns"], 20_000);
    let servo = &said["parts"][0];
    assert_eq!(servo["name"], "servo");
    assert_eq!(servo["bound_ns"], 440_000);
    assert_eq!(servo["slack_ns"], 560_000);
    assert_eq!(servo["verdict"], "holds");
    let utilization = said["cores"][0]["utilization"].as_f64();
    assert!(
        utilization.is_some_and(|share| (share - 0.32).abs() < 1e-9),
        "{said}"
    );
}

/// A recording of turns: process 1 is `servo`, with the loop 5; process 2 is `event`.
struct Recording(Writer<Vec<u8>>);

impl Recording {
    fn new(clock: ClockBase) -> Self {
        let mut it = Self(Writer::new(Vec::new()).unwrap());
        it.put(&Record::Session {
            system: "arm",
            clock,
            written_by: "test",
        });
        for (subject, number, parent, name) in [
            (Subject::Process, 1, 0, "servo"),
            (Subject::Process, 2, 0, "event"),
            (Subject::Loop, 5, 1, "servo"),
        ] {
            it.put(&Record::Name {
                subject,
                number,
                parent,
                name,
                runs_on: None,
            });
        }
        it
    }

    fn put(&mut self, record: &Record<'_>) {
        self.0.put(record).unwrap();
    }

    /// At so many µs.
    fn event(&mut self, time: u64, code: u16, subject: u32, arguments: [u64; 2]) {
        self.put(&Record::Event(Event {
            thread: 0,
            time: time * 1000,
            code,
            subject,
            arguments,
        }));
    }

    /// A turn of the servo from there, its cycle's slot a µs before if it begins one, and what it
    /// waits for at its end.
    fn servo(&mut self, from: u64, to: u64, begins: bool, waits: [u64; 2]) {
        self.event(from, code::READY, 1, [0, 0]);
        self.event(from, code::RUNNING, 1, [0, 0]);
        if begins {
            self.event(from, code::SLOT, 5, [0, 1000]);
        }
        self.event(to, code::WAITING, 1, waits);
    }

    fn write(self, name: &str) -> String {
        let path = file(name);
        fs::write(&path, self.0.finish().unwrap()).unwrap();
        path.to_str().expect("a path of this test").to_owned()
    }
}

const FOR_SLOT: [u64; 2] = [Subject::Loop as u64, 5];
const YIELDS: [u64; 2] = [code::STILL_READY, 0];

#[test]
fn a_recording_has_costs_responses_and_wakes() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    // What it does before its first cycle is none.
    recording.servo(100, 900, false, FOR_SLOT);
    for cycle in 1..20 {
        let slot = cycle * 1000;
        recording.servo(slot + 1, slot + 31, true, YIELDS);
        recording.servo(slot + 41, slot + 51, false, FOR_SLOT);
        // Twice a millisecond, for 7 µs.
        for from in [slot + 100, slot + 600] {
            recording.event(from, code::READY, 2, [1, 0]);
            recording.event(from + 2, code::RUNNING, 2, [0, 0]);
            recording.event(from + 9, code::WAITING, 2, [Subject::Channel as u64, 3]);
        }
    }
    let path = recording.write("turns.luna");
    let extra = "[system.part.event]\nprocess = \"Works\"\non = \"fast\"\npriority = 25\n";
    let model = format!("{MODEL}\n{extra}");
    let model = model.replacen("cost = \"120 us\"\nlongest_poll = \"40 us\"\n", "", 1);
    let output = schedule("recorded", &model, &["--costs", &path]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(0), "{said}{}", err(&output));
    // A poll of the logger, its own cost, one of the event's jobs, and the latency.
    assert_eq!(
        row(said, "servo")[6..],
        ["40.0", "30.0", "367.0", "51.0", "1000.0", "633.0", "holds"]
    );
    // Without a deadline. It waits for the logger's poll.
    assert_eq!(
        row(said, "event")[5..],
        ["seen", "7.0", "7.0", "307.0", "9.0", "-", "-", "-"]
    );

    // What is stated counts if it is more than what was measured, and no longer if it is less.
    for (stated, counts) in [("50 us", "50.0"), ("30 us", "40.0")] {
        let stated = format!("priority = 20\ncost = \"{stated}\"");
        let model = model.replacen("priority = 20", &stated, 1);
        let output = schedule("stated", &model, &["--costs", &path]);
        assert_eq!(row(out(&output), "servo")[6], counts, "{stated}");
    }
}

#[test]
fn a_response_beyond_the_bound_contradicts_it() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    for cycle in 1..5 {
        let slot = cycle * 1000;
        recording.servo(slot + 1, slot + 31, true, [Subject::Channel as u64, 3]);
        // It waited for 669 µs.
        recording.servo(slot + 700, slot + 710, false, FOR_SLOT);
    }
    let path = recording.write("waits.luna");
    let output = schedule("contradicted", MODEL, &["--costs", &path]);
    let said = out(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(row(said, "servo").last(), Some(&"contradicted"));
    assert!(
        said.contains("servo: it took 710µs in the recording"),
        "{said}"
    );
}

#[test]
fn a_recording_without_turns_or_of_a_virtual_clock_is_refused() {
    for (clock, why) in [
        (ClockBase::Monotonic, "it was recorded without events"),
        (ClockBase::Virtual, "virtual clock"),
    ] {
        let path = Recording::new(clock).write("refused.luna");
        let output = schedule("refused", MODEL, &["--costs", &path]);
        assert_eq!(output.status.code(), Some(2), "{}", out(&output));
        assert!(err(&output).contains(why), "{}", err(&output));
    }
}

//! `luna model schedule`: what a recording adds.

use crate::run;
use crate::schedule::{MODEL, err, flat, out, row, schedule};
use luna_events::code;
use luna_logger::format::{ClockBase, Event, Losing, Record, Subject, Writer};
use std::fs;

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

    fn write(mut self, name: &str) -> String {
        self.put(&Record::End { time: 1 << 50 });
        self.cut_off(name)
    }

    /// As a killed program leaves it.
    fn cut_off(self, name: &str) -> String {
        let path = run::file(&format!("schedule-{name}"));
        fs::write(&path, self.0.finish().unwrap()).unwrap();
        run::path(&path).to_owned()
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

/// A turn of 7 µs of `event` from there, woken before by so much.
fn event(recording: &mut Recording, from: u64, woken: u64) {
    recording.event(from - woken, code::READY, 2, [1, 0]);
    recording.event(from, code::RUNNING, 2, [0, 0]);
    recording.event(from + 7, code::WAITING, 2, [Subject::Channel as u64, 3]);
}

/// The row of `event` beside the servo and the logger, as the recording has it.
fn recorded(name: &str, recording: Recording) -> (Option<i32>, Vec<String>, String) {
    let path = recording.write(&format!("{name}.luna"));
    let model = format!("{MODEL}\n[system.part.event]\nprocess = \"Works\"\non = \"fast\"\n");
    let output = schedule(name, &model, &["--costs", &path]);
    let words = row(out(&output), "event");
    let words = words.into_iter().map(str::to_owned).collect();
    (output.status.code(), words, flat(&output))
}

#[test]
fn a_late_burst_of_wakes_counts() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    for turn in 1..100_100 {
        event(&mut recording, turn * 1000, 2);
    }
    for turn in 0..100 {
        event(&mut recording, 101_000_000 + turn * 10, 2);
    }
    let (_, row, said) = recorded("burst", recording);
    assert_eq!(row[5], "seen", "{said}");
    // 70 % and what the servo and the logger take.
    assert!(said.contains("core 2: 102.0 %"), "{said}");
}

#[test]
fn the_last_turn_counts() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    for cycle in 1..5 {
        recording.servo(cycle * 1000, cycle * 1000 + 20, true, FOR_SLOT);
        event(&mut recording, cycle * 1000 + 100, 2);
    }
    recording.servo(6000, 6010, true, YIELDS);
    recording.event(6020, code::RUNNING, 1, [0, 0]);
    recording.event(6520, code::DONE, 1, [0, 0]);
    let path = recording.write("last.luna");
    let model = MODEL.replacen("cost = \"120 us\"\nlongest_poll = \"40 us\"\n", "", 1);
    let output = schedule("last", &model, &["--costs", &path]);
    assert_eq!(row(out(&output), "servo")[6..8], ["510.0", "500.0"]);
}

#[test]
fn what_a_recording_lacks_or_has_alone_exits_with_4() {
    let turns = || {
        let mut recording = Recording::new(ClockBase::Monotonic);
        for cycle in 1..5 {
            recording.servo(cycle * 1000, cycle * 1000 + 20, true, FOR_SLOT);
        }
        recording
    };
    let code = |name: &str, recording: Recording| {
        let path = recording.write(&format!("{name}.luna"));
        let output = schedule(name, MODEL, &["--costs", &path]);
        (output.status.code(), flat(&output))
    };
    let (holds, said) = code("whole", turns());
    assert_eq!(holds, Some(0), "{said}");
    let mut lost = turns();
    let of = Losing::Events(0);
    lost.put(&Record::Losses { of, lost: 3 });
    let (unknown, said) = code("lost", lost);
    assert_eq!(unknown, Some(4), "{said}");
    let mut stranger = turns();
    event(&mut stranger, 8000, 2);
    let (unknown, said) = code("stranger", stranger);
    assert_eq!(unknown, Some(4), "{said}");
    assert!(said.contains("has no such part: event"), "{said}");
    let path = turns().cut_off("killed.luna");
    let output = schedule("killed", MODEL, &["--costs", &path]);
    assert_eq!(output.status.code(), Some(4), "{}", out(&output));
    assert!(flat(&output).contains("has no end"), "{}", out(&output));
}

#[test]
fn a_turn_that_yields_is_no_release_and_what_waits_for_the_start_no_response() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    recording.event(0, code::READY, 2, [0, 0]);
    for turn in 5..20 {
        let from = turn * 1000;
        recording.event(from, code::READY, 2, [0, 0]);
        recording.event(from + 1, code::RUNNING, 2, [0, 0]);
        recording.event(from + 3, code::READY, 2, [0, 0]);
        recording.event(from + 4, code::WAITING, 2, YIELDS);
        recording.event(from + 5, code::RUNNING, 2, [0, 0]);
        recording.event(from + 9, code::WAITING, 2, [Subject::Channel as u64, 3]);
    }
    let (_, row, said) = recorded("yields", recording);
    // Its response is 9 µs, and it comes once a millisecond.
    assert_eq!((row[6].as_str(), row[9].as_str()), ("7.0", "9.0"), "{said}");
    assert!(said.contains("core 2: 32.7 %"), "{said}");
}

#[test]
fn cycles_that_are_over_at_the_next_slot() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    for cycle in 1..9 {
        let from = cycle * 1000;
        recording.event(from + 1, code::RUNNING, 1, [0, 0]);
        recording.event(from + 1, code::SLOT, 5, [0, 1000]);
        // The next one is in the same turn.
        recording.event(from + 31, code::SLOT, 5, [0, 1000]);
        recording.event(from + 51, code::WAITING, 1, [Subject::Channel as u64, 3]);
        // It serves others long after.
        recording.event(from + 950, code::RUNNING, 1, [0, 0]);
        recording.event(from + 951, code::WAITING, 1, [Subject::Channel as u64, 3]);
    }
    let path = recording.write("over.luna");
    let model = MODEL.replacen("cost = \"120 us\"\nlongest_poll = \"40 us\"\n", "", 1);
    let output = schedule("over", &model, &["--costs", &path]);
    let said = row(out(&output), "servo");
    assert_eq!([said[6], said[7], said[9]], ["50.0", "50.0", "31.0"]);
}

#[test]
fn a_recorded_name_is_found_by_what_a_model_can_have() {
    let mut recording = Recording::new(ClockBase::Monotonic);
    recording.put(&Record::Name {
        subject: Subject::Process,
        number: 2,
        parent: 0,
        name: "lo-gger/",
        runs_on: None,
    });
    event(&mut recording, 1000, 2);
    event(&mut recording, 2000, 2);
    let path = recording.write("names.luna");
    let model = MODEL.replace("logger", "lo_gger");
    let output = schedule("names", &model, &["--costs", &path]);
    assert_eq!(row(out(&output), "lo_gger")[9], "9.0", "{}", out(&output));
    assert!(!flat(&output).contains("no such part"), "{}", out(&output));
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

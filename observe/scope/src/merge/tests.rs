use super::*;
use luna_logger::format::{Event, Level, Reader, Subject, Type, Values, Writer};
use std::io::Cursor;

/// Seconds, in ns.
const SECOND: u64 = 1_000_000_000;

/// A recording of a program with a signal `speed`, of which each sample is the time in s, and a
/// process 1 that runs at each.
fn recording(system: &str, day: Option<i64>, seconds: &[u64], ends: bool) -> Vec<u8> {
    let mut file = Writer::new(Vec::new()).unwrap();
    let mut put = |record: &Record<'_>| file.put(record).unwrap();
    put(&Record::Session {
        system,
        clock: ClockBase::Monotonic,
        written_by: "a test",
    });
    put(&Record::Signal(SignalInfo {
        number: 0,
        element_type: Type::U64,
        elements: 1,
        name: "speed",
        unit: "",
        description: "",
    }));
    put(&Record::Name {
        subject: Subject::Process,
        number: 1,
        parent: 0,
        name: "control",
        runs_on: None,
    });
    if let Some(day) = day {
        put(&Record::Epoch {
            time: seconds[0] * SECOND,
            unix: day + (seconds[0] * SECOND) as i64,
        });
    }
    for second in seconds {
        put(&Record::Sample {
            signal: 0,
            time: second * SECOND,
            values: Values::from_bytes(Type::U64, &second.to_le_bytes()),
        });
        put(&Record::Event(Event {
            thread: 1,
            time: second * SECOND,
            code: code::RUNNING,
            subject: 1,
            arguments: [0, 0],
        }));
    }
    if let (true, Some(time)) = (ends, seconds.last()) {
        let time = time * SECOND;
        put(&Record::End { time });
    }
    file.finish().unwrap()
}

/// What a recording has, in words: the name of a signal or a process with its time in s.
fn words(recording: &[u8]) -> Vec<String> {
    let mut reader = Reader::new(recording).unwrap();
    let (mut signals, mut processes) = (HashMap::new(), HashMap::new());
    let mut words = Vec::new();
    while let Some(record) = reader.next().unwrap() {
        match record {
            Record::Session { system, .. } => words.push(system.to_owned()),
            Record::Signal(info) => {
                signals.insert(info.number, info.name.to_owned());
            }
            Record::Name { number, name, .. } => {
                processes.insert(number, name.to_owned());
            }
            Record::Sample { signal, time, .. } => {
                words.push(format!("{} {}", signals[&signal], time / SECOND));
            }
            Record::Event(event) => {
                let name = &processes[&event.subject];
                words.push(format!("{name} {}", event.time / SECOND));
            }
            Record::End { time } => words.push(format!("end {}", time / SECOND)),
            _ => {}
        }
    }
    words
}

fn merged<const N: usize>(recordings: [Vec<u8>; N]) -> Vec<String> {
    words(&merge(&mut recordings.map(Cursor::new), Vec::new()).unwrap())
}

#[test]
fn programs_are_on_one_time_axis_with_their_names() {
    let all = merged([
        recording("left", None, &[1, 4, 5], true),
        recording("right", None, &[2, 3, 7], true),
    ]);
    assert_eq!(
        all,
        [
            "left",
            "left/speed 1",
            "left/control 1",
            "left, right",
            "right/speed 2",
            "right/control 2",
            "right/speed 3",
            "right/control 3",
            "left/speed 4",
            "left/control 4",
            "left/speed 5",
            "left/control 5",
            "right/speed 7",
            "right/control 7",
            "end 7",
        ]
    );
}

#[test]
fn a_program_that_was_killed_and_started_again_goes_on() {
    let speeds = |mut all: Vec<String>| {
        all.retain(|word| word.contains("speed"));
        all
    };
    let all = merged([
        recording("left", None, &[1, 9], true),
        recording("right", None, &[6, 7], true),
        recording("right", None, &[2, 3], false),
    ]);
    let known = [
        "left/speed 1",
        "right/speed 2",
        "right/speed 3",
        "right/speed 6",
    ];
    assert_eq!(speeds(all)[..4], known);
    // Two at a time are two.
    let all = merged([
        recording("right", None, &[1, 3], true),
        recording("right", None, &[2, 4], true),
    ]);
    let known = [
        "right/speed 1",
        "right 2/speed 2",
        "right/speed 3",
        "right 2/speed 4",
    ];
    assert_eq!(speeds(all), known);
}

#[test]
fn another_computers_times_are_placed_by_the_time_of_day() {
    let day = 1_700_000_000 * SECOND as i64;
    let all = merged([
        recording("here", Some(day), &[100, 103], true),
        // Its clock is 1000 s behind. A clock that is set by half a second is the same one.
        recording("there", Some(day + 1000 * SECOND as i64), &[0], true),
        recording("there", Some(day - 900 * SECOND as i64), &[1002], true),
        recording("near", Some(day + SECOND as i64 / 2), &[101], true),
    ]);
    let speeds: Vec<_> = all
        .into_iter()
        .filter(|word| word.contains("speed"))
        .collect();
    // One program of the name had ended when the other began.
    assert_eq!(
        speeds,
        [
            "here/speed 100",
            "near/speed 101",
            "there/speed 102",
            "here/speed 103",
            "there/speed 1000"
        ]
    );
}

#[test]
fn damage_and_too_many_are_said_and_the_rest_is_there() {
    let mut damaged = recording("left", None, &[1, 2], true);
    damaged.pop();
    let mut all = [recording("right", None, &[3], true), damaged].map(Cursor::new);
    let mut output = Vec::new();
    let error = merge(&mut all, &mut output).unwrap_err();
    assert!(matches!(error, MergeError::Read(1, _)), "{error}");
    assert_eq!(error.recording(), Some(1));
    assert!(words(&output).contains(&"right/speed 3".to_owned()));

    let mut none = [Cursor::new(b"no recording".to_vec())];
    let error = merge(&mut none, Vec::new()).unwrap_err();
    assert!(matches!(error, MergeError::Open(0, _)), "{error}");

    let mut many: Vec<_> = (0..=MAX_PROGRAMS)
        .map(|n| Cursor::new(recording(&n.to_string(), None, &[1], true)))
        .collect();
    let error = merge(&mut many, Vec::new()).unwrap_err();
    assert!(matches!(error, MergeError::TooMany), "{error}");
    many.pop();
    assert!(merge(&mut many, Vec::new()).is_ok());
}

#[test]
fn a_silent_program_is_waited_for_and_not_for_ever() {
    let mut merge = Merge::default();
    let mut given = Vec::new();
    let mut nothing = |_: &Record<'_>| {};
    let left = merge
        .begin("left", ClockBase::Monotonic, Duration::MAX, &mut nothing)
        .unwrap();
    let right = merge
        .begin("right", ClockBase::Monotonic, Duration::MAX, &mut nothing)
        .unwrap();
    let event = |time| {
        Record::Event(Event {
            thread: 1,
            time,
            code: code::RUNNING,
            subject: 1,
            arguments: [0, 0],
        })
    };
    let now = Instant::now();
    for place in [left, right] {
        merge.hear(place, now);
    }
    merge.take(left, &event(10), &mut nothing);
    assert_eq!(merge.complete_until(now), 0);
    merge.take(right, &event(8), &mut nothing);
    assert_eq!(merge.complete_until(now), 8);
    merge.hear(left, now + SILENCE);
    assert_eq!(merge.complete_until(now + SILENCE), 10);
    assert_eq!(merge.complete_until(now + 2 * SILENCE), u64::MAX);
    merge.release(9, &mut |record| given.push(crate::store::time(record)));
    assert_eq!(given, [Some(8)]);
    merge.end(left);
    assert_eq!(merge.complete_until(now), 8);
    merge.end(right);
    assert!(!merge.is_live());
    merge.finish(&mut |record| given.push(crate::store::time(record)));
    assert_eq!(given, [Some(8), Some(10)]);
}

#[test]
fn a_silent_program_is_continued_by_one_of_its_name() {
    let mut merge = Merge::default();
    let mut nothing = |_: &Record<'_>| {};
    let end = Record::End { time: 7 };
    let clock = ClockBase::Monotonic;
    let first = merge.begin("left", clock, Duration::MAX, &mut nothing);
    let second = merge.begin("left", clock, Duration::ZERO, &mut nothing);
    let (first, second) = (first.unwrap(), second.unwrap());
    assert_eq!(merge.programs.len(), 1);
    // The first is not heard any more, and its end is not that of the second.
    merge.take(first, &end, &mut nothing);
    assert_eq!(merge.end, None);
    merge.end(first);
    assert!(merge.is_live());
    merge.take(second, &end, &mut nothing);
    assert_eq!(merge.end, Some(7));
    merge.end(second);
    assert!(!merge.is_live());
}

#[test]
fn what_waits_for_a_slower_program_is_bounded() {
    let mut merge = Merge::default();
    let mut nothing = |_: &Record<'_>| {};
    let mut begin = |name| merge.begin(name, ClockBase::Monotonic, Duration::MAX, &mut nothing);
    let (quick, _slow) = (begin("quick").unwrap(), begin("slow").unwrap());
    let text = "x".repeat(1 << 16);
    let mut given = 0;
    for time in 0..2000 {
        let message = Record::Message {
            thread: 1,
            time,
            level: Level::Info,
            process: 1,
            truncated: false,
            target: "",
            text: &text,
        };
        merge.take(quick, &message, &mut |_| {});
        merge.release(0, &mut |_| given += 1);
        assert!(merge.held_bytes <= MAX_HELD);
    }
    assert!((900..1100).contains(&given), "{given}");
    merge.finish(&mut |_| given += 1);
    assert_eq!((given, merge.held_bytes), (2000, 0));
}

//! What a viewer gets of a recording that goes on.

use crate::viewer::{Data, Viewer};
use foxglove::Decode;
use foxglove::messages::Log;
use luna_events::code;
use luna_foxglove::{Foxglove, FoxgloveSink};
use luna_logger::format::json::Topic;
use luna_logger::format::{ClockBase, Encoder, Event, Record, SignalInfo, Subject, Type, Values};
use luna_logger::{Hub, Level, Logging, Recorder, Signal, Sink};
use serde_json::json;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// When the recording's clock reads `BEGIN`, as time of the day.
const DAY: u64 = 1_700_000_000_000_000_000;
const BEGIN: u64 = 5_000_000;
const STEP: u64 = 1_000_003;

fn open() -> Foxglove {
    Foxglove::open(([127, 0, 0, 1], 0).into()).unwrap()
}

fn signal(number: u32, element_type: Type, elements: u8, name: &str) -> Record<'_> {
    Record::Signal(SignalInfo {
        number,
        element_type,
        elements,
        name,
        unit: "rad",
        description: "",
    })
}

/// A turn of process 9 in each even step, and a send into channel 9 by that process in each odd
/// one.
fn event(step: u64, time: u64) -> Event {
    let (code, arguments) = match step % 2 {
        0 => (code::RUNNING, [0, 0]),
        _ => (code::COMMUNICATION, [9, 0]),
    };
    Event {
        thread: 1,
        time,
        code,
        subject: 9,
        arguments,
    }
}

/// The event of a step, as a viewer gets it.
fn event_in_words(step: u64) -> serde_json::Value {
    match step % 2 {
        0 => json!({
            "event": "running", "thread": "control", "subject": "servo", "first": "", "second": "",
            "code": 2, "number": 9, "arguments": [0, 0],
        }),
        _ => json!({
            "event": "communication", "thread": "control", "subject": "torque", "first": "servo",
            "second": "", "code": 5, "number": 9, "arguments": [9, 0],
        }),
    }
}

/// Hands over the declarations, then samples, messages and events until it is told to stop. Those
/// of step n have the value `first` + n, and the time n steps after the beginning.
fn record(mut sink: FoxgloveSink, stop: &AtomicBool, first: f64) {
    sink.begin(&Encoder::head()).unwrap();
    let mut encoder = Encoder::new();
    let session = Record::Session {
        system: "arm",
        clock: ClockBase::Monotonic,
        written_by: "a test",
    };
    encoder.put(&session);
    let name = "control";
    encoder.put(&Record::Thread { number: 1, name });
    for (subject, number, name) in [
        (Subject::Process, 9, "servo"),
        (Subject::Channel, 9, "torque"),
        (Subject::Code, code::RUNNING.into(), "running"),
        (Subject::Code, code::COMMUNICATION.into(), "communication"),
    ] {
        encoder.put(&Record::Name {
            subject,
            number,
            parent: 0,
            name,
            runs_on: None,
        });
    }
    let (time, unix) = (BEGIN, DAY as i64);
    encoder.put(&Record::Epoch { time, unix });
    encoder.put(&signal(0, Type::F64, 1, "arm/angle"));
    encoder.put(&signal(1, Type::I16, 3, "/arm/list"));
    let mut step = 0_u64;
    while !stop.load(Ordering::Relaxed) {
        let time = BEGIN + step * STEP;
        let angle = (first + step as f64).to_le_bytes();
        let list: Vec<u8> = [1, -2, 3_i16]
            .into_iter()
            .flat_map(i16::to_le_bytes)
            .collect();
        for (signal, values) in [
            (0, Values::from_bytes(Type::F64, &angle)),
            (1, Values::from_bytes(Type::I16, &list)),
        ] {
            encoder.put(&Record::Sample {
                signal,
                time,
                values,
            });
        }
        encoder.put(&Record::Message {
            thread: 1,
            time,
            level: Level::Warn,
            process: 0,
            truncated: false,
            target: "arm",
            text: &step.to_string(),
        });
        encoder.put(&Record::Event(event(step, time)));
        sink.block(encoder.block()).unwrap();
        encoder.next();
        step += 1;
        std::thread::yield_now();
    }
    sink.end(std::time::Duration::ZERO).unwrap();
}

/// The step that a message is of, by its time.
fn step_of(data: &Data) -> u64 {
    let since = data.time - DAY;
    assert_eq!(since % STEP, 0, "{data:?}");
    since / STEP
}

#[test]
fn a_viewer_gets_samples_messages_and_events_with_their_times() {
    let foxglove = open();
    let stop = Arc::new(AtomicBool::new(false));
    let recorder = std::thread::spawn({
        let (sink, stop) = (foxglove.sink(), stop.clone());
        move || record(sink, &stop, 0.0)
    });
    let mut viewer = Viewer::connect(foxglove.address());
    let angle = viewer.subscribe("/arm/angle", 10);
    assert_eq!(
        (&angle["encoding"], &angle["schemaName"]),
        (&json!("protobuf"), &json!("luna.f64x1"))
    );
    assert_eq!(angle["schemaEncoding"], "protobuf");
    viewer.subscribe("/arm/list", 11);
    let log = viewer.subscribe("/luna/log", 12);
    assert_eq!(
        (&log["encoding"], &log["schemaName"]),
        (&json!("protobuf"), &json!("foxglove.Log"))
    );
    let events = viewer.subscribe("/luna/events", 13);
    // As in an MCAP file.
    let topic = Topic::of_events();
    assert_eq!(
        (&events["schemaName"], &events["schema"]),
        (
            &json!(topic.schema_name),
            &json!(String::from_utf8(topic.schema).unwrap())
        )
    );

    let mut seen = [0_u64; 4];
    let mut last = None;
    while seen.iter().any(|count| *count < 20) {
        let data = viewer.data();
        let step = step_of(&data);
        match data.subscription {
            10 => {
                assert_eq!(data.double(), step as f64);
                assert!(last.is_none_or(|last| last < step), "{last:?}, {step}");
                last = Some(step);
            }
            11 => assert_eq!(data.small(), [1, -2, 3]),
            12 => {
                let message = Log::decode(&data.content[..]).unwrap();
                assert_eq!(message.message, step.to_string());
                assert_eq!((message.name.as_str(), message.level), ("control: arm", 3));
                let time = message.timestamp.unwrap();
                let nanos = u64::from(time.sec()) * 1_000_000_000 + u64::from(time.nsec());
                assert_eq!(nanos, data.time);
            }
            13 => assert_eq!(data.json(), event_in_words(step)),
            other => panic!("subscription {other}"),
        }
        seen[(data.subscription - 10) as usize] += 1;
    }
    // A viewer that goes is no error of the recording.
    drop(viewer);
    stop.store(true, Ordering::Relaxed);
    recorder.join().unwrap();
}

#[test]
fn a_signal_of_a_running_hub_arrives_with_the_time_of_day() {
    let foxglove = open();
    let hub = Hub::new("arm", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(foxglove.sink())).unwrap();
    let inside = hub.enter();
    let angle = Signal::<f64>::with_unit("arm/angle", "rad")
        .register()
        .unwrap();
    let now = || SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let before = now();
    let stop = AtomicBool::new(false);
    let first = std::thread::scope(|scope| {
        let viewer = scope.spawn(|| {
            let mut viewer = Viewer::connect(foxglove.address());
            let channel = viewer.subscribe("/arm/angle", 1);
            assert_eq!(channel["metadata"], json!({ "unit": "rad" }));
            let first = viewer.data();
            stop.store(true, Ordering::Relaxed);
            first
        });
        while !stop.load(Ordering::Relaxed) && !viewer.is_finished() {
            angle.record(0.25);
            std::thread::yield_now();
        }
        viewer.join().unwrap()
    });
    let after = now();
    drop(inside);
    drop(angle);
    assert_eq!(recorder.finish().error, None);
    assert_eq!(first.double(), 0.25);
    // Two clocks of one machine: a second is room for a step of one of them.
    let (least, most) = (
        before.as_nanos() - 1_000_000_000,
        after.as_nanos() + 1_000_000_000,
    );
    assert!(
        (least..=most).contains(&u128::from(first.time)),
        "{first:?}"
    );
}

#[test]
fn a_second_recording_goes_on_with_the_topics_of_the_first() {
    let foxglove = open();
    let mut viewer = Viewer::connect(foxglove.address());
    // No run has so many steps that it reaches the values of the other.
    for (run, first) in [0.0, 1e12].into_iter().enumerate() {
        let stop = Arc::new(AtomicBool::new(false));
        let recorder = std::thread::spawn({
            let (sink, stop) = (foxglove.sink(), stop.clone());
            move || record(sink, &stop, first)
        });
        if run == 0 {
            viewer.subscribe("/arm/angle", 10);
        }
        // Of the first run some are still on their way.
        loop {
            let data = viewer.data();
            let value = data.double();
            if value >= first {
                assert_eq!(value - first, step_of(&data) as f64);
                break;
            }
        }
        stop.store(true, Ordering::Relaxed);
        recorder.join().unwrap();
    }
    let other = Foxglove::open(foxglove.address()).unwrap_err();
    assert_eq!(other.kind(), std::io::ErrorKind::AddrInUse);
}

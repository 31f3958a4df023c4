//! `logger`: the cost of recording one sample or event for its thread, on one core, and the cost of
//! commstime with every event recorded, not recorded, and compiled out (all with the feature
//! `events`).
//!
//! A block records as many samples as there is room for, so that none is lost, while the recorder
//! writes a file on any core. Compared with a line through `tracing` to a file by its non-blocking
//! appender, and with reading the clocks.

use std::{
    hint::black_box,
    path::PathBuf,
    time::{Duration, Instant},
};

use luna_benches::{
    cores::{on_core, one_core},
    executors::on_one_core,
    harness::{Case, Goal, run},
    networks,
    ours::{Luna, LunaChannel},
    processes::{delta, warm_up},
};
use luna_logger::{Hub, Level, Logging, Recorder, Signal, TracingSubscriber, message};
use luna_machine::counter::Counter;
use luna_platform::clock::Instant as LunaInstant;
use tracing_appender::non_blocking::NonBlockingBuilder;

const SAMPLE: &str = "record a sample, one core";
const UNIT: &str = "ns/sample";
/// Samples of a block: all have room.
const SAMPLES: u64 = 10_000;

fn file(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("luna-bench-{}-{name}", std::process::id()))
}

/// Times `record` for each number during a recording to a file; nothing may be lost.
fn recorded<T>(
    samples: u64,
    make: impl Fn() -> T + Sync,
    record: impl Fn(&T, u64) + Sync,
) -> Duration {
    on_core(one_core(), || {
        let file = file("recording");
        let hub = Hub::new("bench", Default::default());
        let room = Logging::to_file(&file)
            .room_for_samples(2 * SAMPLES as usize)
            .room_for_messages(128 * SAMPLES as usize);
        let recorder = Recorder::start(&hub, room).expect("the folder can be written to");
        hub.enter_thread();
        let registering = hub.enter();
        let target = make();
        drop(registering);
        let start = Instant::now();
        for n in 0..samples {
            record(&target, black_box(n));
        }
        let elapsed = start.elapsed();
        let report = recorder.finish();
        std::fs::remove_file(file).expect("it was made");
        let of_signals = report
            .signals
            .iter()
            .map(|signal| signal.recorded)
            .sum::<u64>();
        assert_eq!(of_signals + report.messages.recorded, samples, "{report}");
        elapsed
    })
}

fn not_recording(samples: u64) -> Duration {
    on_core(one_core(), || {
        let hub = Hub::new("bench", Default::default());
        let _inside = hub.enter();
        let signal = Signal::register("signal").expect("the name is free");
        let start = Instant::now();
        for n in 0..samples {
            signal.record(black_box(n));
        }
        start.elapsed()
    })
}

/// A line of text through `tracing` and its non-blocking appender to a file.
fn tracing_to_file(samples: u64) -> Duration {
    on_core(one_core(), || {
        let path = file("tracing");
        let output = std::fs::File::create(&path).expect("the folder can be written to");
        let (writer, guard) = NonBlockingBuilder::default()
            .buffered_lines_limit(2 * SAMPLES as usize)
            .finish(output);
        let dropped = writer.error_counter();
        let subscriber = tracing_subscriber::fmt()
            .with_writer(writer)
            .with_ansi(false)
            .finish();
        let elapsed = tracing::subscriber::with_default(subscriber, || {
            let start = Instant::now();
            for n in 0..samples {
                tracing::info!(value = black_box(n) as f64);
            }
            start.elapsed()
        });
        drop(guard);
        let lines = std::fs::read(&path).expect("it was made");
        std::fs::remove_file(path).expect("it was made");
        assert_eq!(dropped.dropped_lines(), 0);
        assert_eq!(
            lines.iter().filter(|byte| **byte == b'\n').count() as u64,
            samples
        );
        elapsed
    })
}

/// An event with two numbers, during a recording to a file.
#[cfg(feature = "events")]
fn event(events: u64) -> Duration {
    use luna_events::{code, report};
    on_core(one_core(), || {
        let file = file("events");
        let hub = Hub::new("bench", Default::default());
        let room = Logging::to_file(&file).room_for_events(2 * SAMPLES as usize);
        let recorder = Recorder::start(&hub, room).expect("the folder can be written to");
        hub.enter_thread();
        hub.enter_executor();
        let start = Instant::now();
        for n in 0..events {
            report(code::COMMUNICATION, 7, || [black_box(n), 1]);
        }
        let elapsed = start.elapsed();
        let report = recorder.finish();
        std::fs::remove_file(file).expect("it was made");
        assert_eq!((report.events.recorded, report.events.lost), (events, 0));
        elapsed
    })
}

/// Commstime with a sequential delta; `records` its events.
fn commstime(cycles: u64, records: bool) -> Duration {
    on_one_core(|executor: &Luna| {
        let path = file("commstime");
        if records {
            record_events(executor, Logging::to_file(&path), cycles);
        }
        let elapsed = networks::commstime::<_, LunaChannel, _>(executor, delta, cycles);
        if records {
            let bytes = std::fs::metadata(&path).expect("it was made").len();
            std::fs::remove_file(path).expect("it was made");
            // Some 16 events a cycle, of some 8 bytes.
            assert!(bytes > 60 * cycles, "{bytes}");
        }
        elapsed
    })
}

/// Room for all of them: 16 a cycle.
#[cfg(feature = "events")]
fn record_events(executor: &Luna, recording: Logging, cycles: u64) {
    let events = 20 * (cycles + warm_up(cycles)) as usize;
    executor.system().log(recording.room_for_events(events));
}

#[cfg(not(feature = "events"))]
fn record_events(_: &Luna, _: Logging, cycles: u64) {
    unreachable!("no events of {} cycles", warm_up(cycles));
}

fn clock(samples: u64, read: impl Fn() -> u64 + Sync) -> Duration {
    on_core(one_core(), || {
        let start = Instant::now();
        for _ in 0..samples {
            black_box(read());
        }
        start.elapsed()
    })
}

fn main() {
    let case =
        |peer, block: fn(u64) -> Duration| Case::new(SAMPLE, peer, UNIT, block).exactly(SAMPLES);
    let mut cases = vec![
        case("LUNA, f64", |samples| {
            recorded(
                samples,
                || Signal::<f64>::register("signal").expect("the name is free"),
                |signal, n| signal.record(n as f64),
            )
        })
        .goal(Goal::AtMost(20.0)),
        case("LUNA, [f64; 3]", |samples| {
            recorded(
                samples,
                || Signal::<[f64; 3]>::register("signal").expect("the name is free"),
                |signal, n| signal.record([n as f64; 3]),
            )
        }),
        case("LUNA, not recording", not_recording),
        case("LUNA, message", |samples| {
            recorded(
                samples,
                || (),
                |(), n| message(Level::Info, "bench", format_args!("value={}", n as f64)),
            )
        }),
        case("LUNA, tracing's facade", |samples| {
            recorded(
                samples,
                // The subscriber of the thread, until it is dropped.
                || tracing::subscriber::set_default(TracingSubscriber::new(Level::Info)),
                |_, n| tracing::info!(value = n as f64),
            )
        }),
        case("tracing, fmt, non-blocking file", tracing_to_file),
        case("clock_gettime", |samples| {
            clock(samples, || LunaInstant::now_real().as_nanos())
        }),
    ];
    if Counter::of_machine().is_some() {
        cases.push(case("rdtsc", |samples| {
            let counter = Counter::of_machine().expect("it was there before");
            clock(samples, || counter.read())
        }));
    }
    const COMMSTIME: &str = "commstime, one core";
    const CYCLE: &str = "ns/cycle";
    let cycle = |peer, block: fn(u64) -> Duration| {
        Case::new(COMMSTIME, peer, CYCLE, block).exactly(SAMPLES)
    };
    #[cfg(feature = "events")]
    cases.extend([
        case("LUNA, event", event).goal(Goal::AtMost(20.0)),
        cycle("LUNA, events not recorded", |cycles| {
            commstime(cycles, false)
        }),
        cycle("LUNA, every event recorded", |cycles| {
            commstime(cycles, true)
        }),
    ]);
    #[cfg(not(feature = "events"))]
    cases.push(cycle("LUNA, events compiled out", |cycles| {
        commstime(cycles, false)
    }));
    run("logger", cases);
}

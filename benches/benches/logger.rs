//! `logger`: what recording one sample costs the thread that does it, on one core.
//!
//! A block records as many samples as there is room for, so that none is lost, while the recorder writes a file on any core. Beside it a line through
//! `tracing` to a file by its non-blocking appender, and the clocks alone.

use std::{
    hint::black_box,
    path::PathBuf,
    time::{Duration, Instant},
};

use luna_benches::{
    cores::{on_core, one_core},
    harness::{Case, Goal, run},
};
use luna_logger::{Hub, Level, Logging, Recorder, Signal, TracingSubscriber, message};
use luna_platform::clock::{Counter, Instant as LunaInstant};
use tracing_appender::non_blocking::NonBlockingBuilder;

const SAMPLE: &str = "record a sample, one core";
const UNIT: &str = "ns/sample";
/// Samples of a block: all have room.
const SAMPLES: u64 = 10_000;

fn file(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("luna-bench-{}-{name}", std::process::id()))
}

/// Times `record` for each number while a recording to a file is under way; nothing may be lost.
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
        let target = make();
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
    run("logger", cases);
}

//! A system's recording holds what its processes record, on either clock, and its report says what
//! became of it.
#![cfg(feature = "logger")]

use crate::common;
use common::{SpawnOk, watchdog, with_signals};
use luna::Error;
use luna::error::SetupError;
use luna::log::{Level, Logging, RegisterError, Sink, StartError};
use luna::prelude::*;
use luna::report::LoggingReport;
use luna_logger::format::{ClockBase, Reader, Record};
use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Keeps what it takes.
#[derive(Debug, Clone, Default)]
struct Kept(Arc<Mutex<Vec<u8>>>);

impl Sink for Kept {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.block(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.0.lock().unwrap().extend_from_slice(block);
        Ok(())
    }
}

/// What is in a recording.
#[derive(Debug, Default)]
struct Content {
    clock: Option<ClockBase>,
    signals: Vec<String>,
    threads: Vec<String>,
    /// Number of the signal, time, first element.
    samples: Vec<(u32, u64, f64)>,
    /// Process, text.
    messages: Vec<(u32, String)>,
}

fn content(bytes: &[u8]) -> Content {
    let mut content = Content::default();
    let mut reader = Reader::new(bytes).unwrap();
    while let Some(record) = reader.next().unwrap() {
        match record {
            Record::Session { clock, .. } => content.clock = Some(clock),
            Record::Signal(info) => content.signals.push(info.name.to_owned()),
            Record::Thread { name, .. } => content.threads.push(name.to_owned()),
            Record::Sample {
                signal,
                time,
                values,
            } => {
                let first = values.iter().next().unwrap().as_f64();
                content.samples.push((signal, time, first));
            }
            Record::Message { process, text, .. } => {
                content.messages.push((process, text.to_owned()));
            }
            _ => {}
        }
    }
    assert!(reader.has_ended());
    content
}

/// Counts its cycles, and the same from the end.
struct Counter {
    name: String,
    cycles: u32,
    up: Option<Signal<u32>>,
    down: Option<Signal<[f32; 2]>>,
}

impl Counter {
    fn new(name: &str, cycles: u32) -> Self {
        Self {
            name: name.to_owned(),
            cycles,
            up: None,
            down: None,
        }
    }
}

impl Process for Counter {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.up = Some(Signal::register(&format!("{}/up", self.name))?);
        self.down = Some(Signal::with_unit(&format!("{}/down", self.name), "m").register()?);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let mut tick = luna::periodic(&self.name, Duration::from_millis(1))?;
        for n in 1..=self.cycles {
            tick.next().await;
            if let (Some(up), Some(down)) = (&self.up, &self.down) {
                up.record(n);
                down.record([(self.cycles - n) as f32, 0.5]);
            }
        }
        luna::log::message(
            Level::Info,
            "counter",
            format_args!("{} is done", self.name),
        );
        Ok(())
    }

    fn post_run(&mut self) {
        if let Some(up) = &self.up {
            up.record(0);
        }
    }
}

/// Two counters, on an executor and a thread.
fn run(prepare: impl FnOnce(&mut System)) -> (Content, LoggingReport) {
    let kept = Kept::default();
    let mut system = System::new("counters");
    prepare(&mut system);
    system.log(Logging::to_sink(kept.clone()));
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(Counter::new("one", 20));
    system
        .thread("apart")
        .process("two")
        .spawn_ok(Counter::new("two", 10));
    let report = system.run().unwrap().logging.unwrap();
    let bytes = kept.0.lock().unwrap().clone();
    (content(&bytes), report)
}

fn counts(report: &LoggingReport) -> Vec<(&str, u64, u64)> {
    let signals = report.signals.iter();
    signals
        .map(|one| (&*one.name, one.recorded, one.lost))
        .collect()
}

const COUNTS: [(&str, u64, u64); 4] = [
    ("one/up", 21, 0),
    ("one/down", 20, 0),
    ("two/up", 11, 0),
    ("two/down", 10, 0),
];

#[test]
fn a_systems_signals_and_messages_are_in_its_recording() {
    let _watchdog = watchdog();
    let before = luna::now().as_nanos();
    let (content, report) = run(|_| ());
    let after = luna::now().as_nanos();
    assert_eq!(counts(&report), COUNTS);
    assert_eq!(
        content.signals,
        ["one/up", "one/down", "two/up", "two/down"]
    );
    assert_eq!(content.clock, Some(ClockBase::Monotonic));
    for thread in ["main", "apart"] {
        assert!(
            content.threads.iter().any(|name| name == thread),
            "{content:?}"
        );
    }
    let ups: Vec<f64> = content
        .samples
        .iter()
        .filter(|one| one.0 == 0)
        .map(|one| one.2)
        .collect();
    assert_eq!(ups, (1..=20).chain([0]).map(f64::from).collect::<Vec<_>>());
    // Two readings of two clocks may be a time slice apart.
    let slack = 20_000_000;
    assert!(
        content
            .samples
            .iter()
            .all(|one| one.1 + slack >= before && one.1 <= after + slack)
    );
    let mut said: Vec<_> = content
        .messages
        .iter()
        .map(|(_, text)| text.as_str())
        .collect();
    said.sort_unstable();
    assert_eq!(said, ["one is done", "two is done"]);
    assert!(content.messages.iter().all(|(process, _)| *process != 0));
    assert!(
        report
            .to_string()
            .contains("62 samples of 4 signals and 2 messages"),
        "{report}"
    );
}

#[test]
fn on_a_virtual_clock_times_are_virtual_and_each_recording_is_the_same() {
    let _watchdog = watchdog();
    let mut first = None;
    for _ in 0..3 {
        let (content, report) = run(|system| {
            system.virtual_clock();
        });
        assert_eq!(counts(&report), COUNTS);
        assert_eq!(content.clock, Some(ClockBase::Virtual));
        let origin = luna_platform::clock::VirtualClock::ORIGIN.as_nanos();
        let of_one = content.samples.iter().filter(|one| one.0 == 0);
        for (n, (_, time, value)) in of_one.take(20).enumerate() {
            let n = n as u64 + 1;
            assert_eq!((*time, *value), (origin + n * 1_000_000, n as f64));
        }
        let all = content.samples.clone();
        assert_eq!(*first.get_or_insert(all.clone()), all);
    }
}

#[test]
fn without_a_recording_signals_are_silent() {
    let _watchdog = watchdog();
    let mut system = System::new("silent");
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(Counter::new("one", 3));
    assert_eq!(system.run().unwrap().logging, None);
}

#[test]
fn bad_signals_and_files_stop_the_start() {
    let _watchdog = watchdog();
    let mut system = System::new("twice");
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(Counter::new("same", 1));
    main.process("two").spawn_ok(Counter::new("same", 2));
    let Err(Error::Process { name, source }) = system.run() else {
        panic!("it has started")
    };
    let expected = Error::Setup(SetupError::Signal(RegisterError::Duplicate {
        signal: "same/up".to_owned(),
    }));
    assert_eq!((name.as_str(), *source), ("two", expected));

    let of_a_replay_log = std::env::temp_dir().join("luna-logging.replay");
    for place in ["/no/such/folder/run.luna".as_ref(), &*of_a_replay_log] {
        let mut system = System::new("nowhere");
        system.log_to(place);
        let main = system.executor("main").build().unwrap();
        main.process("one").spawn_ok(async { Ok(()) });
        let error = system.run().unwrap_err();
        assert!(matches!(
            error,
            Error::Setup(SetupError::Logging(StartError::Sink { .. }))
        ));
    }
    assert!(!of_a_replay_log.exists());
}

#[test]
fn a_process_that_comes_late_registers_and_records() {
    let _watchdog = watchdog();
    let kept = Kept::default();
    let mut system = System::new("late");
    system.log(Logging::to_sink(kept.clone()));
    let main = system.executor("main").build().unwrap();
    let own = main.clone();
    main.process("parent").spawn_ok(async move {
        for name in ["first", "second"] {
            let id = own.process(name).spawn(Counter::new(name, 2))?;
            own.process_handle(id).unwrap().join().await;
        }
        Ok(())
    });
    let recording = system.run().unwrap().logging.unwrap();
    for name in ["first/up", "second/up"] {
        let signal = recording
            .signals
            .iter()
            .find(|one| one.name == name)
            .unwrap();
        assert_eq!((signal.recorded, signal.lost), (3, 0));
    }
}

/// The example of the contract, unchanged. The parent process that starts it records it.
#[cfg(unix)]
#[test]
fn the_examples_signal_is_in_its_recording() {
    use nix::sys::signal::{Signal as Number, kill};
    use nix::unistd::Pid;
    use std::path::Path;
    use std::process::{Command, Stdio};

    let Some(_watch) = with_signals() else { return };
    // Beside the folder of the tests.
    let own = std::env::current_exe().unwrap();
    let built = own.parent().and_then(Path::parent).unwrap();
    let example = built.join("examples/process_phases");
    if !example.exists() {
        eprintln!(
            "skipped: {} is not there; `cargo test` builds it",
            example.display()
        );
        return;
    }
    let name = format!("luna-process-phases-{}.luna", std::process::id());
    let file = std::env::temp_dir().join(name);
    let mut program = Command::new(example);
    program.env("LUNA_LOG", &file).stdout(Stdio::piped());
    let mut child = common::spawn(&mut program);
    // Until a good part of it is there; the file is read while it is written.
    loop {
        let bytes = std::fs::read(&file).unwrap_or_default();
        let mut samples = 0;
        if let Ok(mut reader) = Reader::new(&bytes[..]) {
            while let Ok(Some(record)) = reader.next() {
                samples += u32::from(matches!(record, Record::Sample { .. }));
            }
        }
        if samples >= 200 {
            break;
        }
        assert!(
            child.try_wait().unwrap().is_none(),
            "it has ended too early"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    kill(Pid::from_raw(child.id() as i32), Number::SIGTERM).unwrap();
    let output = child.wait_with_output().unwrap();
    let report = String::from_utf8(output.stdout).unwrap();
    assert!(report.contains("samples of 1 signal"), "{report}");
    let content = content(&std::fs::read(&file).unwrap());
    std::fs::remove_file(file).unwrap();
    assert_eq!(content.signals, ["drive/output"]);
    assert!(content.samples.len() >= 200);
    for (n, (_, _, value)) in content.samples.iter().enumerate() {
        assert_eq!(*value, (n as f64 * 0.001).sin());
    }
    assert!(content.samples.is_sorted_by_key(|(_, time, _)| *time));
}

/// The clock may be chosen after it, and the name is taken once.
#[test]
fn a_signal_is_declared_where_its_process_is_spawned() {
    let _watchdog = watchdog();
    let kept = Kept::default();
    let mut system = System::new("drive");
    let main = system.executor("main").build().unwrap();
    let drive = main.process("drive");
    let current = drive.signal("drive/current").unit("A").register().unwrap();
    let error = drive.signal::<f64>("drive/current").register().unwrap_err();
    let signal = "drive/current".to_owned();
    assert_eq!(error, RegisterError::Duplicate { signal });
    system.virtual_clock().log(Logging::to_sink(kept.clone()));
    current.record(7.0); // Nothing is recorded yet.
    drive.spawn_ok(async move {
        let mut tick = luna::periodic("drive", Duration::from_millis(1))?;
        for n in 1..=3 {
            tick.next().await;
            current.record(f64::from(n));
        }
        Ok(())
    });
    system.run().unwrap();
    let content = content(&kept.0.lock().unwrap());
    assert_eq!(content.clock, Some(ClockBase::Virtual));
    assert_eq!(content.signals, ["drive/current"]);
    let ms = |n: u64| n * 1_000_000;
    let times: Vec<_> = content.samples.iter().map(|s| (s.1, s.2)).collect();
    let start = times[0].0;
    assert_eq!(
        times,
        [(start, 1.0), (start + ms(1), 2.0), (start + ms(2), 3.0)]
    );
}

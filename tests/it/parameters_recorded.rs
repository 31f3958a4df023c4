//! A run that replaces parameters is recorded and replayed, and its sets are messages of its log.

use crate::common;
use common::{SpawnOk, TempFile, watchdog};
use luna::Error;
use luna::parameters::Parameters;
use luna::parameters::SetError;
use luna::prelude::*;
use luna::replay::{self, RecordError, Recording};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Gives out what it reads, until it has read so many different ones.
struct Reads {
    name: &'static str,
    /// Takes by a loop, or by hand.
    by_loop: bool,
    gain: Parameter<f64>,
    list: Parameter<[u32; 3]>,
    seen: Arc<Mutex<Seen>>,
    done: Arc<AtomicU64>,
}

impl Process for Reads {
    async fn run(&mut self) -> luna::Result<()> {
        let Self { gain, list, .. } = self;
        let mut tick = luna::periodic(self.name, Duration::from_micros(300))?;
        let mut changes = 0;
        let mut last = (gain.get(), list.get());
        self.seen.lock().unwrap().push(last);
        while changes < 5 {
            if self.by_loop {
                tick.next().await;
            } else {
                luna::after(Duration::from_micros(300)).await;
                gain.latch();
            }
            let now = (gain.get(), list.get());
            replay::output("gain", &now.0);
            if now != last {
                changes += 1;
                self.seen.lock().unwrap().push(now);
            }
            last = now;
        }
        self.done.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }
}

/// The values that a process has read, in their order.
type Seen = Vec<(f64, [u32; 3])>;

/// What both processes have read.
type BothSeen = [Arc<Mutex<Seen>>; 2];

fn system() -> luna::Result<(System, BothSeen, Arc<AtomicU64>)> {
    let mut system = System::new("recorded");
    let seen = BothSeen::default();
    let done = Arc::new(AtomicU64::new(0));
    for ((name, by_loop), seen) in [("left", true), ("right", false)].into_iter().zip(&seen) {
        let executor = system.executor(name).build()?;
        let process = executor.process(name);
        let named = |part: &str| format!("{name}/{part}");
        let gain = process
            .parameter(&named("gain"), 1.0)
            .unit("V")
            .register()?;
        let list = process.parameter(&named("list"), [0; 3]).register()?;
        process.spawn(Reads {
            name,
            by_loop,
            gain,
            list,
            seen: seen.clone(),
            done: done.clone(),
        })?;
    }
    Ok((system, seen, done))
}

/// Sets both processes' parameters from a plain thread, at unforeseeable moments, until both have
/// seen enough.
fn sets_until(parameters: &Parameters, done: &AtomicU64) {
    let mut value = 0_u32;
    while done.load(Ordering::Relaxed) < 2 {
        value += 1;
        let of = |name: &str| {
            let list = [value, value + 1, value + 2];
            format!("{name}/gain={value}.5,{name}/list={list:?}")
        };
        match parameters.set_text(&format!("{},{}", of("left"), of("right"))) {
            Ok(_) | Err(SetError::NotRunning { .. }) => std::thread::yield_now(),
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn a_replay_reads_what_was_read() {
    let _watch = watchdog();
    let file = TempFile::new("run");
    let (mut recorded, seen, done) = system().unwrap();
    recorded.record(&file.0).set_parameter("left/gain", 0.1);
    let parameters = recorded.parameters();
    let until = done.clone();
    let setter = std::thread::spawn(move || sets_until(&parameters, &until));
    let outcome = recorded.run();
    done.store(2, Ordering::Relaxed);
    setter.join().unwrap();
    assert_eq!(outcome.unwrap().record.unwrap().lost, 0);
    let seen = seen.map(|seen| seen.lock().unwrap().clone());
    assert_eq!([seen[0][0].0, seen[1][0].0], [0.1, 1.0]);

    let recording = Recording::open(&file.0).unwrap();
    for _ in 0..2 {
        let (mut replayed, again, _) = system().unwrap();
        // The replay ignores sets from outside.
        replayed
            .replay(&recording)
            .set_parameter("left/gain", 77.0)
            .parameters_from("/nowhere/x.toml");
        let parameters = replayed.parameters();
        let is_over = Arc::new(AtomicBool::new(false));
        let ends = is_over.clone();
        let tries = std::thread::spawn(move || {
            loop {
                match parameters.set([("left/gain", 5.0)]) {
                    Err(SetError::Replayed) => return,
                    // The replay may be over before it is asked.
                    Err(SetError::NotRunning { .. }) if ends.load(Ordering::Relaxed) => return,
                    Err(SetError::NotRunning { .. }) => std::thread::yield_now(),
                    other => panic!("{other:?}"),
                }
            }
        });
        let outcome = replayed.run();
        is_over.store(true, Ordering::Relaxed);
        outcome.unwrap();
        tries.join().unwrap();
        assert_eq!(again.map(|seen| seen.lock().unwrap().clone()), seen);
    }
}

#[test]
fn what_a_recorded_process_asks_of_all_parameters_is_refused_by_its_name() {
    let _watch = watchdog();
    let file = TempFile::new("outside");
    let mut system = System::new("outside");
    system.record(&file.0);
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    main.process("looks").spawn_ok(async move {
        assert!(parameters.list().is_empty());
        Ok(())
    });
    match system.run() {
        Err(Error::Record(RecordError::Outside { process, construct })) => {
            assert_eq!(
                (process.as_str(), construct.as_str()),
                ("looks", "Parameters::list")
            );
        }
        other => panic!("{other:?}"),
    }
}

#[cfg(feature = "logger")]
#[test]
fn a_set_that_is_taken_is_a_message_for_each_value_that_changes() {
    use luna_logger::format::{Reader, Record};
    let _watch = watchdog();
    let file = TempFile::new("log");
    let mut system = System::new("log");
    system
        .virtual_clock()
        .log_to(&file.0)
        .set_parameter("pan/kp", 2.5);
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let axis = main.process("axis");
    let mut declared = Vec::new();
    for (name, default, unit) in [
        ("pan/kp", 2.0, "1/rad"),
        ("pan/ki", 0.5, ""),
        ("pan/kd", 0.1, ""),
    ] {
        let parameter = axis.parameter(name, default).unit(unit);
        declared.push(parameter.register().unwrap());
    }
    axis.spawn_ok(async move {
        let _declared = declared;
        luna::after(Duration::from_secs(1)).await;
        parameters.set([("pan/kp", 3.0), ("pan/ki", 0.5), ("pan/kd", 0.25)])?;
        assert!(parameters.set([("pan/kp", 4.0), ("pan/kq", 0.5)]).is_err());
        luna::after(Duration::from_secs(1)).await;
        parameters.reload().unwrap_err();
        parameters.set([("pan/ki", 7)])?;
        Ok(())
    });
    system.run().unwrap();
    let bytes = std::fs::read(&file.0).unwrap();
    let mut reader = Reader::new(&bytes[..]).unwrap();
    let mut reported = Vec::new();
    while let Some(record) = reader.next().unwrap() {
        if let Record::Message {
            time, target, text, ..
        } = record
        {
            assert_eq!(target, "parameters");
            reported.push((time / 1_000_000_000, text.to_owned()));
        }
    }
    let start = reported[0].0;
    reported.iter_mut().for_each(|(time, _)| *time -= start);
    let expected = [
        (0, "set 0: pan/kp 2.0 -> 2.5 1/rad"),
        (1, "set 1: pan/kp 2.5 -> 3.0 1/rad"),
        (1, "set 1: pan/kd 0.1 -> 0.25"),
        (2, "set 2: pan/ki 0.5 -> 7.0"),
    ];
    assert_eq!(
        reported,
        expected.map(|(time, text)| (time, text.to_owned()))
    );
}

//! What threads record is in the recording, with its time, or is counted as lost, exactly.

use crate::common;
use common::{KeepingSink, Kept};
use luna_logger::format::{Tally, Value};
use luna_logger::{
    FileSink, Hub, Level, Logging, Recorder, RegisterError, Signal, Sink, StartError, Tee, message,
};
use luna_platform::clock::Instant;
use proptest::prelude::*;
use std::io;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

fn floats(values: &[(u64, Vec<Value>)]) -> Vec<f64> {
    values
        .iter()
        .map(|(_, values)| values[0].as_f64())
        .collect()
}

#[test]
fn samples_have_their_values_and_the_times_of_their_recording() {
    let kept = Kept::default();
    let hub = Hub::new("smoke", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(kept.sink())).unwrap();
    let _inside = hub.enter();
    let angle = Signal::<f64>::with_unit("angle", "rad")
        .description("of the arm")
        .register()
        .unwrap();
    let at = Signal::<[i32; 3]>::register("at").unwrap();
    let mut between = Vec::new();
    for n in 0..100 {
        let before = Instant::now_real();
        angle.record(f64::from(n) / 4.0);
        between.push((before, Instant::now_real()));
        at.record([n, -n, i32::MIN]);
    }
    let report = recorder.finish();
    let counts: Vec<_> = report
        .signals
        .iter()
        .map(|one| (one.name.as_str(), one.recorded, one.lost))
        .collect();
    assert_eq!(counts, [("angle", 100, 0), ("at", 100, 0)]);
    assert_eq!(report.bytes, kept.bytes().len() as u64);

    let read = kept.read();
    assert_eq!(read.system, "smoke");
    // One more each ten seconds.
    assert!(read.epochs >= 1);
    let expected: Vec<_> = (0..100).map(|n| f64::from(n) / 4.0).collect();
    assert_eq!(floats(&read.samples[&0]), expected);
    assert_eq!(
        read.samples[&1][7].1,
        [
            Value::Signed(7),
            Value::Signed(-7),
            Value::Signed(i32::MIN.into())
        ]
    );
    assert!(read.times.is_sorted());
    for ((time, _), (before, after)) in read.samples[&0].iter().zip(between) {
        // An interrupted reading of both clocks is off by a time slice at most.
        let most = Duration::from_millis(20);
        let time = Instant::from_nanos(*time);
        assert!(
            time + most >= before && time <= after + most,
            "{time:?} {before:?} {after:?}"
        );
    }
}

#[test]
fn while_nothing_records_there_is_nothing() {
    let hub = Hub::new("silent", Default::default());
    let _inside = hub.enter();
    let signal = Signal::<u8>::register("signal").unwrap();
    signal.record(1);
    let kept = Kept::default();
    let recorder = Recorder::start(&hub, Logging::to_sink(kept.sink())).unwrap();
    signal.record(2);
    let report = recorder.finish();
    signal.record(3);
    assert_eq!((report.signals[0].recorded, report.signals[0].lost), (1, 0));
    assert_eq!(floats(&kept.read().samples[&0]), [2.0]);
    let again = Recorder::start(&hub, Logging::to_sink(kept.sink()));
    assert_eq!(again.unwrap_err(), StartError::Twice);
}

#[test]
fn a_signal_is_registered_inside_of_a_hub_alone() {
    let refused = || {
        let error = Signal::<f64>::register("flow").unwrap_err();
        let signal = "flow".to_owned();
        assert_eq!(error, RegisterError::NotInPreRun { signal });
    };
    refused();
    let hub = Hub::new("pump", Default::default());
    let kept = Kept::default();
    let recorder = Recorder::start(&hub, Logging::to_sink(kept.sink())).unwrap();
    // Such a thread records, and registers nothing.
    hub.enter_thread();
    refused();
    let inside = hub.enter();
    let nested = hub.enter();
    drop(nested);
    let flow = Signal::<f64>::register("flow").unwrap();
    drop(inside);
    refused();
    flow.record(3.0);
    let report = recorder.finish();
    assert_eq!(report.signals.len(), 1);
    assert_eq!((report.signals[0].recorded, report.signals[0].lost), (1, 0));
    assert_eq!(floats(&kept.read().samples[&0]), [3.0]);
}

#[test]
fn bad_registrations_say_what_to_do() {
    let register = |name: &str, unit: &str| Signal::<f32>::with_unit(name, unit).register();
    // Errors do not depend on a system.
    assert_eq!(register("", "").unwrap_err(), RegisterError::NoName);
    let long = "x".repeat(64);
    assert!(matches!(
        register("nowhere", &long),
        Err(RegisterError::TooLong { what: "unit", .. })
    ));
    let hub = Hub::new("names", Default::default());
    let _inside = hub.enter();
    let first = register("one", "m").unwrap();
    let second = first.clone();
    drop(first);
    assert!(matches!(
        register("one", "m"),
        Err(RegisterError::Duplicate { .. })
    ));
    drop(second);
    // A restarted process continues its signal, but the signal must be the same.
    assert!(matches!(
        register("one", "s"),
        Err(RegisterError::Duplicate { .. })
    ));
    assert!(register("one", "m").is_ok());
    assert_eq!(register("", "m").unwrap_err(), RegisterError::NoName);
    assert!(matches!(
        register(&"x".repeat(256), "m"),
        Err(RegisterError::TooLong { most: 255, .. })
    ));
    assert!(matches!(
        register("x", &"m".repeat(64)),
        Err(RegisterError::TooLong { most: 63, .. })
    ));
}

#[test]
fn a_file_that_cannot_be_made_is_an_error() {
    let hub = Hub::new("nowhere", Default::default());
    let error = Recorder::start(&hub, Logging::to_file("/no/such/folder/run.luna")).unwrap_err();
    assert!(
        matches!(&error, StartError::Sink { to, .. } if to == "/no/such/folder/run.luna"),
        "{error}"
    );
    assert!(!hub.is_recording());
}

/// Takes a block when permitted; reports when it waits for that.
struct Gated {
    kept: KeepingSink,
    waits: Sender<()>,
    gate: Receiver<()>,
}

impl Sink for Gated {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.kept.begin(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        let _ = self.waits.send(());
        // Open for good when the other end is gone.
        let _ = self.gate.recv();
        self.kept.block(block)
    }
}

/// The sink, its permits, and its reports that it waits.
fn gated(kept: &Kept) -> (Sender<()>, Receiver<()>, Gated) {
    let (open, gate) = channel();
    let (waits, waiting) = channel();
    let kept = kept.sink();
    (open, waiting, Gated { kept, waits, gate })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20, failure_persistence: None, ..ProptestConfig::default() })]

    /// A sink stalls while threads record more than their rings hold: no thread waits for it, and
    /// losses are counted exactly.
    #[test]
    fn sent_and_lost_are_all_that_was_produced(
        room in 20usize..400,
        produced in prop::collection::vec(0u64..2000, 1..4),
        blocks in 0usize..6,
    ) {
        let kept = Kept::default();
        let hub = Hub::new("stalled", Default::default());
        let (open, _, sink) = gated(&kept);
        let recording = Logging::to_sink(sink).room_for_samples(room).every(Duration::from_millis(1));
        let recorder = Recorder::start(&hub, recording).unwrap();
        let signals: Vec<_> = {
            let _inside = hub.enter();
            (0..produced.len()).map(|n| Signal::<u64>::register(&format!("signal {n}")).unwrap()).collect()
        };
        std::thread::scope(|scope| {
            for (signal, count) in signals.iter().zip(&produced) {
                let (hub, open) = (&hub, &open);
                scope.spawn(move || {
                    hub.enter_thread();
                    for n in 0..*count {
                        signal.record(n);
                        if n.is_multiple_of(300) && n / 300 < blocks as u64 {
                            open.send(()).unwrap();
                        }
                    }
                });
            }
        });
        drop(open);
        let report = recorder.finish();
        let read = kept.read();
        for (index, produced) in produced.into_iter().enumerate() {
            let one = &report.signals[index];
            prop_assert_eq!(one.recorded + one.lost, produced);
            let values = read.samples.get(&(index as u32)).map(|all| floats(all)).unwrap_or_default();
            prop_assert_eq!(values.len() as u64, one.recorded);
            // In order, none twice, and the first ones, for which there was room, complete.
            prop_assert!(values.is_sorted_by(|a, b| a < b));
            let first = values.iter().take(room.min(values.len())).enumerate();
            for (n, value) in first {
                prop_assert_eq!(*value, n as f64);
            }
            prop_assert_eq!(read.lost.get(&(index as u32)).copied().unwrap_or(0), one.lost);
        }
    }

    /// A sink refuses some blocks, as on a full disk: their contents count as lost, and the rest
    /// can be read.
    #[test]
    fn what_a_sink_refuses_is_counted(refused in prop::collection::vec(prop::bool::ANY, 0..40)) {
        struct Refusing(KeepingSink, std::vec::IntoIter<bool>);
        impl Sink for Refusing {
            fn begin(&mut self, head: &[u8]) -> io::Result<()> {
                self.0.begin(head)
            }
            fn block(&mut self, block: &[u8]) -> io::Result<()> {
                match self.1.next() {
                    Some(true) => Err(io::Error::other("no space left")),
                    _ => self.0.block(block),
                }
            }
        }
        let has_refused = refused.contains(&true);
        let kept = Kept::default();
        let hub = Hub::new("refused", Default::default());
        let sink = Refusing(kept.sink(), refused.into_iter());
        let recorder = Recorder::start(&hub, Logging::to_sink(sink).every(Duration::from_millis(1))).unwrap();
        let _inside = hub.enter();
        let signal = Signal::<[f64; 16]>::register("wide").unwrap();
        // Several blocks, however the rounds fall.
        let produced = 3_000;
        for n in 0..produced {
            signal.record([n as f64; 16]);
            if n % 100 == 0 {
                message(Level::Info, "test", format_args!("{n}"));
            }
        }
        let report = recorder.finish();
        // The last block may be one of them.
        let (read, error) = common::read(&kept.bytes());
        prop_assert!(error.is_none(), "{error:?}");
        let one = &report.signals[0];
        prop_assert_eq!(one.recorded + one.lost, produced);
        prop_assert_eq!(read.samples.get(&0).map_or(0, Vec::len) as u64, one.recorded);
        prop_assert_eq!(report.messages.recorded + report.messages.lost, produced / 100);
        prop_assert_eq!(read.messages.len() as u64, report.messages.recorded);
        if !has_refused {
            prop_assert!(report.error.is_none());
        }
    }
}

#[test]
fn messages_that_a_sink_refuses_are_counted_in_the_recording() {
    /// Refuses each block with a message of the test in it.
    struct Picky(KeepingSink);
    const MARK: &[u8] = b"refuse this";
    impl Sink for Picky {
        fn begin(&mut self, head: &[u8]) -> io::Result<()> {
            self.0.begin(head)
        }
        fn block(&mut self, block: &[u8]) -> io::Result<()> {
            if block.windows(MARK.len()).any(|part| part == MARK) {
                return Err(io::Error::other("no space left"));
            }
            self.0.block(block)
        }
    }
    let kept = Kept::default();
    let hub = Hub::new("refused", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(Picky(kept.sink()))).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<[f64; 16]>::register("wide").unwrap();
    for n in 0..1_000 {
        signal.record([f64::from(n); 16]);
        if n % 200 == 0 {
            message(Level::Info, "test", format_args!("refuse this: {n}"));
        }
    }
    let report = recorder.finish();
    // In how many blocks they came is the recorder's affair.
    assert_eq!((report.messages.recorded, report.messages.lost), (0, 5));
    assert_eq!(report.error.as_deref(), Some("no space left"));
    let read = kept.read();
    assert!(read.messages.is_empty());
    assert_eq!(read.lost_messages.values().sum::<u64>(), 5);
    let one = &report.signals[0];
    assert_eq!(one.recorded + one.lost, 1_000);
    assert_eq!(read.lost.get(&0).copied().unwrap_or(0), one.lost);
    assert_eq!(
        read.samples.get(&0).map_or(0, Vec::len) as u64,
        one.recorded
    );
}

#[test]
fn a_burst_of_messages_costs_no_samples() {
    let kept = Kept::default();
    let hub = Hub::new("burst", Default::default());
    let (open, waiting, sink) = gated(&kept);
    let recording = Logging::to_sink(sink).room_for_messages(1000);
    let recorder = Recorder::start(&hub, recording).unwrap();
    // From here on nothing is moved out of the rings.
    waiting.recv().unwrap();
    let _inside = hub.enter();
    let signal = Signal::<bool>::register("signal").unwrap();
    for n in 0..1000 {
        message(Level::Debug, "burst", format_args!("number {n}"));
        signal.record(n % 2 == 0);
    }
    drop(open);
    let report = recorder.finish();
    assert_eq!(
        (report.signals[0].recorded, report.signals[0].lost),
        (1000, 0)
    );
    assert!(report.messages.lost > 900, "{:?}", report.messages);
    assert_eq!(report.messages.recorded + report.messages.lost, 1000);
}

#[test]
fn a_sink_that_never_returns_delays_the_end_for_a_limited_time() {
    let kept = Kept::default();
    let hub = Hub::new("stuck", Default::default());
    let (open, waiting, sink) = gated(&kept);
    let recording = Logging::to_sink(sink).end_within(Duration::from_millis(1));
    let recorder = Recorder::start(&hub, recording).unwrap();
    waiting.recv().unwrap();
    let _inside = hub.enter();
    let signal = Signal::<f64>::register("signal").unwrap();
    for n in 0..100 {
        signal.record(f64::from(n));
    }
    message(Level::Info, "test", format_args!("lost too"));
    let report = recorder.finish();
    assert_eq!(
        (report.signals[0].recorded, report.signals[0].lost),
        (0, 100)
    );
    assert_eq!((report.messages.recorded, report.messages.lost), (0, 1));
    assert!(report.error.unwrap().contains("time limit"));
    drop(open);
}

#[test]
fn a_sink_that_panics_costs_what_it_was_given() {
    struct Panicking;
    impl Sink for Panicking {
        fn begin(&mut self, _: &[u8]) -> io::Result<()> {
            Ok(())
        }
        fn block(&mut self, _: &[u8]) -> io::Result<()> {
            panic!("on purpose");
        }
    }
    let hub = Hub::new("panicking", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(Panicking)).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<f64>::register("signal").unwrap();
    signal.record(1.0);
    let report = recorder.finish();
    assert_eq!((report.signals[0].recorded, report.signals[0].lost), (0, 1));
    assert_eq!(report.error.as_deref(), Some("the sink panicked"));
}

/// Takes blocks and loses them, as a sink without acknowledgements; panics at a block that contains
/// `PANIC`.
struct Unacknowledged {
    held: Tally,
    lost: Tally,
    taken: Sender<u64>,
}

const PANIC: &[u8] = b"panic now";

impl Sink for Unacknowledged {
    fn begin(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }
    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.held.add(block);
        if block.windows(PANIC.len()).any(|part| part == PANIC) {
            panic!("on purpose");
        }
        let _ = self.taken.send(self.held.samples.values().sum());
        Ok(())
    }
    fn take_lost(&mut self) -> Tally {
        std::mem::take(&mut self.lost)
    }
    fn end(&mut self, _: Duration) -> io::Result<()> {
        self.lost = std::mem::take(&mut self.held);
        Ok(())
    }
}

#[test]
fn a_sink_that_panics_reports_what_it_had_taken_and_lost() {
    let (taken, takes) = channel();
    let sink = Unacknowledged {
        held: Tally::default(),
        lost: Tally::default(),
        taken,
    };
    let hub = Hub::new("panicking", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(sink)).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<u64>::register("signal").unwrap();
    let record = |numbers: std::ops::Range<u64>| numbers.for_each(|n| signal.record(n));
    record(0..50);
    // It has taken these, and they count as recorded.
    assert!(takes.iter().any(|samples| samples == 50));
    record(50..80);
    message(Level::Info, "test", format_args!("panic now"));
    // It has panicked.
    takes.iter().for_each(drop);
    record(80..100);
    let report = recorder.finish();
    assert_eq!(
        (report.signals[0].recorded, report.signals[0].lost),
        (0, 100)
    );
    assert_eq!((report.messages.recorded, report.messages.lost), (0, 1));
    assert_eq!(report.error.as_deref(), Some("the sink panicked"));
}

#[test]
fn another_sink_that_panics_costs_the_first_nothing() {
    let kept = Kept::default();
    let (taken, takes) = channel();
    let panicking = Unacknowledged {
        held: Tally::default(),
        lost: Tally::default(),
        taken,
    };
    let tee = Tee::new(kept.sink()).and(panicking);
    let refused = tee.refused();
    let hub = Hub::new("panicking", Default::default());
    let recorder = Recorder::start(&hub, Logging::to_sink(tee)).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<f64>::register("signal").unwrap();
    message(Level::Info, "test", format_args!("panic now"));
    // It has panicked, and is gone.
    takes.iter().for_each(drop);
    signal.record(1.0);
    let report = recorder.finish();
    assert_eq!((report.signals[0].recorded, report.signals[0].lost), (1, 0));
    assert_eq!((report.messages.recorded, &report.error), (1, &None));
    assert_eq!(kept.read().samples[&0].len(), 1);
    assert!(refused[0].load(std::sync::atomic::Ordering::Relaxed) > 0);
}

#[test]
fn a_sink_that_cannot_take_a_block_yet_is_offered_it_again() {
    struct Hesitant(KeepingSink, u32);
    impl Sink for Hesitant {
        fn begin(&mut self, head: &[u8]) -> io::Result<()> {
            self.0.begin(head)
        }
        fn block(&mut self, block: &[u8]) -> io::Result<()> {
            self.1 += 1;
            match self.1 % 3 {
                0 => self.0.block(block),
                _ => Err(io::ErrorKind::WouldBlock.into()),
            }
        }
    }
    let kept = Kept::default();
    let hub = Hub::new("hesitant", Default::default());
    let recording = Logging::to_sink(Hesitant(kept.sink(), 0)).end_within(Duration::from_secs(600));
    let recorder = Recorder::start(&hub, recording).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<f64>::register("signal").unwrap();
    for n in 0..1000 {
        signal.record(f64::from(n));
    }
    let report = recorder.finish();
    assert_eq!(
        (report.signals[0].recorded, report.signals[0].lost),
        (1000, 0)
    );
    assert_eq!(kept.read().samples[&0].len(), 1000);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10, failure_persistence: None, ..ProptestConfig::default() })]

    /// Of several sinks the first decides what is recorded. Another that refuses some blocks has
    /// the rest, and it can be read.
    #[test]
    fn several_sinks_get_one_recording(refused in prop::collection::vec(prop::bool::ANY, 1..20)) {
        struct Refusing(KeepingSink, std::vec::IntoIter<bool>);
        impl Sink for Refusing {
            fn begin(&mut self, head: &[u8]) -> io::Result<()> {
                self.0.begin(head)
            }
            fn block(&mut self, block: &[u8]) -> io::Result<()> {
                match self.1.next() {
                    Some(true) => Err(io::Error::other("no space left")),
                    _ => self.0.block(block),
                }
            }
        }
        let any = refused.contains(&true);
        let kept = [Kept::default(), Kept::default(), Kept::default()];
        let tee = Tee::new(kept[0].sink())
            .and(Refusing(kept[1].sink(), refused.into_iter()))
            .and(kept[2].sink());
        let counters = tee.refused();
        let hub = Hub::new("tee", Default::default());
        let recorder = Recorder::start(&hub, Logging::to_sink(tee).every(Duration::from_millis(1))).unwrap();
        let _inside = hub.enter();
        let signal = Signal::<[f64; 16]>::register("wide").unwrap();
        for n in 0..3000 {
            signal.record([f64::from(n); 16]);
        }
        let report = recorder.finish();
        prop_assert_eq!((report.signals[0].recorded, report.signals[0].lost), (3000, 0));
        for whole in [&kept[0], &kept[2]] {
            prop_assert_eq!(whole.read().samples[&0].len(), 3000);
        }
        let (some, error) = common::read(&kept[1].bytes());
        prop_assert!(error.is_none(), "{error:?}");
        let missing = counters[0].load(std::sync::atomic::Ordering::Relaxed);
        prop_assert_eq!(counters[1].load(std::sync::atomic::Ordering::Relaxed), 0);
        if missing == 0 {
            prop_assert!(some.has_ended && some.samples[&0].len() == 3000);
        }
        prop_assert!(any || missing == 0);
    }
}

#[test]
fn a_file_that_is_brought_to_the_disk_is_as_any_other() {
    let file = std::env::temp_dir().join(format!("luna-logger-sync-{}.luna", std::process::id()));
    let hub = Hub::new("sync", Default::default());
    let recording = Logging::to_file(&file).sync_every(Duration::ZERO);
    let recorder = Recorder::start(&hub, recording).unwrap();
    let _inside = hub.enter();
    let signal = Signal::<f64>::register("signal").unwrap();
    signal.record(1.0);
    let report = recorder.finish();
    assert_eq!((&report.error, report.signals[0].recorded), (&None, 1));
    assert!(
        report
            .to_string()
            .starts_with("recorded 1 sample of 1 signal and 0 messages to "),
        "{report}"
    );
    let (content, error) = common::read(&std::fs::read(&file).unwrap());
    std::fs::remove_file(file).unwrap();
    assert!(error.is_none() && content.has_ended);
}

#[test]
fn a_device_without_room_is_an_error_at_the_start() {
    let Ok(sink) = FileSink::create("/dev/full".as_ref()) else {
        eprintln!("skipped: there is no /dev/full");
        return;
    };
    let hub = Hub::new("full", Default::default());
    let error = Recorder::start(&hub, Logging::to_sink(sink)).unwrap_err();
    assert!(matches!(error, StartError::Sink { .. }));
}

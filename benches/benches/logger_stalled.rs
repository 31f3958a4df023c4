//! `logger_stalled`: a million samples a second for a minute (a second with `--quick`), to a slow
//! disk, to a recorder over TCP that stalls, and to an absent recorder: the path never waits, and
//! losses are counted exactly.
//!
//! It prints the numbers of samples produced, recorded and lost, which must add up, and the longest
//! `record`, as seen by its thread: under SCHED_FIFO where permitted, so that it mostly shows
//! interrupts. Compared with the same loop without a recording, which shows the machine's
//! influence.

use std::{
    io,
    net::TcpListener,
    sync::Arc,
    time::{Duration, Instant},
};

use luna_benches::{cores::one_core, harness::is_quick};
use luna_logger::{
    FileSink, Handler, Hub, Logging, LoggingReport, Peer, Receiver, Recorder, Signal, Sink,
};
use luna_platform::thread::{Attributes, Policy, apply_to_current};

/// Samples of a burst, and from one burst to the next.
const BURST: u64 = 1000;
const PERIOD: Duration = Duration::from_millis(1);
/// Bytes a second that the slow disk takes: a tenth of what is written.
const SLOW: f64 = 1e6;

fn length() -> Duration {
    match is_quick() {
        true => Duration::from_secs(1),
        false => Duration::from_secs(60),
    }
}

/// A file that takes a megabyte a second.
struct Slow(FileSink);

impl Sink for Slow {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.0.begin(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        std::thread::sleep(Duration::from_secs_f64(block.len() as f64 / SLOW));
        self.0.block(block)
    }
}

/// A recorder that takes a sender, and none of its blocks.
struct Standing;

impl Handler for Standing {
    fn open(&self, _: &Peer) -> io::Result<Box<dyn Sink>> {
        Ok(Box::new(Standing))
    }
}

impl Sink for Standing {
    fn begin(&mut self, _: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn block(&mut self, _: &[u8]) -> io::Result<()> {
        loop {
            std::thread::park();
        }
    }
}

struct Run {
    produced: u64,
    /// The longest call, and how many took longer than 10 µs.
    worst: Duration,
    long: u64,
    elapsed: Duration,
    report: Option<LoggingReport>,
    policy: &'static str,
}

/// A million samples a second, on a thread of its own.
fn produce(recording: Option<Logging>) -> Run {
    let hub = Hub::new("bench", Default::default());
    let recorder =
        recording.map(|recording| Recorder::start(&hub, recording).expect("it can be recorded"));
    let inside = hub.clone();
    let thread = std::thread::spawn(move || {
        core_affinity::set_for_current(one_core());
        let attributes = Attributes::new("producer").policy(Policy::fifo(80));
        let is_urgent =
            apply_to_current(&attributes).is_ok_and(|obtained| obtained.policy == Policy::fifo(80));
        inside.enter_thread();
        let registering = inside.enter();
        let signal = Signal::<f64>::register("signal").expect("the name is free");
        drop(registering);
        let begin = Instant::now();
        let mut next = begin;
        let (mut produced, mut worst, mut long) = (0, Duration::ZERO, 0);
        while begin.elapsed() < length() {
            for _ in 0..BURST {
                let before = Instant::now();
                signal.record(produced as f64);
                let took = before.elapsed();
                worst = worst.max(took);
                long += u64::from(took > Duration::from_micros(10));
                produced += 1;
            }
            next += PERIOD;
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
        }
        Run {
            produced,
            worst,
            long,
            elapsed: begin.elapsed(),
            report: None,
            policy: if is_urgent {
                "SCHED_FIFO"
            } else {
                "no real-time policy"
            },
        }
    });
    let mut run = thread.join().expect("it only records");
    run.report = recorder.map(Recorder::finish);
    run
}

fn show(what: &str, run: &Run) {
    let (recorded, lost) = match &run.report {
        Some(report) => (report.signals[0].recorded, report.lost_samples()),
        None => (0, 0),
    };
    if run.report.is_some() {
        assert_eq!(recorded + lost, run.produced, "{what}");
    }
    println!(
        "{what:<40} {:>10} produced in {:>5.1} s, {recorded:>10} recorded, {lost:>10} lost; one record took at most {:.1} us, {} took longer than 10 us ({})",
        run.produced,
        run.elapsed.as_secs_f64(),
        run.worst.as_secs_f64() * 1e6,
        run.long,
        run.policy
    );
}

fn main() {
    show("not recording", &produce(None));
    let file = std::env::temp_dir().join(format!("luna-bench-stalled-{}", std::process::id()));
    show("a file", &produce(Some(Logging::to_file(&file))));
    let slow = Slow(FileSink::create(&file).expect("the folder can be written to"));
    show("a disk of 1 MB/s", &produce(Some(Logging::to_sink(slow))));
    std::fs::remove_file(file).expect("it was made");
    let receiver = Receiver::tcp("127.0.0.1:0").expect("there is a loopback");
    let address = receiver.address().to_string();
    // Its sink never comes back, so it is never stopped.
    std::mem::forget(
        receiver
            .start(Arc::new(Standing))
            .expect("there is room for a thread"),
    );
    show(
        "TCP, the recorder takes no block",
        &produce(Some(Logging::to_tcp(address))),
    );
    // The program does not accept, but the kernel does.
    let listener = TcpListener::bind("127.0.0.1:0").expect("there is a loopback");
    let address = listener.local_addr().expect("it is bound").to_string();
    show(
        "TCP, the peer says nothing",
        &produce(Some(Logging::to_tcp(address))),
    );
}

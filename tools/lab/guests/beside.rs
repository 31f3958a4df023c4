//! What still works beside an executor that never sleeps.
//!
//! ```text
//! beside MODE [CORE] [CYCLES]
//! ```
//!
//! The executor runs under SCHED_FIFO 80 on the core: a 1 kHz loop at level 20, the subject at level
//! 10, and a process at level 1 that always can run. What is beside it is an ordinary thread, on
//! another core if there is one. The mode is the subject. `udp`, `tcp`, `pipe`: the thread sends a
//! record every 10 ms, and the subject sends it back. `logger`: a recording of the loop. `scope`:
//! the thread asks for the scope's page. `blocking`: the subject has closures run on a buddy
//! thread. `emergency`: the subject raises one after half of the cycles. `signal`: a thread of
//! SCHED_FIFO 90 sends SIGTERM then. `TERM`: an ordinary thread sends it.
//!
//! The program prints what came through, and how late, and the report. A run without an end shows
//! that something did not.

use luna::external::{Framing, input, output};
use luna::prelude::*;
use luna::system::Executor;
use luna::{blocking, now, yield_now};
use luna_links::{reader, tcp, udp, writer};
use luna_logger::Logging;
use luna_platform::thread::{Attributes, available_cores, spawn};
use nix::sys::signal::{SigSet, Signal, kill};
use nix::unistd::Pid;
use std::convert::Infallible;
use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
const TALK: Duration = Duration::from_millis(10);
/// When it was sent, in nanoseconds.
type Record = [u8; 8];
/// Of the thread beside the executor.
type Body = Box<dyn FnOnce() -> io::Result<()> + Send>;
const FRAMING: Framing = Framing::fixed(8);
const PACKETS: Framing = Framing::packets(8);
const ANY: &str = "127.0.0.1:0";

/// How often something came, and how late at most.
#[derive(Debug, Default)]
struct Came {
    count: AtomicU64,
    latest: AtomicU64,
}

impl Came {
    fn note(&self, since: u64) {
        let late = now().as_nanos().saturating_sub(since);
        self.count.fetch_add(1, Ordering::Relaxed);
        self.latest.fetch_max(late, Ordering::Relaxed);
    }
}

impl fmt::Display for Came {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let latest = self.latest.load(Ordering::Relaxed) as f64 / 1000.0;
        let count = self.count.load(Ordering::Relaxed);
        write!(f, "{count} (latest {latest:.1} us)")
    }
}

/// What is seen of a run.
#[derive(Debug, Default)]
struct Seen {
    is_over: AtomicBool,
    there: Came,
    back: Came,
    /// When the emergency was to begin, in nanoseconds.
    asked: AtomicU64,
    emergency: Came,
}

impl Seen {
    fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }
}

/// Sends a record every 10 ms and takes what has come back, until the run is over.
fn talk(seen: &Seen, mut far: impl Read + Write) -> io::Result<()> {
    while !seen.is_over() {
        far.write_all(&now().as_nanos().to_le_bytes())?;
        let mut record = [0; size_of::<Record>()];
        match far.read_exact(&mut record) {
            Ok(()) => seen.back.note(u64::from_le_bytes(record)),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
        std::thread::sleep(TALK);
    }
    Ok(())
}

/// The far end of a pipe to and one from the subject.
struct Pipes(io::PipeReader, io::PipeWriter);

/// The far end of a UDP link.
struct Datagrams(UdpSocket);

impl Read for Pipes {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl Write for Pipes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.1.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.1.flush()
    }
}

impl Read for Datagrams {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.recv(buffer)
    }
}

impl Write for Datagrams {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.send(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The subject's process: sends back what it gets.
fn echo(executor: &Executor, seen: &Arc<Seen>) -> luna::Result<(Sender<Record>, Receiver<Record>)> {
    let (sender, records) = luna::channel::<Record>();
    let (back, answers) = luna::channel::<Record>();
    let seen = seen.clone();
    executor.process("subject").priority(10).spawn(async move {
        while let Ok(record) = records.recv().await {
            seen.there.note(u64::from_le_bytes(record));
            if back.send(record).await.is_err() {
                break;
            }
        }
        Ok(())
    })?;
    Ok((sender, answers))
}

/// An ordinary thread on another core than the executor's, if there is one.
fn beside(core: usize, body: impl FnOnce() -> io::Result<()> + Send + 'static) {
    let others = available_cores();
    let other = others.into_iter().find(|other| *other != core);
    let mut attributes = Attributes::new("beside").policy(Policy::Other);
    if let Some(other) = other {
        attributes = attributes.core(other);
    }
    let body = |()| {
        if let Err(error) = body() {
            println!("the thread beside: {error}");
        }
    };
    spawn(attributes, |_| Ok::<_, Infallible>(()), body).expect("a thread");
}

/// Makes the subject, and what is beside it.
fn make(
    mode: &str,
    core: usize,
    system: &mut System,
    executor: &Executor,
    seen: &Arc<Seen>,
) -> luna::Result<()> {
    let own = seen.clone();
    let beside = |body: Body| beside(core, body);
    let devices = system.devices();
    let link = |name: &str| executor.process(name).priority(10);
    match mode {
        "udp" => {
            let far = UdpSocket::bind(ANY)?;
            far.set_read_timeout(Some(TALK * 10))?;
            let address = ANY.parse().expect("an address");
            let port = udp::open(&devices, address, Some(far.local_addr()?))?;
            far.connect(port.local_address()?)?;
            let (sender, answers) = echo(executor, seen)?;
            link("in").spawn(reader(&port, sender, PACKETS)?)?;
            link("out").spawn(writer(&port, answers, PACKETS)?)?;
            beside(Box::new(move || talk(&own, Datagrams(far))));
        }
        "tcp" => {
            let listener = TcpListener::bind(ANY)?;
            let port = tcp::connect(&devices, listener.local_addr()?)?;
            let (sender, answers) = echo(executor, seen)?;
            link("link").spawn(tcp::link(&port, answers, sender, FRAMING)?)?;
            beside(Box::new(move || {
                let (far, _) = listener.accept()?;
                far.set_nodelay(true)?;
                far.set_read_timeout(Some(TALK * 10))?;
                talk(&own, far)
            }));
        }
        "pipe" => {
            let (near, far) = io::pipe()?;
            let (far_in, near_out) = io::pipe()?;
            let (sender, answers) = echo(executor, seen)?;
            link("in").spawn(input(near, sender, FRAMING))?;
            link("out").spawn(output(answers, near_out, FRAMING))?;
            beside(Box::new(move || talk(&own, Pipes(far_in, far))));
        }
        "blocking" => {
            link("subject").spawn(async move {
                loop {
                    let began = now().as_nanos();
                    blocking(|| ()).await;
                    own.there.note(began);
                    luna::after(TALK).await;
                }
            })?;
        }
        "logger" => {
            system.log(Logging::to_file("/tmp/beside.luna"));
        }
        "scope" => {
            let settings = luna_scope::Settings::default();
            let scope =
                luna_scope::Scope::open(settings.address(ANY.parse().expect("an address")))?;
            system.log(Logging::to_sink(scope.sink()?));
            beside(Box::new(move || {
                while !own.is_over() {
                    let began = now().as_nanos();
                    let mut browser = TcpStream::connect(scope.address())?;
                    write!(browser, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")?;
                    browser.read_to_end(&mut Vec::new())?;
                    own.there.note(began);
                    std::thread::sleep(TALK);
                }
                Ok(())
            }));
        }
        _ => {}
    }
    Ok(())
}

fn main() -> luna::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |at: usize, default| {
        let given = arguments.get(at).and_then(|word| word.parse().ok());
        given.unwrap_or(default)
    };
    let mode = arguments.get(1).cloned().unwrap_or_default();
    let (core, cycles) = (number(2, 0), number(3, 500));
    let mut system = System::new("beside");
    system.lock_memory();
    let seen = Arc::new(Seen::default());
    let own = seen.clone();
    system.on_emergency("note", move || {
        match own.asked.load(Ordering::Relaxed) {
            0 => {}
            asked => own.emergency.note(asked),
        }
        own.is_over.store(true, Ordering::Relaxed);
    });
    let executor = system
        .executor("control")
        .core(core)
        .policy(Policy::fifo(80))
        .build()?;
    let (own, raises) = (seen.clone(), mode == "emergency");
    let process = executor.process("loop").priority(20);
    let signal = process.signal::<u32>("count").register()?;
    process.spawn(async move {
        let mut tick = luna::periodic("loop", PERIOD)?;
        for cycle in 0..cycles {
            tick.next().await;
            signal.record(cycle as u32);
            if raises && cycle == cycles / 2 {
                own.asked.store(now().as_nanos(), Ordering::Relaxed);
                return Err(luna::emergency(luna::Error::other("on purpose")));
            }
        }
        own.is_over.store(true, Ordering::Relaxed);
        Ok(())
    })?;
    make(&mode, core, &mut system, &executor, &seen)?;
    let own = seen.clone();
    executor.process("burner").priority(1).spawn(async move {
        while !own.is_over() {
            yield_now().await;
        }
        // The links would wait for ever.
        Err::<(), _>(luna::emergency(luna::Error::other("over")))
    })?;
    if matches!(&*mode, "signal" | "TERM") {
        // Of an ordinary thread, or of one that precedes the executor.
        let policy = if mode == "TERM" {
            Policy::Other
        } else {
            Policy::fifo(90)
        };
        let own = seen.clone();
        let half = PERIOD * (cycles / 2) as u32;
        let body = move |()| {
            // Taken here it would say nothing of the threads that are to take it.
            SigSet::all().thread_block()?;
            std::thread::sleep(half);
            own.asked.store(now().as_nanos(), Ordering::Relaxed);
            kill(Pid::this(), Signal::SIGTERM)
        };
        spawn(
            Attributes::new("sender").policy(policy),
            |_| Ok::<_, Infallible>(()),
            body,
        )
        .expect("a thread");
    }
    let outcome = system.run();
    println!(
        "{mode}: there {}, back {}, emergency {}",
        seen.there, seen.back, seen.emergency
    );
    if let Err(error) = outcome {
        println!("{error}");
    }
    if let Some(report) = system.report() {
        println!("{report}");
    }
    Ok(())
}

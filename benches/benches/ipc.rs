//! `ipc`: a value goes to another program and its acknowledgement comes back: a rendezvous of
//! `luna-ipc` beside ping-pongs of iceoryx2 and of bare shared memory.
//!
//! The other program is this one, started again for each block and pinned to the second core. A
//! rendezvous of LUNA goes from process to process: a local process, the link's process on the same
//! executor, the other program's link, and a process there. The peers have one thread on each side.

use core_affinity::CoreId;
use iceoryx2::prelude::*;
use luna_benches::{
    cores::{on_core, two_cores},
    harness::{Case, Goal, run},
};
use std::{
    fs::OpenOptions,
    hint,
    io::{BufRead, BufReader},
    os::fd::AsRawFd,
    process::{Child, Command, Stdio},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    time::{Duration, Instant},
};

const ASLEEP: &str = "rendezvous, two programs, asleep";
const AWAKE: &str = "rendezvous, two programs, awake";
const LARGE: &str = "1 MiB, two programs, asleep";
const PER_TRIP: &str = "ns/round trip";
const COPIES: &str = "bare: two copies in one program";
const FUTEX: &str = "bare: futex in shared memory";
const SPIN: &str = "bare: spin in shared memory";
const EVENTS: &str = "iceoryx2 publish-subscribe, events";
const POLLING: &str = "iceoryx2 publish-subscribe, polling";

/// Set in the other program: what it is to do.
const TASK: &str = "LUNA_BENCH_IPC";
const READY: &str = "ready";

/// A value that no one copies: 16 bytes of it cross.
type Large = [u8; 1 << 20];
static EMPTY: Large = [0; 1 << 20];

/// How the processes of LUNA wait.
#[derive(Clone, Copy, PartialEq)]
enum Waits {
    Asleep,
    Spinning,
    BesideBusy,
    /// The link looks for the other program in each turn, for a bounded number of turns.
    Looking,
}

impl Waits {
    fn looks(self) -> u32 {
        match self {
            Waits::Looking => 5000,
            _ => 0,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Waits::Asleep => "luna-asleep",
            Waits::Spinning => "luna-spinning",
            Waits::BesideBusy => "luna-busy",
            Waits::Looking => "luna-looking",
        }
    }
}

/// The other program.
struct Other(Child);

impl Other {
    /// Starts it, and waits until it is ready.
    fn start(task: &str, name: &str, core: CoreId) -> Self {
        let mut child = Command::new(std::env::current_exe().expect("the system knows it"))
            .env(TASK, format!("{task} {name} {}", core.id))
            .stdout(Stdio::piped())
            .spawn()
            .expect("this program can be started again");
        let output = child.stdout.take().expect("it is a pipe");
        let mut line = String::new();
        let read = BufReader::new(output).read_line(&mut line);
        assert!(read.is_ok() && line.trim() == READY, "{task}: {line:?}");
        Self(child)
    }

    fn wait(mut self) {
        let status = self.0.wait().expect("it was started");
        assert!(status.success(), "the other program: {status}");
    }
}

fn channel_name(kind: &str) -> String {
    format!("bench/{kind}/{}", std::process::id())
}

/// A system with an executor, a link, and a process.
fn run_luna(
    core: CoreId,
    waits: Waits,
    link: impl luna::Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) {
    let mut system = luna::System::new("bench");
    let mut executor = system.executor("bench").core(core.id);
    if waits == Waits::Spinning {
        executor = executor.spin_before_sleep(Duration::from_micros(50));
    }
    let executor = executor.build().expect("the core is one of the machine's");
    let over = Arc::new(AtomicBool::new(false));
    let ended = over.clone();
    let body = async move {
        let result = body.await;
        ended.store(true, Ordering::Relaxed);
        result
    };
    let spawned = executor.process("link").spawn(link).and_then(|_| {
        executor.process("body").spawn(body)?;
        if waits == Waits::BesideBusy {
            executor.process("busy").spawn(async move {
                while !over.load(Ordering::Relaxed) {
                    luna::yield_now().await;
                }
                Ok(())
            })?;
        }
        Ok(())
    });
    spawned.expect("the names differ");
    system.run().expect("no process fails");
}

fn luna_rendezvous(cores: [CoreId; 2], waits: Waits, messages: u64) -> Duration {
    let name = channel_name("luna");
    let other = Other::start(waits.word(), &name, cores[1]);
    let (sender, link) = luna_ipc::sender::<u64>(&name).expect("the name is this process'");
    let link = link.looks(waits.looks());
    let elapsed = Arc::new(Mutex::new(Duration::ZERO));
    let result = elapsed.clone();
    run_luna(cores[0], waits, link, async move {
        for number in 0..messages / 16 + 1 {
            sender.send(number).await?;
        }
        let start = Instant::now();
        for number in 0..messages {
            sender.send(number).await?;
        }
        *result.lock().expect("no panic") = start.elapsed();
        Ok(())
    });
    other.wait();
    *elapsed.lock().expect("no panic")
}

fn luna_other(name: &str, core: CoreId, waits: Waits) {
    let (receiver, link) = luna_ipc::receiver::<u64>(name).expect("the name is the bench's");
    let link = link.looks(waits.looks());
    println!("{READY}");
    run_luna(core, waits, link, async move {
        while receiver.recv().await.is_ok() {}
        Ok(())
    });
}

/// Writes and reads the first and the last byte of each value.
fn luna_large(cores: [CoreId; 2], messages: u64) -> Duration {
    let name = channel_name("large");
    let other = Other::start("luna-large", &name, cores[1]);
    let endpoint = luna_ipc::Endpoint::new(&name);
    let opened = endpoint.loan_sender(3, &EMPTY);
    let (loans, sender, link) = opened.expect("the name is this process'");
    let elapsed = Arc::new(Mutex::new(Duration::ZERO));
    let result = elapsed.clone();
    run_luna(cores[0], Waits::Asleep, link, async move {
        let mut start = Instant::now();
        let warm_up = messages / 16 + 1;
        for number in 0..messages + warm_up {
            if number == warm_up {
                start = Instant::now();
            }
            let mut large = loans.loan().expect("one is free");
            (large[0], large[EMPTY.len() - 1]) = (number as u8, number as u8);
            sender.send(large).await?;
        }
        *result.lock().expect("no panic") = start.elapsed();
        Ok(())
    });
    other.wait();
    *elapsed.lock().expect("no panic")
}

fn luna_large_other(name: &str, core: CoreId) {
    let endpoint = luna_ipc::Endpoint::new(name);
    let opened = endpoint.loan_receiver::<Large>(3);
    let (receiver, link) = opened.expect("the name is the bench's");
    println!("{READY}");
    run_luna(core, Waits::Asleep, link, async move {
        while let Ok(large) = receiver.recv().await {
            assert_eq!(large[0], large[EMPTY.len() - 1]);
        }
        Ok(())
    });
}

/// What a channel that copies does at least: into shared memory, and out of it.
fn copies(core: CoreId, messages: u64) -> Duration {
    let mut places = [EMPTY.to_vec(), EMPTY.to_vec(), EMPTY.to_vec()];
    on_core(core, move || {
        let start = Instant::now();
        for number in 0..messages {
            let [from, shared, to] = &mut places;
            from[0] = number as u8;
            shared.copy_from_slice(hint::black_box(from));
            to.copy_from_slice(hint::black_box(shared));
            hint::black_box(to);
        }
        start.elapsed()
    })
}

/// A word in a file of shared memory, which is never unmapped.
fn shared_word(name: &str) -> &'static AtomicU32 {
    let path = format!("/dev/shm/luna-bench-{}", name.replace('/', "-"));
    let mut options = OpenOptions::new();
    let options = options.read(true).write(true).create(true).truncate(false);
    let file = options.open(path).expect("/dev/shm can be written");
    file.set_len(4096).expect("there is room");
    // SAFETY: a new mapping of a file that is 4096 bytes long and open for both; no memory of this
    // program is touched.
    let base = unsafe {
        let flags = libc::PROT_READ | libc::PROT_WRITE;
        libc::mmap(
            std::ptr::null_mut(),
            4096,
            flags,
            libc::MAP_SHARED,
            file.as_raw_fd(),
            0,
        )
    };
    assert_ne!(base, libc::MAP_FAILED);
    // SAFETY: the mapping is aligned to a page, stays for ever, and is accessed by atomic
    // operations alone, which any bits are valid for.
    unsafe { &*base.cast() }
}

fn remove_word(name: &str) {
    let path = format!("/dev/shm/luna-bench-{}", name.replace('/', "-"));
    let _ = std::fs::remove_file(path);
}

fn futex(word: &AtomicU32, operation: libc::c_int, value: u32) {
    // SAFETY: the word is mapped, and both operations read only the first four arguments: a null
    // pointer means no timeout. A wait that fails returns, and its caller looks again.
    unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            operation,
            value,
            std::ptr::null::<libc::timespec>(),
        )
    };
}

/// Waits for the turn of `me` and passes it on.
fn pass(word: &AtomicU32, me: u32, sleeps: bool) {
    while word.load(Ordering::Acquire) != me {
        match sleeps {
            true => futex(word, libc::FUTEX_WAIT, 1 - me),
            false => hint::spin_loop(),
        }
    }
    word.store(1 - me, Ordering::Release);
    if sleeps {
        futex(word, libc::FUTEX_WAKE, 1);
    }
}

fn bare(cores: [CoreId; 2], sleeps: bool, trips: u64) -> Duration {
    let name = channel_name("word");
    let word = shared_word(&name);
    word.store(0, Ordering::Release);
    let warm_up = trips / 16 + 1;
    let task = format!("word {sleeps} {}", trips + warm_up);
    let other = Other::start(&task, &name, cores[1]);
    let elapsed = on_core(cores[0], || {
        (0..warm_up).for_each(|_| pass(word, 0, sleeps));
        let start = Instant::now();
        (0..trips).for_each(|_| pass(word, 0, sleeps));
        // The turn is here again when the last trip is over.
        while word.load(Ordering::Acquire) != 0 {
            hint::spin_loop();
        }
        start.elapsed()
    });
    other.wait();
    remove_word(&name);
    elapsed
}

fn pinned(core: CoreId) {
    assert!(core_affinity::set_for_current(core), "the core is usable");
}

type Failure = Box<dyn std::error::Error>;

/// Passes values back and forth by iceoryx2: the first side sends first. Returns how long `trips`
/// took.
fn iceoryx2(
    name: &str,
    is_first: bool,
    sleeps: bool,
    trips: u64,
    ready: impl FnOnce() -> Option<Other>,
) -> Result<(Duration, Option<Other>), Failure> {
    let node = NodeBuilder::new().create::<ipc::Service>()?;
    let directions = ["there", "back"].map(|direction| format!("{name}/{direction}"));
    let mut services = Vec::new();
    let mut events = Vec::new();
    for direction in &directions {
        let service = node.service_builder(&direction.as_str().try_into()?);
        services.push(service.publish_subscribe::<u64>().open_or_create()?);
        let service = node.service_builder(&direction.as_str().try_into()?);
        events.push(service.event().open_or_create()?);
    }
    let (out, back) = if is_first { (0, 1) } else { (1, 0) };
    let publisher = services[out].publisher_builder().create()?;
    let subscriber = services[back].subscriber_builder().create()?;
    let notifier = events[out].notifier_builder().create()?;
    let listener = events[back].listener_builder().create()?;
    let send = |value: u64| -> Result<(), Failure> {
        publisher.send_copy(value)?;
        if sleeps {
            notifier.notify()?;
        }
        Ok(())
    };
    let receive = || -> Result<u64, Failure> {
        loop {
            if let Some(sample) = subscriber.receive()? {
                return Ok(*sample);
            }
            match sleeps {
                true => drop(listener.blocking_wait(|_| {})?),
                false => hint::spin_loop(),
            }
        }
    };
    let other = ready();
    let warm_up = trips / 16 + 1;
    let mut start = Instant::now();
    for number in 0..warm_up + trips {
        if number == warm_up {
            start = Instant::now();
        }
        if is_first {
            send(number)?;
            assert_eq!(receive()?, number);
        } else {
            send(receive()?)?;
        }
    }
    Ok((start.elapsed(), other))
}

fn iceoryx2_trips(cores: [CoreId; 2], sleeps: bool, trips: u64) -> Duration {
    let name = channel_name("iceoryx2");
    let task = format!("iceoryx2 {sleeps} {trips}");
    on_core(cores[0], || {
        let start = || Some(Other::start(&task, &name, cores[1]));
        let measured = iceoryx2(&name, true, sleeps, trips, start);
        let (elapsed, other) = measured.expect("iceoryx2 works here");
        other.expect("it was started").wait();
        elapsed
    })
}

/// What the other program does.
fn other_program(task: &str) {
    let words: Vec<&str> = task.split(' ').collect();
    let [kind, ref parameters @ .., name, core] = words[..] else {
        panic!("no task: {task:?}");
    };
    let core = CoreId {
        id: core.parse().expect("a number"),
    };
    let of_trips = || {
        pinned(core);
        let trips: u64 = parameters[1].parse().expect("a number");
        (parameters[0] == "true", trips)
    };
    match kind {
        "word" => {
            let (sleeps, trips) = of_trips();
            let word = shared_word(name);
            println!("{READY}");
            (0..trips).for_each(|_| pass(word, 1, sleeps));
        }
        "iceoryx2" => {
            let (sleeps, trips) = of_trips();
            let ready = || {
                println!("{READY}");
                None
            };
            let passed = iceoryx2(name, false, sleeps, trips, ready);
            passed.expect("iceoryx2 works here");
        }
        "luna-large" => luna_large_other(name, core),
        "luna-asleep" => luna_other(name, core, Waits::Asleep),
        "luna-spinning" => luna_other(name, core, Waits::Spinning),
        "luna-looking" => luna_other(name, core, Waits::Looking),
        "luna-busy" => luna_other(name, core, Waits::BesideBusy),
        kind => panic!("no task: {kind:?}"),
    }
}

fn case(name: &'static str, peer: &'static str, block: impl Fn(u64) -> Duration + 'static) -> Case {
    // Each block starts a program.
    Case::new(name, peer, PER_TRIP, block).at_least(2000)
}

fn times(factor: f64, name: &'static str, peer: &'static str, of: &'static str) -> Goal {
    Goal::Times {
        factor,
        name,
        peer,
        size: None,
        of,
    }
}

fn main() {
    if let Ok(task) = std::env::var(TASK) {
        return other_program(&task);
    }
    let Some(cores) = two_cores() else {
        println!("one core is usable: two programs on two cores are left out");
        return;
    };
    let asleep = times(1.2, ASLEEP, FUTEX, "the bare futex' round trip");
    let awake = || times(1.3, AWAKE, POLLING, "iceoryx2's round trip");
    let large = times(1.0, LARGE, COPIES, "two copies");
    let luna = move |waits| move |messages| luna_rendezvous(cores, waits, messages);
    let cases = vec![
        case(ASLEEP, "LUNA", luna(Waits::Asleep)).goal(asleep),
        case(ASLEEP, EVENTS, move |trips| {
            iceoryx2_trips(cores, true, trips)
        }),
        case(ASLEEP, FUTEX, move |trips| bare(cores, true, trips)),
        case(AWAKE, "LUNA", luna(Waits::BesideBusy)).goal(awake()),
        case(AWAKE, "LUNA, executors that spin", luna(Waits::Spinning)).goal(awake()),
        case(AWAKE, "LUNA, links that look", luna(Waits::Looking)).goal(awake()),
        case(AWAKE, POLLING, move |trips| {
            iceoryx2_trips(cores, false, trips)
        }),
        case(AWAKE, SPIN, move |trips| bare(cores, false, trips)),
        case(LARGE, "LUNA, lent", move |messages| {
            luna_large(cores, messages)
        })
        .goal(large),
        case(LARGE, COPIES, move |messages| copies(cores[0], messages)),
    ];
    run("ipc", cases);
}

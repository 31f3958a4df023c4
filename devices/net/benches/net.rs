//! `net`: channels of `luna-net` beside zenoh itself, on loopback, with all in one program.
//!
//! `cargo bench -p luna-net --bench net -- [--quick] [rendezvous | stream]`. Blocks of all cases, or
//! of those with that word in their name, go round by round. It prints a table, and writes
//! `bench/net.json` in the target folder.
//!
//! A rendezvous goes from process to process and back: local process, link, its thread, zenoh, the
//! other link, and a process there. zenoh's query is answered either by a callback on its own
//! thread, which is the least it can do, or by a thread that receives queries, as a process does.

use luna::{Buffer, Policy, System};
use luna_net::{Config, Network};
use serde_json::json;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

const TRIP: &str = "rendezvous, 16 bytes";
/// Values under way. zenoh bounds those of `put` by the bytes of its queues, which hold more.
const WINDOW: usize = 4096;
const STREAM: &str = "stream, 16 bytes";
const BY_THREAD: &str = "zenoh query, a thread answers";
const BY_CALLBACK: &str = "zenoh query, a callback answers";
const PUT: &str = "zenoh put";

/// What a case gives: ns for each operation.
type Measure = Box<dyn FnMut(u64) -> f64>;

struct Case {
    name: &'static str,
    peer: &'static str,
    operations: u64,
    measure: Measure,
    samples: Vec<f64>,
}

fn address() -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port is free");
    format!("tcp/{}", listener.local_addr().expect("it is bound"))
}

fn networks() -> (Network, Network) {
    let address = address();
    let here = Network::open(&Config::loopback().listen(&address)).expect("it opens");
    let there = Config::loopback().connect(&address);
    let there = there.connect_within(Duration::from_secs(30));
    (here, Network::open(&there).expect("it connects"))
}

fn sessions() -> (Session, Session) {
    let address = address();
    let open = |key: &str| {
        let mut config = zenoh::Config::default();
        let list = format!("[\"{address}\"]");
        for (key, value) in [
            ("scouting/multicast/enabled", "false"),
            ("listen/endpoints", "[\"tcp/127.0.0.1:0\"]"),
            ("connect/exit_on_failure", "true"),
            (key, list.as_str()),
        ] {
            config.insert_json5(key, value).expect("a key of zenoh");
        }
        zenoh::open(config).wait().expect("it opens")
    };
    (open("listen/endpoints"), open("connect/endpoints"))
}

fn run(
    link: impl luna::Process + Send + 'static,
    body: impl Future<Output = luna::Result<()>> + Send + 'static,
) {
    let mut system = System::new("bench");
    let main = system.executor("main").policy(Policy::Other).build();
    let main = main.expect("it is valid");
    main.process("link")
        .priority(2)
        .spawn(link)
        .expect("it is new");
    main.process("body").spawn(body).expect("it is new");
    system.run().expect("it ends in order");
}

/// Opens a channel anew, and carries so many values after some that are not timed.
fn luna(networks: &(Network, Network), name: &'static str, is_stream: bool, count: u64) -> f64 {
    const WARM_UP: u64 = 200;
    let (here, there) = networks;
    let endpoint = there.endpoint(name).window(WINDOW);
    let (receiver, link) = endpoint.receiver::<[u64; 2]>().expect("it opens");
    let received = std::thread::spawn(move || {
        run(link, async move {
            for number in 0..WARM_UP + count {
                assert_eq!(receiver.recv().await?[0], number);
            }
            assert!(receiver.recv().await.is_err());
            Ok(())
        });
    });
    let endpoint = here.endpoint(name).window(WINDOW).capacity(32);
    let opened = match is_stream {
        true => endpoint.buffered_sender(Buffer::fifo(64)),
        false => endpoint.sender(),
    };
    let (sender, link) = opened.expect("it opens");
    let status = link.status();
    let (report, begun) = mpsc::channel();
    run(link, async move {
        for number in 0..WARM_UP {
            sender.send([number; 2]).await?;
        }
        while status.acknowledged() < WARM_UP {
            luna::after(Duration::from_micros(100)).await;
        }
        let begin = Instant::now();
        for number in WARM_UP..WARM_UP + count {
            sender.send([number; 2]).await?;
        }
        report
            .send((begin, begin.elapsed()))
            .expect("it is awaited");
        Ok(())
    });
    received.join().expect("all came");
    let (begin, sent) = begun.recv().expect("it was sent");
    // A stream is over when all was taken.
    let time = if is_stream { begin.elapsed() } else { sent };
    time.as_nanos() as f64 / count as f64
}

fn query(sessions: &(Session, Session), key: &'static str, count: u64) -> f64 {
    let querier = sessions.0.declare_querier(key).wait().expect("a key");
    let ask = |number: u64| {
        let replies = querier.get().payload([number as u8; 16]).wait();
        let reply = replies.expect("it is open").recv().expect("it is answered");
        assert!(reply.result().is_ok());
    };
    (0..200).for_each(ask);
    let begin = Instant::now();
    (0..count).for_each(ask);
    begin.elapsed().as_nanos() as f64 / count as f64
}

fn put(sessions: &(Session, Session), count: u64, arrived: &AtomicU64) -> f64 {
    let publisher = sessions.0.declare_publisher("bench/put");
    let publisher = publisher.congestion_control(CongestionControl::Block);
    let publisher = publisher.wait().expect("a key");
    let wait = |count| {
        while arrived.load(Relaxed) < count {
            std::thread::sleep(Duration::from_micros(100));
        }
    };
    arrived.store(0, Relaxed);
    publisher.put([0; 16]).wait().expect("it is open");
    wait(1);
    let begin = Instant::now();
    for _ in 0..count {
        publisher.put([0; 16]).wait().expect("it is open");
    }
    wait(1 + count);
    begin.elapsed().as_nanos() as f64 / count as f64
}

fn main() {
    let is_quick = std::env::args().any(|argument| argument == "--quick");
    let (rounds, share) = if is_quick { (3, 10_u64) } else { (11, 1) };
    let networks = Arc::new(networks());
    let sessions = Arc::new(sessions());
    let there = &sessions.1;
    let by_callback = there.declare_queryable("bench/callback");
    let _by_callback = by_callback
        .callback(|query| drop(query.reply("bench/callback", [0; 16]).wait()))
        .wait()
        .expect("a key");
    let by_thread = there
        .declare_queryable("bench/thread")
        .wait()
        .expect("a key");
    std::thread::spawn(move || {
        while let Ok(query) = by_thread.recv() {
            drop(query.reply("bench/thread", [0; 16]).wait());
        }
    });
    let arrived = Arc::new(AtomicU64::new(0));
    let count = arrived.clone();
    let _subscriber = there
        .declare_subscriber("bench/put")
        .callback(move |_| {
            count.fetch_add(1, Relaxed);
        })
        .wait()
        .expect("a key");
    let case = |name, peer, operations, measure: Measure| Case {
        name,
        peer,
        operations: operations / share,
        measure,
        samples: Vec::new(),
    };
    let (trips, streams) = (networks.clone(), networks.clone());
    let (first, second, third) = (sessions.clone(), sessions.clone(), sessions.clone());
    let mut cases = vec![
        case(
            TRIP,
            "LUNA",
            3000,
            Box::new(move |n| luna(&trips, "bench/trip", false, n)),
        ),
        case(
            TRIP,
            BY_THREAD,
            3000,
            Box::new(move |n| query(&first, "bench/thread", n)),
        ),
        case(
            TRIP,
            BY_CALLBACK,
            3000,
            Box::new(move |n| query(&second, "bench/callback", n)),
        ),
        case(
            STREAM,
            "LUNA",
            200_000,
            Box::new(move |n| luna(&streams, "bench/stream", true, n)),
        ),
        case(
            STREAM,
            PUT,
            200_000,
            Box::new(move |n| put(&third, n, &arrived)),
        ),
    ];
    let word = std::env::args().skip(1).find(|word| !word.starts_with('-'));
    if let Some(word) = word {
        cases.retain(|case| case.name.contains(&word));
    }
    for _ in 0..rounds {
        for case in &mut cases {
            case.samples.push((case.measure)(case.operations));
        }
    }
    let mut rows = Vec::new();
    println!("| case | peer | median ns | least ns | blocks |\n| --- | --- | --- | --- | --- |");
    for case in &mut cases {
        case.samples.sort_by(f64::total_cmp);
        let median = case.samples[case.samples.len() / 2];
        let (name, peer, min) = (case.name, case.peer, case.samples[0]);
        println!("| {name} | {peer} | {median:.0} | {min:.0} | {rounds} |");
        rows.push(json!({
            "name": name, "peer": peer, "unit": "ns", "median": median, "min": min,
            "samples": case.samples,
        }));
    }
    let of = |name, peer| {
        let mut rows = rows.iter();
        let row = rows.find(|row| row["name"] == name && row["peer"] == peer);
        row.and_then(|row| row["median"].as_f64())
    };
    let trip = of(TRIP, "LUNA");
    if let (Some(luna), Some(zenoh)) = (trip, of(TRIP, BY_THREAD)) {
        println!(
            "rendezvous / query answered by a thread: {:.2} (goal 1.3)",
            luna / zenoh
        );
    }
    if let (Some(luna), Some(zenoh)) = (trip, of(TRIP, BY_CALLBACK)) {
        println!(
            "rendezvous / query answered by a callback: {:.2}",
            luna / zenoh
        );
    }
    if let (Some(luna), Some(zenoh)) = (of(STREAM, "LUNA"), of(STREAM, PUT)) {
        println!("stream's rate / put's: {:.2} (goal 0.9)", zenoh / luna);
    }
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("bench");
    let file = folder.join("net.json");
    std::fs::create_dir_all(&folder).expect("the target folder is there");
    std::fs::write(&file, json!(rows).to_string()).expect("it can be written");
    println!("{}", file.display());
}

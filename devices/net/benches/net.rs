//! `net`: channels of `luna-net` beside zenoh itself, on loopback, with all in one program.
//!
//! `cargo bench -p luna-net --bench net -- [--quick] [--filter TEXT]`.
//!
//! A rendezvous goes from process to process and back: local process, link, its thread, zenoh, the
//! other link, and a process there. zenoh's query is answered either by a callback on its own
//! thread, which is the least it can do, or by a thread that receives queries, as a process does.

use luna::{Buffer, Policy, System};
use luna_benches::harness::{Case, Goal, LUNA, run};
use luna_net::{Config, Network};
use std::rc::Rc;
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
const TRIPS: u64 = 3000;
const VALUES: u64 = 200_000;

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

fn run_system(
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
fn luna(
    networks: &(Network, Network),
    name: &'static str,
    is_stream: bool,
    count: u64,
) -> Duration {
    const WARM_UP: u64 = 200;
    let (here, there) = networks;
    let endpoint = there.endpoint(name).window(WINDOW);
    let (receiver, link) = endpoint.receiver::<[u64; 2]>().expect("it opens");
    let received = std::thread::spawn(move || {
        run_system(link, async move {
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
    run_system(link, async move {
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
    if is_stream { begin.elapsed() } else { sent }
}

fn query(sessions: &(Session, Session), key: &'static str, count: u64) -> Duration {
    let querier = sessions.0.declare_querier(key).wait().expect("a key");
    let ask = |number: u64| {
        let replies = querier.get().payload([number as u8; 16]).wait();
        let reply = replies.expect("it is open").recv().expect("it is answered");
        assert!(reply.result().is_ok());
    };
    (0..200).for_each(ask);
    let begin = Instant::now();
    (0..count).for_each(ask);
    begin.elapsed()
}

fn put(sessions: &(Session, Session), count: u64, arrived: &AtomicU64) -> Duration {
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
    begin.elapsed()
}

fn main() {
    let networks = Rc::new(networks());
    let sessions = Rc::new(sessions());
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
    let times = |factor, name, peer, of| Goal::Times {
        factor,
        name,
        peer,
        size: None,
        of,
    };
    let (trips, streams) = (networks.clone(), networks.clone());
    let [first, second, third] = [(); 3].map(|()| sessions.clone());
    let cases = vec![
        Case::new(TRIP, LUNA, "ns/value", move |n| {
            luna(&trips, "bench/trip", false, n)
        })
        .exactly(TRIPS)
        .goal(times(1.3, TRIP, BY_THREAD, "zenoh's query")),
        Case::new(TRIP, BY_THREAD, "ns/value", move |n| {
            query(&first, "bench/thread", n)
        })
        .exactly(TRIPS),
        Case::new(TRIP, BY_CALLBACK, "ns/value", move |n| {
            query(&second, "bench/callback", n)
        })
        .exactly(TRIPS),
        Case::new(STREAM, LUNA, "ns/value", move |n| {
            luna(&streams, "bench/stream", true, n)
        })
        .exactly(VALUES)
        // 0.9 of its rate.
        .goal(times(1.0 / 0.9, STREAM, PUT, "zenoh's put")),
        Case::new(STREAM, PUT, "ns/value", move |n| put(&third, n, &arrived)).exactly(VALUES),
    ];
    run("net", cases);
}

//! Recordings over TCP and UDP: peers that come, go, stall, and speak another protocol. Losses are
//! counted exactly.

use crate::common;
use common::{Content, Kept};
use luna_logger::{
    Departure, Handler, Hub, Level, Logging, LoggingReport, Peer, PeerError, Receiver, Receiving,
    Recorder, Signal, Sink, message,
};
use proptest::prelude::*;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// Longer than any test takes.
const LONG: Duration = Duration::from_secs(600);

/// Keeps the recording of each sender, and the reported arrivals and departures.
#[derive(Default)]
struct Office {
    state: Mutex<State>,
    changes: Condvar,
}

#[derive(Default)]
struct State {
    kept: Vec<(Peer, Kept)>,
    gone: Vec<(Peer, Departure)>,
    refused: Vec<PeerError>,
}

impl Office {
    fn change(&self, change: impl FnOnce(&mut State)) {
        change(&mut self.state.lock().unwrap());
        self.changes.notify_all();
    }

    /// Waits until it is so, however long that takes.
    fn wait(&self, is_so: impl Fn(&State) -> bool) {
        let state = self.state.lock().unwrap();
        drop(
            self.changes
                .wait_while(state, |state| !is_so(state))
                .unwrap(),
        );
    }

    fn kept(&self, n: usize) -> Kept {
        self.state.lock().unwrap().kept[n].1.clone()
    }

    /// The only sender's recording, which has ended.
    fn only(&self) -> (Content, Departure) {
        self.wait(|state| state.gone.iter().any(|(_, gone)| gone.has_ended));
        let state = self.state.lock().unwrap();
        assert_eq!(state.kept.len(), 1, "{:?}", state.gone);
        let gone = &state
            .gone
            .iter()
            .rfind(|(_, gone)| gone.has_ended)
            .unwrap()
            .1;
        (state.kept[0].1.read(), gone.clone())
    }
}

struct Keeping(Arc<Office>);

/// Reports each block to the office.
struct Reporting(common::KeepingSink, Arc<Office>);

impl Sink for Reporting {
    fn begin(&mut self, head: &[u8]) -> io::Result<()> {
        self.0.begin(head)
    }

    fn block(&mut self, block: &[u8]) -> io::Result<()> {
        self.0.block(block)?;
        self.1.change(|_| ());
        Ok(())
    }
}

impl Handler for Keeping {
    fn open(&self, peer: &Peer) -> io::Result<Box<dyn Sink>> {
        let kept = Kept::default();
        let sink = Reporting(kept.sink(), self.0.clone());
        self.0.change(|state| state.kept.push((peer.clone(), kept)));
        Ok(Box::new(sink))
    }

    fn has_gone(&self, peer: &Peer, departure: &Departure) {
        self.0
            .change(|state| state.gone.push((peer.clone(), departure.clone())));
    }

    fn was_refused(&self, _address: SocketAddr, error: &PeerError) {
        self.0.change(|state| state.refused.push(*error));
    }
}

fn tcp_at(address: &str) -> (Arc<Office>, Receiving) {
    let office = Arc::<Office>::default();
    // The port may be in use for a moment, for example by a sender connected to itself.
    let receiver = loop {
        match Receiver::tcp(address) {
            Ok(receiver) => break receiver,
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                std::thread::sleep(Duration::from_millis(10));
            }
            Err(error) => panic!("{error}"),
        }
    };
    let receiving = receiver.start(Arc::new(Keeping(office.clone()))).unwrap();
    (office, receiving)
}

fn tcp() -> (Arc<Office>, Receiving) {
    tcp_at("127.0.0.1:0")
}

/// For a test that closes its port and opens it again: on an address of its own, so that no other
/// test gets the port meanwhile. `test` selects the address.
fn tcp_of(test: u8) -> (Arc<Office>, Receiving) {
    // Elsewhere the loopback device has one address, and the port may be taken meanwhile.
    if !cfg!(target_os = "linux") {
        return tcp();
    }
    // Of this run, since others may test on the same machine.
    let [low, high, ..] = std::process::id().to_le_bytes();
    tcp_at(&format!("127.{}.{high}.{low}:0", 64 + test))
}

/// A running recording of this thread.
struct Run {
    recorder: Recorder,
    signal: Signal<u64>,
    _inside: luna_logger::Entered,
    produced: u64,
}

impl Run {
    fn start(recording: Logging) -> Run {
        let hub = Hub::new("sender", Default::default());
        let recording = recording.every(Duration::from_millis(1));
        let recorder = Recorder::start(&hub, recording).unwrap();
        let inside = hub.enter();
        Run {
            recorder,
            signal: Signal::register("numbers").unwrap(),
            _inside: inside,
            produced: 0,
        }
    }

    fn record(&mut self, samples: u64) {
        for _ in 0..samples {
            self.signal.record(self.produced);
            self.produced += 1;
        }
    }

    fn finish(self) -> LoggingReport {
        let report = self.recorder.finish();
        let one = &report.signals[0];
        assert_eq!(one.recorded + one.lost, self.produced, "{report}");
        report
    }
}

fn numbers(content: &Content) -> Vec<u64> {
    let samples = content.samples.get(&0).into_iter().flatten();
    samples
        .map(|(_, values)| values[0].as_f64() as u64)
        .collect()
}

#[test]
fn what_is_sent_over_tcp_is_what_is_received() {
    let (office, receiving) = tcp();
    let recording = Logging::to_tcp(receiving.address().to_string()).end_within(LONG);
    let mut run = Run::start(recording);
    run.record(20_000);
    message(Level::Warn, "test", format_args!("it is hot"));
    let report = run.finish();
    assert_eq!(
        (report.signals[0].lost, &report.error),
        (0, &None),
        "{report}"
    );
    assert!(report.to.starts_with("tcp://127.0.0.1:"));
    let (content, gone) = office.only();
    assert_eq!(numbers(&content), (0..20_000).collect::<Vec<_>>());
    assert_eq!(
        (content.system.as_str(), content.messages.len()),
        ("sender", 1)
    );
    assert_eq!((gone.error, gone.missing), (None, 0));
    assert_eq!(
        (gone.received.samples[&0], gone.received.messages),
        (20_000, 1)
    );
    receiving.stop();
}

#[test]
fn a_receiver_that_comes_late_gets_all_that_had_room() {
    let address = {
        let (_, receiving) = tcp_of(0);
        receiving.address().to_string()
    };
    let mut run = Run::start(Logging::to_tcp(&*address).end_within(LONG));
    run.record(5_000);
    let (office, receiving) = tcp_at(&address);
    let report = run.finish();
    assert_eq!(report.signals[0].lost, 0, "{report}");
    assert_eq!(numbers(&office.only().0).len(), 5_000);
    receiving.stop();
}

#[test]
fn a_receiver_that_was_started_again_gets_a_recording_of_its_own() {
    let (first, receiving) = tcp_of(1);
    let address = receiving.address().to_string();
    let mut run = Run::start(Logging::to_tcp(&*address).end_within(LONG));
    let has_come = |samples| {
        first.wait(|state| {
            let kept = state.kept.first().map(|(_, kept)| kept.bytes());
            kept.is_some_and(|bytes| numbers(&common::read(&bytes).0).len() >= samples)
        });
    };
    run.record(1);
    has_come(1);
    // These are in later blocks, sent after the acknowledgement of the first was read: so the
    // sender has no block 0 any more, which a new receiver would accept.
    run.record(5_000);
    has_come(5_001);
    receiving.stop();
    assert!(!first.state.lock().unwrap().gone[0].1.has_ended);
    let (second, receiving) = tcp_at(&address);
    // Until then, samples may be lost.
    while second.state.lock().unwrap().kept.is_empty() {
        run.record(1);
        std::thread::yield_now();
    }
    run.record(1_000);
    let report = run.finish();
    let (before, error) = common::read(&first.kept(0).bytes());
    assert!(error.is_none() && !before.has_ended, "{error:?}");
    let (after, _) = second.only();
    let (before, after) = (numbers(&before), numbers(&after));
    // A block counts as lost if its acknowledgement was lost with the receiver, although the
    // receiver has it.
    assert!(
        (before.len() + after.len()) as u64 >= report.signals[0].recorded,
        "{report}"
    );
    let all: Vec<u64> = before.into_iter().chain(after).collect();
    assert!(all.is_sorted_by(|a, b| a < b), "none twice, and in order");
    assert!(second.state.lock().unwrap().kept[0].0.part > 0);
    receiving.stop();
}

/// A relay between sender and receiver: passes on this many bytes for each connection, then cuts
/// it. After the last it cuts none.
fn cutting(to: SocketAddr, cuts: Vec<usize>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        let mut cuts = cuts.into_iter();
        while let Ok((mut sender, _)) = listener.accept() {
            let Ok(mut receiver) = TcpStream::connect(to) else {
                return;
            };
            let mut left = cuts.next().unwrap_or(usize::MAX);
            let (mut back_from, mut back_to) =
                (receiver.try_clone().unwrap(), sender.try_clone().unwrap());
            let back = std::thread::spawn(move || {
                let _ = io::copy(&mut back_from, &mut back_to);
                let _ = back_to.shutdown(Shutdown::Both);
            });
            let mut buffer = [0; 4096];
            while left > 0 {
                let most = left.min(buffer.len());
                let Ok(got @ 1..) = sender.read(&mut buffer[..most]) else {
                    break;
                };
                left -= got;
                if receiver.write_all(&buffer[..got]).is_err() {
                    break;
                }
            }
            let _ = receiver.shutdown(Shutdown::Both);
            let _ = sender.shutdown(Shutdown::Both);
            let _ = back.join();
        }
    });
    address
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]

    /// Wherever a connection is cut, nothing is lost and nothing comes twice.
    #[test]
    fn a_cut_connection_costs_nothing(cuts in prop::collection::vec(0usize..40_000, 1..6)) {
        let (office, receiving) = tcp();
        let between = cutting(receiving.address(), cuts);
        let mut run = Run::start(Logging::to_tcp(between.to_string()).end_within(LONG));
        run.record(10_000);
        let report = run.finish();
        prop_assert_eq!(report.signals[0].lost, 0, "{}", report);
        let (content, _) = office.only();
        prop_assert_eq!(numbers(&content), (0..10_000).collect::<Vec<_>>());
        receiving.stop();
    }
}

/// A peer that treats each connection as given, and reports each time that it has done so.
fn peer(
    mut treat: impl FnMut(TcpStream) + Send + 'static,
) -> (String, std::sync::mpsc::Receiver<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (done, has_done) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        while let Ok((stream, _)) = listener.accept() {
            treat(stream);
            if done.send(()).is_err() {
                return;
            }
        }
    });
    (address, has_done)
}

/// Reads the hello of a system named `sender`.
fn read_hello(stream: &mut TcpStream) {
    let _ = stream.read_exact(&mut [0; 48 + 6 + 4]);
}

#[test]
fn a_stalled_peer_delays_nothing_and_all_is_counted() {
    let mut open = Vec::new();
    let (address, has_come) = peer(move |stream| open.push(stream));
    let mut run = Run::start(Logging::to_tcp(address).end_within(Duration::from_millis(50)));
    has_come.recv().unwrap();
    // Several times what waits in the memory.
    run.record(600_000);
    message(Level::Info, "test", format_args!("lost too"));
    let report = run.finish();
    assert_eq!(
        (report.signals[0].recorded, report.signals[0].lost),
        (0, 600_000)
    );
    assert_eq!((report.messages.recorded, report.messages.lost), (0, 1));
    assert!(report.error.is_some());
}

#[test]
fn wrong_peers_are_reported_as_such() {
    let answer = |version: u8, format: u8| {
        let mut bytes = b"\x89LUNET\r\n".to_vec();
        bytes.extend([version, 0, 0, 0, format, 0, 0, 0]);
        bytes.extend([0; 12]);
        bytes
    };
    for (bytes, says) in [
        (
            b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec(),
            "the peer is not LUNA's",
        ),
        (answer(7, 1), "speaks version 7.0, and this program 1.x"),
        (answer(1, 9), "format version 9.0"),
        (answer(1, 1), "damaged"),
    ] {
        let error = loop {
            let error = error_of_a_peer_that_sends(bytes.clone());
            // A peer that the machine has left no time is another matter.
            if !error.contains("in time") {
                break error;
            }
        };
        assert!(error.contains(says), "{error}");
    }
}

fn error_of_a_peer_that_sends(bytes: Vec<u8>) -> String {
    let (address, has_answered) = peer(move |mut stream| {
        read_hello(&mut stream);
        let _ = stream.write_all(&bytes);
        let _ = stream.shutdown(Shutdown::Write);
        // Until the other has read it, and closed.
        let _ = stream.read(&mut [0]);
    });
    let recording = Logging::to_tcp(address).end_within(Duration::ZERO);
    let mut run = Run::start(recording);
    run.record(10);
    // With the second connection the first is over.
    has_answered.recv().unwrap();
    has_answered.recv().unwrap();
    let report = run.finish();
    assert_eq!(report.signals[0].recorded, 0);
    report.error.unwrap()
}

/// A hello of this version.
fn hello(key: u8) -> Vec<u8> {
    let mut bytes = b"\x89LUNET\r\n\x01\0\0\0\x01\0\0\0".to_vec();
    bytes.extend([key; 8]);
    bytes.extend([0; 20]);
    bytes.extend([3, 0, 0, 0]);
    bytes.extend(b"bad");
    let checksum = !bytes.iter().fold(!0u32, |state, byte| {
        (0..8).fold(state ^ u32::from(*byte), |state, _| {
            (state >> 1) ^ if state & 1 != 0 { 0xEDB8_8320 } else { 0 }
        })
    });
    bytes.extend(checksum.to_le_bytes());
    bytes
}

#[test]
fn senders_that_are_none_disturb_no_others() {
    let (office, receiving) = tcp();
    let mut run = Run::start(Logging::to_tcp(receiving.address().to_string()).end_within(LONG));
    run.record(100);
    let say = |bytes: &[u8]| {
        let mut stream = TcpStream::connect(receiving.address()).unwrap();
        let _ = stream.write_all(bytes);
        let _ = stream.shutdown(Shutdown::Write);
        let _ = io::copy(&mut stream, &mut io::sink());
    };
    say(b"GET / HTTP/1.1\r\n\r\n");
    office.wait(|state| state.refused.contains(&PeerError::NotLuna));
    let mut other = hello(1);
    other[8] = 7;
    say(&other);
    office.wait(|state| {
        state
            .refused
            .contains(&PeerError::Version { theirs: (7, 0) })
    });
    let mut damaged = hello(1);
    damaged[20] ^= 1;
    say(&damaged);
    office.wait(|state| {
        let is_damage = |error: &PeerError| matches!(error, PeerError::Damaged(_));
        state.refused.iter().any(is_damage)
    });
    for (key, bytes) in [
        (2, &b"no block at all, of this be sure"[..]),
        (3, b"LBLK\0\0\0\0\xFF\xFF\xFF\xFFabcd"),
        (4, b"LBLK\0\0\0\0\x04\0\0\0abcdefgh"),
        (5, b"LBLK\0\0\0\0\x04\0"),
    ] {
        say(&[&hello(key)[..], bytes].concat());
    }
    office.wait(|state| {
        state
            .gone
            .iter()
            .filter(|(peer, _)| peer.system == "bad")
            .count()
            == 4
    });
    run.record(100);
    let report = run.finish();
    assert_eq!(
        (report.signals[0].recorded, report.signals[0].lost),
        (200, 0)
    );
    receiving.stop();
    let state = office.state.lock().unwrap();
    for (peer, kept) in &state.kept {
        let (content, error) = common::read(&kept.bytes());
        assert!(error.is_none(), "{error:?}");
        assert_eq!(content.has_ended, peer.system == "sender");
    }
    for (peer, gone) in state.gone.iter().filter(|(peer, _)| peer.system == "bad") {
        assert!(gone.error.is_some() && !gone.has_ended, "{peer:?} {gone:?}");
    }
}

#[test]
fn the_number_of_senders_is_limited() {
    let (office, receiving) = tcp();
    let mut there = Vec::new();
    for n in 0..64 {
        let mut stream = TcpStream::connect(receiving.address()).unwrap();
        stream.write_all(&hello(n)).unwrap();
        stream.read_exact(&mut [0; 28]).unwrap();
        there.push(stream);
    }
    let mut stream = TcpStream::connect(receiving.address()).unwrap();
    let mut answer = [0; 28];
    stream.read_exact(&mut answer).unwrap();
    assert_eq!(answer[16], 2);
    office.wait(|state| state.refused == [PeerError::Full]);
    receiving.stop();
}

fn udp() -> (Arc<Office>, Receiving) {
    let office = Arc::<Office>::default();
    let receiver = Receiver::udp("127.0.0.1:0").unwrap();
    let receiving = receiver.start(Arc::new(Keeping(office.clone()))).unwrap();
    (office, receiving)
}

#[test]
fn what_is_sent_by_udp_is_what_is_received() {
    let (office, receiving) = udp();
    let mut run = Run::start(Logging::to_udp(receiving.address().to_string()));
    // Less than a socket's buffer holds, so that none is lost on the way.
    run.record(500);
    let report = run.finish();
    assert_eq!(
        (report.signals[0].recorded, &report.error),
        (500, &None),
        "{report}"
    );
    let (content, gone) = office.only();
    assert_eq!(numbers(&content), (0..500).collect::<Vec<_>>());
    assert_eq!((gone.missing, content.system.as_str()), (0, "sender"));
    receiving.stop();
}

#[test]
fn what_udp_loses_is_counted_by_its_receiver() {
    let between = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut run = Run::start(Logging::to_udp(between.local_addr().unwrap().to_string()));
    run.record(2_000);
    let report = run.finish();
    assert_eq!(
        (report.signals[0].recorded, &report.error),
        (2_000, &None),
        "{report}"
    );
    // All are in the socket's buffer.
    between.set_nonblocking(true).unwrap();
    let mut datagrams = Vec::new();
    let mut buffer = [0; 4096];
    while let Ok(length) = between.recv(&mut buffer) {
        datagrams.push(buffer[..length].to_vec());
    }
    let last = datagrams.len() - 1;
    assert!(last >= 8, "{last}");
    // Declarations are not dropped: without them later blocks could not be read, and would be
    // missing too. A slow run declares again.
    let has = |datagram: &[u8], name: &[u8]| datagram.windows(name.len()).any(|part| part == name);
    let declares = |datagram: &[u8]| has(datagram, b"sender") || has(datagram, b"numbers");
    let declared = datagrams
        .iter()
        .position(|datagram| has(datagram, b"numbers"))
        .unwrap();
    let (office, receiving) = udp();
    let mut dropped = 0;
    for (n, datagram) in datagrams.iter().enumerate() {
        if n > declared && n < last && n % 3 == 0 && !declares(datagram) {
            dropped += 1;
        } else {
            between.send_to(datagram, receiving.address()).unwrap();
            // Twice is once.
            between.send_to(datagram, receiving.address()).unwrap();
        }
    }
    // Datagrams of another protocol disturb nothing.
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger
        .send_to(b"not a datagram of LUNA", receiving.address())
        .unwrap();
    let (content, gone) = office.only();
    assert_eq!(gone.missing, dropped);
    assert_eq!(content.lost_blocks, dropped);
    let received = numbers(&content);
    assert!(received.len() < 2_000 && received.is_sorted_by(|a, b| a < b));
    office.wait(|state| state.refused == [PeerError::NotLuna]);
    receiving.stop();
}

#[test]
fn addresses_that_are_none_are_an_error_at_the_start() {
    for recording in [
        Logging::to_tcp("recorder"),
        Logging::to_udp("recorder:"),
        Logging::to_tcp(":1"),
    ] {
        let hub = Hub::new("nowhere", Default::default());
        let error = Recorder::start(&hub, recording).unwrap_err();
        assert!(error.to_string().contains("HOST:PORT"), "{error}");
    }
}

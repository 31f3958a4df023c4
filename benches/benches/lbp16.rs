//! `lbp16`: a cycle with a Mesa card, one write and one read packet to the simulated card on
//! loopback, and a bare round trip of a datagram.

use std::{
    net::{Ipv4Addr, UdpSocket},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use hostmot2::{Client, Layout, Outputs, Selection, SequenceWindow, lbp16::Packet};
use luna::prelude::*;
use luna_benches::harness::{Case, Goal, run};
use luna_mesa::{Card, Reading, Sample};
use luna_mesa_sim::Server;

const CYCLE: &str = "cycle with a card, write and read packet";
/// Of a block.
const CYCLES: usize = 2_000;

/// A card as Jiwy has it: two encoders, two PWM generators.
fn selection() -> Selection {
    Selection {
        encoders: 2,
        pwms: 2,
        watchdog_ns: 5_000_000_000,
        ..Selection::default()
    }
}

fn median(mut samples: Vec<u64>) -> f64 {
    samples.sort_unstable();
    samples[samples.len() / 2] as f64
}

fn serve() -> Server {
    Server::start(luna_mesa_sim::Settings::default()).expect("loopback has a free port")
}

/// A round trip between two threads that block, with datagrams of the read packet's and the
/// answer's length.
fn bare() -> f64 {
    let (request, answer) = sizes();
    let far = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback has a free port");
    let address = far.local_addr().expect("it is bound");
    let over = Arc::new(AtomicBool::new(false));
    let is_over = over.clone();
    let echo = thread::spawn(move || {
        let mut bytes = [0; 2_048];
        while let Ok((_, peer)) = far.recv_from(&mut bytes) {
            if is_over.load(Ordering::Acquire) {
                return;
            }
            far.send_to(&bytes[..answer], peer).expect("a loopback");
        }
    });
    let near = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).expect("loopback has a free port");
    near.connect(address).expect("a loopback");
    let mut bytes = [0; 2_048];
    let mut samples = Vec::with_capacity(CYCLES);
    for _ in 0..CYCLES {
        let start = Instant::now();
        near.send(&bytes[..request]).expect("a loopback");
        let length = near.recv(&mut bytes).expect("a loopback");
        samples.push(start.elapsed().as_nanos() as u64);
        assert_eq!(length, answer);
    }
    over.store(true, Ordering::Release);
    near.send(&[]).expect("a loopback");
    echo.join().expect("it ends by itself");
    median(samples)
}

/// The lengths of the read packet and of its answer.
fn sizes() -> (usize, usize) {
    let server = serve();
    let mut client = Client::connect(server.address()).expect("loopback is there");
    let layout = layout(&mut client);
    let mut packet = Packet::new();
    layout.read_request(0, &mut packet).expect("it fits");
    (packet.bytes().len(), packet.answer_len())
}

fn layout(client: &mut Client) -> Layout {
    let description = client.describe().expect("it answers");
    let layout = Layout::new(&description, &selection()).expect("the card has it");
    for packet in layout.set_up().expect("it fits") {
        client.confirmed(&packet).expect("it answers");
    }
    layout
}

/// A cycle without a framework: packets made and sent, the answer received by a blocking call and
/// read.
fn blocking() -> f64 {
    let server = serve();
    let mut client = Client::connect(server.address()).expect("loopback is there");
    let layout = layout(&mut client);
    let mut sequence = client.sequence();
    let socket = client.into_socket();
    socket.set_read_timeout(None).expect("it was set before");
    let mut packet = Packet::new();
    layout.start_request(0, &mut packet).expect("it fits");
    socket.send(packet.bytes()).expect("a loopback");
    let mut outputs: Outputs = layout.outputs_at_rest();
    let mut bytes = [0; 2_048];
    let mut samples = Vec::with_capacity(CYCLES);
    for number in 1..=CYCLES as u32 {
        let start = Instant::now();
        outputs.set_duty(0, f64::from(number % 100) / 100.0);
        layout
            .write_request(number, &outputs, &mut packet)
            .expect("it fits");
        socket.send(packet.bytes()).expect("a loopback");
        sequence = sequence.wrapping_add(1);
        layout.read_request(sequence, &mut packet).expect("it fits");
        socket.send(packet.bytes()).expect("a loopback");
        let length = socket.recv(&mut bytes).expect("a loopback");
        let answer = layout.decode(&bytes[..length]).expect("an answer");
        samples.push(start.elapsed().as_nanos() as u64);
        assert_eq!(answer.sequence, sequence);
        let window = SequenceWindow {
            first: 0,
            last: number,
        };
        assert_eq!(answer.echo_state(window), hostmot2::EchoState::UpToDate);
    }
    median(samples)
}

/// The link's whole cycle, by its loop's statistics: outputs received, both packets made and sent,
/// the answer awaited by the executor, checked and reported.
fn link() -> f64 {
    let server = serve();
    let card = Card::open(server.address()).expect("it answers");
    let period = Duration::from_millis(1);
    let mut link = card.link("card", period);
    let (duty, duties) = luna::buffered(Buffer::overwrite_oldest(1));
    let (count, counts) = luna::buffered::<Sample<Reading>>(Buffer::fifo(16));
    link.watchdog(Duration::from_secs(5))
        .tolerance(luna_mesa::Bucket::new(1, 1, 1_000))
        .pwm(0, duties)
        // Slow enough for any pause that a busy machine makes.
        .encoder(1, 1e3, count);
    let process = link.process().expect("the card has it");
    let mut system = System::new("bench");
    let main = system.executor("main").build().expect("a name of its own");
    let control = main.process("control").spawn(async move {
        let mut fresh = 0;
        while fresh < CYCLES {
            fresh += usize::from(counts.recv().await?.fresh().is_some());
            duty.send(0.1).await?;
        }
        Ok(())
    });
    control.expect("a name of its own");
    let card = main.process("card").spawn(process);
    card.expect("a name of its own");
    drop(main);
    let report = system.run().expect("the card answers");
    report.loops["card"].run_time.percentile(50.0).as_nanos() as f64
}

const BARE: &str = "bare UDP round trip";

fn main() {
    let beside = |of| Goal::Times {
        factor: 2.0,
        name: CYCLE,
        peer: BARE,
        size: None,
        of,
    };
    let cases = vec![
        Case::once(CYCLE, "LUNA, the link in an executor", "ns/cycle", link)
            .goal(Goal::AtMost(60_000.0))
            .goal(beside("a bare round trip")),
        Case::once(CYCLE, "LUNA, hostmot2 by hand", "ns/cycle", blocking)
            .goal(Goal::AtMost(60_000.0))
            .goal(beside("a bare round trip")),
        Case::once(CYCLE, BARE, "ns/cycle", bare),
    ];
    run("lbp16", cases);
}

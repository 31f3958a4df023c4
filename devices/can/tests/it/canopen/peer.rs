//! LUNA beside python-canopen, the maintained implementation in Python, in both roles.
//!
//! The peer is a program of its own. python-can connects it as a client of socketcand, whose
//! protocol a node of the simulated bus speaks here. `.ci/run night` makes a Python that has the
//! packages, and names it in `LUNA_FIELDBUS_PYTHON`.

use super::{id, master, node};
use crate::common::{Bench, SpawnOk, skip, watchdog};
use luna::prelude::*;
use luna_can::canopen::sim::Access;
use luna_can::canopen::{
    AbortCode, Direction, NmtCommand, NmtState, NodeEvent, Object, OnMissed, PdoSetting, SdoError,
    Transmission,
};
use luna_can::{Event, Frame};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::Duration;

const NAME: Object = Object::new(0x1008, 0);
const HEARTBEAT: Object = Object::new(0x1017, 0);
const PROGRAM: Object = Object::new(0x2000, 0);
const SECRET: Object = Object::new(0x2001, 0);
const CONTROL: Object = Object::new(0x6040, 0);
const STATUS: Object = Object::new(0x6041, 0);
const POSITION: Object = Object::new(0x6064, 0);
const TARGET: Object = Object::new(0x607A, 0);

/// A busy machine answers within it.
const LIMIT: Duration = Duration::from_secs(30);

/// The peer's program, and what is closed when it has left the bus.
struct Peer {
    child: Child,
    left: Receiver<()>,
}

impl Peer {
    /// Starts the program in this role as a node of the bus; none without its packages.
    fn start(bench: &mut Bench, role: &str) -> Option<Self> {
        let Some(python) = std::env::var_os("LUNA_FIELDBUS_PYTHON") else {
            skip("python-canopen: set LUNA_FIELDBUS_PYTHON to a Python with the package `canopen`");
            return None;
        };
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let child = Command::new(python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peer.py"))
            .args([role, &listener.local_addr().unwrap().port().to_string()])
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (stream, _) = listener.accept().unwrap();
        let left = bridge(bench, stream);
        Some(Self { child, left })
    }

    fn end(self) {
        let output = self.child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "the peer: {said}");
    }
}

/// Makes a client of socketcand a node of the bus, until it hangs up. Then the channel ends.
fn bridge(bench: &mut Bench, mut stream: TcpStream) -> Receiver<()> {
    stream.set_nodelay(true).unwrap();
    let mut input = BufReader::new(stream.try_clone().unwrap());
    write!(stream, "< hi >").unwrap();
    assert_eq!(command(&mut input).unwrap(), "open luna");
    write!(stream, "< ok >").unwrap();
    assert_eq!(command(&mut input).unwrap(), "rawmode");
    write!(stream, "< ok >").unwrap();

    let peer = bench.node("peer");
    let (is_there, gone) = luna::channel::<()>();
    let (is_over, left) = luna::channel::<()>();
    let (send, is_there) = (peer.send.clone().external(), is_there.external());
    std::thread::spawn(move || {
        while let Some(text) = command(&mut input) {
            let frame = sent(&text).unwrap_or_else(|| panic!("no frame: {text}"));
            if send.blocking_send(frame).is_err() {
                break;
            }
        }
        drop(is_there);
    });
    bench.main.process("bridge").spawn_ok(async move {
        let gone = gone.external();
        loop {
            let frame = luna::alt! {
                _ = gone.recv() => break,
                frame = peer.received.recv() => frame?,
            };
            let data: String = frame
                .data()
                .iter()
                .map(|byte| format!("{byte:02X}"))
                .collect();
            let id = frame.standard_id().expect("CANopen has 11 bits");
            // The peer may hang up before it has read all.
            let text = format!("< frame {id:03X} 0.0 {data} >");
            let _ = stream.write_all(text.as_bytes());
        }
        drop(is_over);
        Ok(())
    });
    left
}

/// The next command of the client, without its brackets; none when it has hung up.
fn command(input: &mut impl BufRead) -> Option<String> {
    let mut text = String::new();
    for byte in input.bytes() {
        match char::from(byte.ok()?) {
            '<' => text.clear(),
            '>' => return Some(text.trim().to_owned()),
            other => text.push(other),
        }
    }
    None
}

/// The frame of `send ID LENGTH BYTES`.
fn sent(text: &str) -> Option<Frame> {
    let mut words = text.strip_prefix("send ")?.split_whitespace();
    let id = u16::from_str_radix(words.next()?, 16).ok()?;
    let len: usize = words.next()?.parse().ok()?;
    let bytes: Result<Vec<u8>, _> = words.map(|word| u8::from_str_radix(word, 16)).collect();
    Frame::standard(id, &bytes.ok().filter(|bytes| bytes.len() == len)?)
}

/// Why a node refuses.
fn code(refused: Result<(), SdoError>) -> AbortCode {
    match refused {
        Err(SdoError::Aborted { code, .. }) => code,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_node_of_python_canopen_is_set_up_and_worked_with() {
    let _watch = watchdog();
    let mut bench = Bench::in_real_time();
    let Some(peer) = Peer::start(&mut bench, "slave") else {
        return;
    };
    let left = peer.left.clone();
    let (event, events) = luna::buffered(Buffer::fifo(64));
    let mut network = master(&mut bench).events(event);
    let (note, notes) = luna::buffered(Buffer::fifo(64));
    let consumer = network
        .heartbeats(note)
        .watch(id(), LIMIT, OnMissed::Report);
    let (emergency, emergencies) = luna::buffered(Buffer::fifo(4));
    network.emergencies(emergency);
    let (value, values) = luna::buffered::<(u16, i32)>(Buffer::fifo(4));
    let (transmitted, received) = (id().tpdo(1).unwrap(), id().rpdo(1).unwrap());
    network.tpdo(transmitted, value).unwrap();
    let (target, targets) = luna::channel::<(u16, i32)>();
    let producer = network.rpdo(received, targets).unwrap();
    let (mut sdo, nmt) = (network.sdo(id()).unwrap().timeout(LIMIT), network.nmt());
    let counts = network.counts();
    let is_done = Arc::new(AtomicBool::new(false));
    let was_done = is_done.clone();
    bench.main.process("watch").spawn_ok(async move {
        assert!(left.recv().await.is_err_and(|error| error.is_closed()));
        match was_done.load(SeqCst) {
            true => Ok(()),
            // The others wait for it.
            false => Err(luna::emergency(luna::Error::other("the peer left early"))),
        }
    });
    bench.main.process("heartbeats").spawn_ok(consumer);
    bench.main.process("target").spawn_ok(producer);
    bench.main.process("master").spawn_ok(network.controller());
    bench.main.process("user").spawn_ok(async move {
        assert_eq!(notes.recv().await?, NodeEvent::BootUp(id()));
        assert_eq!(sdo.read::<u32>(Object::new(0x1000, 0)).await?, 0x0002_0192);
        let name = "a device of python-canopen, with a long name";
        assert_eq!(sdo.upload(NAME).await?, name.as_bytes());
        for len in [1, 4, 5, 7, 8, 14, 100] {
            let program: Vec<u8> = (0..len).collect();
            sdo.download(PROGRAM, &program).await?;
            assert_eq!(sdo.upload(PROGRAM).await?, program, "{len}");
        }
        let none = Object::new(0x5000, 0);
        assert_eq!(code(sdo.upload(none).await.map(drop)), AbortCode::NO_OBJECT);
        let no_sub = Object::new(0x1800, 9);
        assert_eq!(
            code(sdo.upload(no_sub).await.map(drop)),
            AbortCode::NO_SUBINDEX
        );
        assert_eq!(code(sdo.write(STATUS, 0_u16).await), AbortCode::READ_ONLY);
        assert_eq!(
            code(sdo.upload(SECRET).await.map(drop)),
            AbortCode::WRITE_ONLY
        );
        assert_eq!(
            code(sdo.write(CONTROL, 0_u32).await),
            AbortCode::WRONG_LENGTH
        );
        sdo.write(HEARTBEAT, 20_u16).await?;
        let state = |state| NodeEvent::State(id(), state);
        assert_eq!(notes.recv().await?, state(NmtState::PreOperational));

        PdoSetting::new(Direction::Tpdo, 1, transmitted, Transmission::OnEvent)?
            .map::<u16>(STATUS)?
            .map::<i32>(POSITION)?
            .write(&mut sdo)
            .await?;
        PdoSetting::new(Direction::Rpdo, 1, received, Transmission::OnEvent)?
            .map::<u16>(CONTROL)?
            .map::<i32>(TARGET)?
            .write(&mut sdo)
            .await?;
        nmt.command(NmtCommand::Start, Some(id())).await?;
        assert_eq!(notes.recv().await?, state(NmtState::Operational));
        target.send((0xF, -123_456)).await?;
        // The shorter one before them is for none of its objects.
        assert_eq!(values.recv().await?, (0x237, -70_000));
        assert_eq!(values.recv().await?, (0x238, -70_001));
        assert!(matches!(events.try_recv(), Ok(Event::Malformed { .. })));
        let emergency = emergencies.recv().await?;
        assert_eq!((emergency.node, emergency.code), (id(), 0x8130));
        assert_eq!((emergency.register, &emergency.data), (0x11, b"peer!"));
        is_done.store(true, SeqCst);
        nmt.command(NmtCommand::Stop, None).await?;
        Ok(())
    });
    let ran = bench.run();
    peer.end();
    ran.unwrap();
    assert_eq!(counts.malformed(), 1);
}

#[test]
fn a_simulated_node_is_set_up_and_worked_with_by_python_canopen() {
    let _watch = watchdog();
    let mut bench = Bench::in_real_time();
    let Some(peer) = Peer::start(&mut bench, "master") else {
        return;
    };
    let left = peer.left.clone();
    let control = node(&mut bench, |node| {
        node.bytes(
            NAME,
            b"a simulated node of LUNA, with a long name",
            Access::ReadOnly,
        )
        .bytes(PROGRAM, &[], Access::ReadWrite)
        .object(SECRET, 0_u8, Access::WriteOnly)
        .object(STATUS, 0_u16, Access::ReadOnly)
        .object(CONTROL, 0_u16, Access::ReadWrite)
        .object(POSITION, 0_i32, Access::ReadOnly)
        .object(TARGET, 0_i32, Access::ReadWrite)
    });
    bench.main.process("user").spawn_ok(async move {
        // What the hardware of the node does: it goes where it is to go.
        let mut tick = luna::periodic("drive", Duration::from_millis(1))?;
        while control.get::<u16>(CONTROL) != Some(0xF) {
            tick.next().await;
            // What went wrong there is printed below.
            if left.try_recv().is_err_and(|error| error.is_closed()) {
                return Ok(());
            }
        }
        assert_eq!(control.get::<i32>(TARGET), Some(-123_456));
        control.set(STATUS, 0x237_u16).await?;
        control.set(POSITION, -70_000_i32).await?;
        control.emergency(0x8130, 0x11, *b"LUNA!").await?;
        assert!(left.recv().await.is_err_and(|error| error.is_closed()));
        assert_eq!(control.state(), NmtState::Stopped);
        Ok(())
    });
    let ran = bench.run();
    peer.end();
    ran.unwrap();
}

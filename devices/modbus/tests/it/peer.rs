//! LUNA beside pymodbus, the maintained implementation in Python, in both roles.
//!
//! The peer is a program of its own. `.ci/run night` makes a Python that has the package, and names
//! it in `LUNA_FIELDBUS_PYTHON`.

use crate::common::{AT_ONCE, LONG, PERIOD, SpawnOk, newest, skip, until, with_files};
use luna::prelude::*;
use luna_modbus::{AnswerUnit, Code, Event, RequestError, coil, discrete, holding, input, sim};
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::process::{Child, ChildStdin, Command, Stdio};

/// The peer's program with these arguments; none without its package.
fn peer(arguments: &[&str]) -> Option<Command> {
    let Some(python) = std::env::var_os("LUNA_FIELDBUS_PYTHON") else {
        skip("pymodbus: set LUNA_FIELDBUS_PYTHON to a Python with the package `pymodbus`");
        return None;
    };
    let mut command = Command::new(python);
    command
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/peer.py"))
        .args(arguments);
    Some(command)
}

/// A server of pymodbus. It ends with its input.
struct Server {
    child: Child,
    input: ChildStdin,
    address: SocketAddr,
}

impl Server {
    fn start(arguments: &[&str]) -> Option<Self> {
        let mut command = peer(&[&["server"], arguments].concat())?;
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut port = String::new();
        let output = child.stdout.take().unwrap();
        BufReader::new(output).read_line(&mut port).unwrap();
        Some(Self {
            input: child.stdin.take().unwrap(),
            address: ([127, 0, 0, 1], port.trim().parse().unwrap()).into(),
            child,
        })
    }

    fn end(mut self) {
        drop(self.input);
        assert!(self.child.wait().unwrap().success());
    }
}

/// All types from all tables, all writes, and a refusal; then again where the server answers as
/// another unit than it is asked as.
#[test]
fn a_server_of_pymodbus_is_read_and_written() {
    for (unit, answers, arguments) in [
        (1, AnswerUnit::Asked, &[][..]),
        (0, AnswerUnit::Asked, &[]),
        (255, AnswerUnit::Asked, &[]),
        (255, AnswerUnit::Is(0), &["0"]),
        (0, AnswerUnit::Any, &["17"]),
    ] {
        let Some(_watch) = with_files() else { return };
        let Some(server) = Server::start(arguments) else {
            return;
        };
        let mut system = System::new("plant");
        let device = luna_modbus::open(&system.devices(), server.address).unwrap();
        let (event, events) = luna::buffered(Buffer::fifo(64));
        let (bit, bits) = newest();
        let (other_bit, other_bits) = newest();
        let (word, words) = newest::<u16>();
        let (signed, signeds) = newest::<i32>();
        let (wide, wides) = newest::<u32>();
        let (float, floats) = newest::<f32>();
        let (back, backs) = newest::<f32>();
        let (absent, nothing) = newest::<u16>();
        let (switch, switches) = newest::<bool>();
        let (speed, speeds) = newest::<u16>();
        let (target, targets) = newest::<f32>();
        let client = luna_modbus::client(&device, PERIOD, event)
            .and_then(|client| client.timeout(LONG))
            .unwrap()
            .reconnect(AT_ONCE)
            .unit(unit)
            .answer_unit(answers)
            .read(coil(3), bit)
            .and_then(|client| client.read(discrete(1), other_bit))
            .and_then(|client| client.read(input(0), word))
            .and_then(|client| client.read(input(1), signed))
            .and_then(|client| client.read(input(3), wide))
            .and_then(|client| client.read(holding(2), float))
            .and_then(|client| client.read(holding(50), back))
            .and_then(|client| client.read(input(5_000), absent))
            .and_then(|client| client.write(coil(3), switches))
            .and_then(|client| client.write(holding(49), speeds))
            .and_then(|client| client.write(holding(50), targets))
            .unwrap();
        let counts = client.counts();
        let main = system.executor("main").build().unwrap();
        main.process("client").spawn_ok(client);
        main.process("user").spawn_ok(async move {
            assert_eq!(events.recv().await?, Event::Connected);
            let Event::ReadRefused(error) = events.recv().await? else {
                panic!("no refusal")
            };
            let (request, code) = (error.request(), Code::IllegalAddress);
            assert_eq!(error, RequestError::Exception { request, code });
            assert!(bits.recv().await? && other_bits.recv().await?);
            assert_eq!(words.recv().await?, 60_000);
            assert_eq!(signeds.recv().await?, -70_000);
            assert_eq!(wides.recv().await?, 3_000_000_000);
            assert_eq!(floats.recv().await?, -1.5);
            switch.send(false).await?;
            speed.send(1_500).await?;
            target.send(21.25).await?;
            until(&bits, false).await?;
            until(&backs, 21.25).await?;
            assert!(events.try_recv().is_err());
            drop(nothing);
            Ok(())
        });
        drop(device);
        let ran = system.run();
        server.end();
        ran.unwrap();
        assert_eq!((counts.written(), counts.write_failures()), (3, 0));
        assert_eq!((counts.connections(), counts.garbage()), (1, 0));
    }
}

#[test]
fn the_simulated_server_answers_a_client_of_pymodbus() {
    let Some(_watch) = with_files() else { return };
    let server = sim::Server::start().unwrap();
    server.set(discrete(3), true).unwrap();
    server.set(input(4), 21.5_f32).unwrap();
    let port = server.address().port().to_string();
    let Some(mut client) = peer(&["client", &port]) else {
        return;
    };
    let output = client.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "the peer: {said}");
    assert_eq!(server.get(holding::<u16>(10)).unwrap(), 0xABCD);
    assert_eq!(server.get(holding::<u16>(139)).unwrap(), 1_119);
}

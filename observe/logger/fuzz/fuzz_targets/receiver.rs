//! Any bytes from a sender: the receiver must not panic, must use no more memory than a block, and
//! must keep serving.
//!
//! The first byte selects the form: the bytes alone, behind a valid hello, or as records of a block
//! with a valid checksum; each over TCP and over UDP.
#![no_main]

use libfuzzer_sys::fuzz_target;
use luna_logger::{Handler, Peer, Receiver, Receiving, Sink, WriterSink};
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream, UdpSocket};
use std::sync::{Arc, OnceLock};

struct Forget;

impl Handler for Forget {
    fn open(&self, _: &Peer) -> io::Result<Box<dyn Sink>> {
        Ok(Box::new(WriterSink::new(io::sink())))
    }
}

struct There {
    tcp: Receiving,
    udp: Receiving,
    socket: UdpSocket,
}

fn there() -> &'static There {
    static THERE: OnceLock<There> = OnceLock::new();
    THERE.get_or_init(|| There {
        tcp: Receiver::tcp("127.0.0.1:0")
            .and_then(|receiver| receiver.start(Arc::new(Forget)))
            .expect("there is a loopback"),
        udp: Receiver::udp("127.0.0.1:0")
            .and_then(|receiver| receiver.start(Arc::new(Forget)))
            .expect("there is a loopback"),
        socket: UdpSocket::bind("127.0.0.1:0").expect("there is a loopback"),
    })
}

/// Bit by bit, as the standard has it.
fn crc32(bytes: &[u8]) -> [u8; 4] {
    let sum = !bytes.iter().fold(!0u32, |state, byte| {
        (0..8).fold(state ^ u32::from(*byte), |state, _| {
            (state >> 1) ^ if state & 1 != 0 { 0xEDB8_8320 } else { 0 }
        })
    });
    sum.to_le_bytes()
}

fn with_checksum(bytes: Vec<u8>) -> Vec<u8> {
    let sum = crc32(&bytes);
    [bytes, sum.to_vec()].concat()
}

const PREFIX: &[u8] = b"\x89LUNET\r\n\x01\0\0\0\x01\0\0\0";

fn hello(key: [u8; 8]) -> Vec<u8> {
    with_checksum([PREFIX, &key, &[0; 20], &[3, 0, 0, 0], b"bad"].concat())
}

fn block(records: &[u8]) -> Vec<u8> {
    let numbers = [0u32.to_le_bytes(), (records.len() as u32).to_le_bytes()].concat();
    let sum = crc32(&[&numbers, records].concat());
    [b"LBLK", &numbers[..], &sum, records].concat()
}

fuzz_target!(|input: &[u8]| {
    let Some((choice, bytes)) = input.split_first() else {
        return;
    };
    let there = there();
    // A key of its own, so that each is another sender.
    let mut key = [0; 8];
    let length = bytes.len().min(8);
    key[..length].copy_from_slice(&bytes[..length]);
    let said = match choice % 3 {
        0 => bytes.to_vec(),
        1 => [hello(key), bytes.to_vec()].concat(),
        _ => [hello(key), block(bytes)].concat(),
    };
    let datagram = match choice % 3 {
        0 => bytes.to_vec(),
        other => {
            let head = with_checksum([PREFIX, &key, &[0; 12]].concat());
            let bytes = if other == 1 { bytes.to_vec() } else { block(bytes) };
            [head, bytes].concat()
        }
    };
    // Datagrams may be lost; nothing waits for them.
    let _ = there.socket.send_to(&datagram, there.udp.address());
    let mut stream = TcpStream::connect(there.tcp.address()).expect("the receiver goes on");
    let _ = stream.write_all(&said);
    let _ = stream.shutdown(Shutdown::Write);
    // Read until the receiver closes the connection. Its answer is short.
    let _ = stream.read_to_end(&mut Vec::new());
});

use super::super::wire::{HELLO, ack_bytes, answer_bytes};
use super::*;
use crate::format::Record;
use std::io::Read;
use std::net::TcpListener;

const SYSTEM: &str = "test";

/// A sender of two blocks, its sink, and the number of bytes of the blocks.
fn link(address: String) -> (TcpSink, Link, usize) {
    let mut sink = TcpSink::new(address.clone());
    let mut encoder = Encoder::new();
    let mut bytes = 0;
    for time in 0..2 {
        encoder.put(&Record::Epoch { time, unix: 0 });
        let block = encoder.block().to_vec();
        bytes += block.len();
        sink.block(&block).unwrap();
        encoder.next();
    }
    let link = Link {
        address,
        shared: sink.shared.clone(),
        key: Key::new(),
        started: 0,
        system: SYSTEM.to_owned(),
        said: HashSet::new(),
    };
    (sink, link, bytes)
}

#[test]
fn only_a_receiver_that_gets_on_is_soon_asked_again() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (_sink, mut link, bytes) = link(listener.local_addr().unwrap().to_string());
    // Accepts each connection, reads both blocks, and acknowledges this many.
    let receiver = std::thread::spawn(move || {
        for acknowledged in [0, 1] {
            let (mut stream, _) = listener.accept().unwrap();
            let mut hello = vec![0; HELLO + SYSTEM.len() + 4];
            stream.read_exact(&mut hello).unwrap();
            stream.write_all(&answer_bytes(Ok(0))).unwrap();
            stream.read_exact(&mut vec![0; bytes]).unwrap();
            for number in 1..=acknowledged {
                stream.write_all(&ack_bytes(number)).unwrap();
            }
        }
    });
    let long = 20 * BACK_OFF.0;
    let mut pause = long;
    assert!(matches!(link.connection(&mut pause), Over::Broken(_)));
    assert_eq!((pause, link.shared.lock().first), (long, 0));
    assert!(matches!(link.connection(&mut pause), Over::Broken(_)));
    assert_eq!((pause, link.shared.lock().first), (BACK_OFF.0, 1));
    receiver.join().unwrap();
}

#[test]
fn a_receiver_without_room_is_asked_seldom() {
    let (_sink, mut link, _) = link("localhost:1".to_owned());
    let no_room = io::Error::other(PeerError::NoRoom);
    assert_eq!(link.note(&no_room), Some(NO_ROOM));
    assert!(NO_ROOM > BACK_OFF.1);
    for other in [PeerError::Full, PeerError::Silent] {
        assert_eq!(link.note(&io::Error::other(other)), None);
    }
    assert_eq!(link.note(&ErrorKind::ConnectionReset.into()), None);
}

#[test]
fn a_recording_that_ends_asks_once_more_whether_there_is_room() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (mut sink, mut link, bytes) = link(listener.local_addr().unwrap().to_string());
    let shared = sink.shared.clone();
    let sender = std::thread::spawn(move || link.run());
    let receiver = std::thread::spawn(move || {
        for has_room in [false, true] {
            let (mut stream, _) = listener.accept().unwrap();
            let mut hello = vec![0; HELLO + SYSTEM.len() + 4];
            stream.read_exact(&mut hello).unwrap();
            if !has_room {
                stream
                    .write_all(&answer_bytes(Err(PeerError::NoRoom)))
                    .unwrap();
                continue;
            }
            stream.write_all(&answer_bytes(Ok(0))).unwrap();
            stream.read_exact(&mut vec![0; bytes]).unwrap();
            for number in 1..=2 {
                stream.write_all(&ack_bytes(number)).unwrap();
            }
        }
    });
    while shared.lock().error.is_none() {
        std::thread::yield_now();
    }
    // Before the pause for room is over.
    sink.end(2 * NO_ROOM / 3).unwrap();
    sender.join().unwrap();
    receiver.join().unwrap();
}

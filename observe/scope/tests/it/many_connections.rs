//! Many slow connections, and what a scope that ends does for its viewers.

use crate::server::{Recording, get, settings, view, words, words_of};
use luna_logger::Sink;
use luna_logger::format::Record;
use luna_scope::Scope;
use serde_json::Value;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;

/// Connections that send a byte and wait displace each other alone.
#[test]
fn five_hundred_slow_connections_shut_nobody_out() {
    let scope = Scope::open(settings()).unwrap();
    let mut sink = scope.sink().unwrap();
    let mut recording = Recording::begin(&mut sink);
    recording.give(10, &mut sink);
    let mut looks = view(&scope);
    words_of(&mut looks, "begin");
    let slow: Vec<TcpStream> = (0..500)
        .map(|_| {
            let mut stream = TcpStream::connect(scope.address()).unwrap();
            stream.write_all(b"G").unwrap();
            stream
        })
        .collect();

    // What is sent from now on arrives at the one that looks already.
    recording.give(100, &mut sink);
    while words_of(&mut looks, "loops")["loops"][0]["count"] != 110 {}
    // Others get the page, and can look too.
    assert_eq!(get(&scope, "/main.js", "Host: localhost"), 200);
    let mut late = view(&scope);
    words_of(&mut late, "hello");
    assert_eq!(scope.viewers(), 2);
    let is_closed = |mut stream: &TcpStream| {
        stream.set_nonblocking(true).unwrap();
        !matches!(stream.read(&mut [0; 8]), Err(error) if error.kind() == ErrorKind::WouldBlock)
    };
    let closed = slow.iter().filter(|stream| is_closed(stream)).count();
    assert!(closed >= 500 - 32, "{closed}");
}

/// Nor do those that ask for the page and do not take it.
#[test]
fn five_hundred_that_take_no_answer_shut_nobody_out() {
    let scope = Scope::open(settings()).unwrap();
    let request = b"GET /signals.js HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let slow: Vec<TcpStream> = (0..500)
        .map(|n| {
            let mut stream = TcpStream::connect(scope.address()).unwrap();
            // A refused request is drained, which waits for the client too.
            let refused = b"POST / HTTP/1.1\r\nHost: localhost\r\n\r\n";
            let request: &[u8] = if n % 2 == 0 { request } else { refused };
            // One that was displaced meanwhile cannot send any more.
            let _ = stream.write_all(request);
            stream
        })
        .collect();
    words_of(&mut view(&scope), "hello");
    assert_eq!(get(&scope, "/", "Host: localhost"), 200);
    drop(slow);
}

/// Also what was given right before, and how the run ended.
#[test]
fn a_scope_that_is_dropped_sends_the_rest() {
    let scope = Scope::open(settings()).unwrap();
    let mut sink = scope.sink().unwrap();
    let mut recording = Recording::begin(&mut sink);
    recording.give(10, &mut sink);
    let mut viewer = view(&scope);
    words_of(&mut viewer, "begin");
    recording.give(40, &mut sink);
    recording.encoder.put(&Record::End { time: 7 });
    sink.block(recording.encoder.block()).unwrap();
    scope.ended("completed");
    // It returns when the viewer has taken all of it.
    let dropped = std::thread::spawn(move || drop(scope));
    let (mut cycles, mut report) = (Value::Null, Value::Null);
    while let Some(word) = words(&mut viewer) {
        match word["type"].as_str() {
            Some("loops") => cycles = word["loops"][0]["count"].clone(),
            Some("status") => report = word["status"]["report"].clone(),
            _ => {}
        }
    }
    assert_eq!((cycles, report), (50.into(), "completed".into()));
    drop(viewer);
    dropped.join().unwrap();
}

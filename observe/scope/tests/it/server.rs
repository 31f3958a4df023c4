//! Access checks, and clients that violate the protocol. The requests are written by hand, since no
//! client would send them.

use crate::support::machine;

use luna_logger::Sink;
use luna_logger::format::{Encoder, Record};
use luna_scope::{Parameter, Parameters, Scope, Settings, Speed};
use machine::{Machine, PERIOD};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tungstenite::{Message, WebSocket};

pub(crate) fn settings() -> Settings {
    Settings::default().address(([127, 0, 0, 1], 0).into())
}

/// The status that a request gets, and what follows its headers.
fn ask(scope: &Scope, request: &[u8]) -> (u16, String) {
    let mut stream = TcpStream::connect(scope.address()).unwrap();
    stream.write_all(request).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    let status = answer.split(' ').nth(1).unwrap().parse().unwrap();
    let body = answer.split_once("\r\n\r\n").unwrap().1;
    (status, body.to_owned())
}

pub(crate) fn get(scope: &Scope, path: &str, headers: &str) -> u16 {
    ask(
        scope,
        format!("GET {path} HTTP/1.1\r\n{headers}\r\n\r\n").as_bytes(),
    )
    .0
}

fn upgrade(headers: &str) -> String {
    format!(
        "{headers}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="
    )
}

pub(crate) fn view(scope: &Scope) -> WebSocket<TcpStream> {
    let stream = TcpStream::connect(scope.address()).unwrap();
    let url = format!("ws://{}/live", scope.address());
    tungstenite::client(url, stream).unwrap().0
}

/// The scope's next message, without its blocks; none after it has closed the connection.
pub(crate) fn words(socket: &mut WebSocket<TcpStream>) -> Option<Value> {
    loop {
        match socket.read() {
            Ok(Message::Text(text)) => return Some(serde_json::from_str(&text).unwrap()),
            Ok(Message::Close(_)) | Err(_) => return None,
            Ok(_) => {}
        }
    }
}

pub(crate) fn words_of(socket: &mut WebSocket<TcpStream>, of: &str) -> Value {
    loop {
        let word = words(socket).expect("the scope is there");
        if word["type"] == of {
            return word;
        }
    }
}

/// Waits for what another thread does.
pub(crate) fn until(mut condition: impl FnMut() -> bool) {
    while !condition() {
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn the_page_and_all_its_parts_are_there() {
    let scope = Scope::open(settings()).unwrap();
    let (status, page) = ask(&scope, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert_eq!(status, 200);
    assert!(page.contains("LUNA scope"));
    for path in ["/main.js", "/style.css", "/icon.svg", "/decode.js?x=1"] {
        assert_eq!(get(&scope, path, "Host: localhost"), 200, "{path}");
    }
    let (status, body) = ask(&scope, b"HEAD / HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert_eq!((status, body.as_str()), (200, ""));
}

#[test]
fn wrong_requests_are_refused_by_what_is_wrong() {
    let scope = Scope::open(settings()).unwrap();
    for path in [
        "/no",
        "/../Cargo.toml",
        "//main.js",
        "/live/",
        "http://localhost/",
        "*",
    ] {
        assert_eq!(get(&scope, path, "Host: localhost"), 404, "{path}");
    }
    assert_eq!(get(&scope, "/live", "Host: localhost"), 426);
    assert_eq!(get(&scope, "/", "Host: evil.example"), 421);
    assert_eq!(get(&scope, "/", "X: no host"), 400);
    let post = b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n";
    assert_eq!(ask(&scope, post).0, 405);
    assert_eq!(ask(&scope, b"\x16\x03\x01 is TLS\r\n\r\n").0, 400);
    assert_eq!(
        get(&scope, "/", "Host: localhost\r\nContent-Length: 9"),
        413
    );
}

#[test]
fn oversized_requests_are_refused() {
    let scope = Scope::open(settings()).unwrap();
    let long = "x".repeat(9 << 10);
    assert_eq!(get(&scope, &format!("/{long}"), "Host: localhost"), 431);
    assert_eq!(
        get(&scope, "/", &format!("Host: localhost\r\nX: {long}")),
        431
    );
    // It need not end to be too long.
    assert_eq!(ask(&scope, format!("GET /{long}").as_bytes()).0, 431);
    let many = "X: y\r\n".repeat(100);
    assert_eq!(get(&scope, "/", &format!("{many}Host: localhost")), 431);
}

#[test]
fn foreign_origins_and_hosts_get_no_data() {
    let scope = Scope::open(settings().host("robot.local")).unwrap();
    let port = scope.address().port();
    for (host, origin) in [
        (
            format!("localhost:{port}"),
            "http://evil.example".to_owned(),
        ),
        (format!("localhost:{port}"), "null".to_owned()),
        (
            format!("localhost:{port}"),
            format!("https://localhost:{port}"),
        ),
        (format!("localhost:{port}"), "http://localhost:1".to_owned()),
    ] {
        let headers = upgrade(&format!("Host: {host}\r\nOrigin: {origin}"));
        assert_eq!(get(&scope, "/live", &headers), 403, "{host} {origin}");
    }
    // An attacker's host name that resolves to this address, with its origin.
    let rebound = upgrade("Host: evil.example\r\nOrigin: http://evil.example");
    assert_eq!(get(&scope, "/live", &rebound), 421);
    assert_eq!(scope.viewers(), 0);
    assert_eq!(get(&scope, "/", "Host: robot.local:1234"), 200);
}

#[test]
fn the_number_of_viewers_is_limited() {
    let scope = Scope::open(settings().viewers(2)).unwrap();
    let mut first = view(&scope);
    let mut second = view(&scope);
    words_of(&mut first, "hello");
    words_of(&mut second, "hello");
    assert_eq!(scope.viewers(), 2);
    assert_eq!(get(&scope, "/live", &upgrade("Host: localhost")), 503);
    drop(first);
    until(|| scope.viewers() == 1);
    let mut third = view(&scope);
    words_of(&mut third, "hello");
}

#[test]
fn the_size_of_a_viewers_messages_is_limited() {
    let scope = Scope::open(settings()).unwrap();
    let long = json!({"type": "token", "token": "x".repeat(5000)}).to_string();
    for rude in [
        Message::text(long),
        Message::text("nonsense"),
        Message::binary(vec![1, 2, 3]),
    ] {
        let mut viewer = view(&scope);
        words_of(&mut viewer, "hello");
        viewer.send(rude).unwrap();
        while words(&mut viewer).is_some() {}
    }
    until(|| scope.viewers() == 0);
}

/// A recording of this many cycles, as blocks of a recorder.
pub(crate) struct Recording {
    pub(crate) encoder: Encoder,
    machine: Machine,
}

impl Recording {
    pub(crate) fn begin(sink: &mut impl Sink) -> Recording {
        sink.begin(&Encoder::head()).unwrap();
        Recording {
            encoder: Encoder::new(),
            machine: Machine::new(),
        }
    }

    /// Sends this many more cycles. Returns how many blocks were refused.
    pub(crate) fn give(&mut self, cycles: u64, sink: &mut impl Sink) -> u64 {
        let mut refused = 0;
        let Recording { encoder, machine } = self;
        let to = (machine.cycles() + cycles) * PERIOD;
        let mut block = |encoder: &mut Encoder| match sink.block(encoder.block()) {
            Ok(()) => encoder.next(),
            Err(_) => {
                refused += 1;
                encoder.discard();
            }
        };
        machine.until(to, &mut |record| {
            encoder.put(record);
            if encoder.is_full() {
                block(encoder);
            }
        });
        if !encoder.is_empty() {
            block(encoder);
        }
        refused
    }
}

#[test]
fn a_stalled_viewer_delays_nothing_and_is_disconnected() {
    let scope = Scope::open(settings().patience(Duration::from_millis(300))).unwrap();
    let mut sink = scope.sink().unwrap();
    let mut recording = Recording::begin(&mut sink);
    recording.give(10, &mut sink);
    let mut stalled = view(&scope);
    words_of(&mut stalled, "begin");
    assert_eq!(scope.viewers(), 1);
    // It does not read any more; more comes than the system keeps for it.
    until(|| {
        recording.give(200, &mut sink);
        scope.viewers() == 0
    });
    let mut other = view(&scope);
    words_of(&mut other, "loops");
}

#[test]
fn the_sink_never_waits() {
    let scope = Scope::open(settings()).unwrap();
    let mut sink = scope.sink().unwrap();
    let mut recording = Recording::begin(&mut sink);
    // Many times as much as fits: refused blocks are counted by the recorder, and later ones are
    // valid.
    recording.give(20_000, &mut sink);
    until(|| recording.give(1, &mut sink) == 0);
    let mut viewer = view(&scope);
    let loops = words_of(&mut viewer, "loops");
    assert!(loops["loops"][0]["count"].as_u64().unwrap() > 0, "{loops}");
}

#[test]
fn a_late_viewer_gets_a_replayed_recording() {
    let mut file = luna_logger::format::Writer::new(Vec::new()).unwrap();
    Machine::new()
        .emergency_at(900)
        .until(1000 * PERIOD, &mut |record| file.put(record).unwrap());
    file.put(&Record::End { time: 5 }).unwrap();
    let file = file.finish().unwrap();
    let scope = Scope::open(settings()).unwrap();
    scope.replay(&file[..], Speed::AT_ONCE).unwrap();
    let mut viewer = view(&scope);
    let loops = words_of(&mut viewer, "loops");
    assert_eq!(loops["loops"][0]["count"], 1000);
    assert_eq!(loops["late_in_all"], 2);
    assert_eq!(loops["late"][0]["cause"], 2);
    let status = words_of(&mut viewer, "status");
    assert_eq!(status["status"]["emergency"]["degree"], 3);
    assert_eq!(status["status"]["problem"], Value::Null);

    // Another recording replaces it; one that is cut off reports that.
    let error = scope.replay(&file[..file.len() - 9], Speed::AT_ONCE);
    assert!(error.is_err());
    words_of(&mut viewer, "begin");
    let status = loop {
        let word = words_of(&mut viewer, "status");
        if word["status"]["problem"] != Value::Null {
            break word;
        }
    };
    let problem = status["status"]["problem"].as_str().unwrap();
    assert!(problem.contains("middle of a block"), "{problem}");
}

struct Gain(Mutex<f64>);

impl Parameters for Gain {
    fn list(&self) -> Vec<Parameter> {
        vec![Parameter::new("gain", *self.0.lock().unwrap()).range(0.0, 5.0)]
    }

    fn set(&self, name: &str, value: &Value) -> Result<(), String> {
        let fits = |gain: &f64| name == "gain" && (0.0..=5.0).contains(gain);
        let value = value.as_f64().filter(fits);
        *self.0.lock().unwrap() = value.ok_or("it must be from 0 to 5")?;
        Ok(())
    }
}

fn say(viewer: &mut WebSocket<TcpStream>, word: &Value) {
    viewer.send(Message::text(word.to_string())).unwrap();
}

#[test]
fn parameters_are_set_with_the_token_alone() {
    let gain = Arc::new(Gain(Mutex::new(1.0)));
    let settings = settings().parameters(gain.clone()).allow_setting().unwrap();
    let scope = Scope::open(settings).unwrap();
    let url = scope.url();
    let token = url.split_once("#token=").unwrap().1;
    let mut viewer = view(&scope);
    assert_eq!(words_of(&mut viewer, "parameters")["list"][0]["value"], 1.0);

    let set = |value: f64| json!({"type": "set", "id": 7, "name": "gain", "value": value});
    say(&mut viewer, &set(2.0));
    let refused = words_of(&mut viewer, "set");
    assert!(
        refused["error"].as_str().unwrap().contains("token"),
        "{refused}"
    );
    assert_eq!(*gain.0.lock().unwrap(), 1.0);

    say(&mut viewer, &json!({"type": "token", "token": token}));
    assert_eq!(words_of(&mut viewer, "authorized")["ok"], true);
    say(&mut viewer, &set(3.0));
    assert_eq!(words_of(&mut viewer, "set")["error"], Value::Null);
    assert_eq!(*gain.0.lock().unwrap(), 3.0);
    assert_eq!(words_of(&mut viewer, "parameters")["list"][0]["value"], 3.0);
    say(&mut viewer, &set(9.0));
    assert_eq!(
        words_of(&mut viewer, "set")["error"],
        "it must be from 0 to 5"
    );
}

#[test]
fn wrong_tokens_are_limited_and_no_token_is_invalid() {
    let gain = Arc::new(Gain(Mutex::new(1.0)));
    let guarded = settings().parameters(gain.clone()).allow_setting().unwrap();
    for settings in [guarded, settings().parameters(gain.clone())] {
        let scope = Scope::open(settings).unwrap();
        let mut viewer = view(&scope);
        for _ in 0..3 {
            say(&mut viewer, &json!({"type": "token", "token": ""}));
            assert_eq!(words_of(&mut viewer, "authorized")["ok"], false);
        }
        while words(&mut viewer).is_some() {}
    }
    assert_eq!(*gain.0.lock().unwrap(), 1.0);
}

#[test]
fn a_picture_goes_to_each_viewer_unless_it_is_too_long() {
    let scope = Scope::open(settings().picture("<svg/>")).unwrap();
    assert_eq!(words_of(&mut view(&scope), "hello")["picture"], "<svg/>");
    let error = Scope::open(settings().picture(" ".repeat((256 << 10) + 1))).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput);
}

#[test]
fn it_ends_when_it_is_dropped() {
    let scope = Scope::open(settings()).unwrap();
    let mut sink = scope.sink().unwrap();
    let mut viewer = view(&scope);
    words_of(&mut viewer, "hello");
    drop(scope);
    while words(&mut viewer).is_some() {}
    // The feed's thread goes with its sink.
    let _ = sink.begin(&Encoder::head());
}

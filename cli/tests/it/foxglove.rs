//! `luna demo --foxglove`: a viewer finds the machine's signals.

use crate::run::command;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::Stdio;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, client};

#[test]
fn the_demo_advertises_its_signals_and_sends_what_is_subscribed_to() {
    let mut child = command(&["demo", "--foxglove", "127.0.0.1:0", "--seconds", "600"])
        .args(["--calibrated", "--policy", "other"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let address = lines.find_map(|line| {
        let line = line.expect("text");
        line.strip_prefix("foxglove: ws://").map(str::to_owned)
    });
    let address = address.expect("it says where");
    // A reader for its later output.
    std::thread::spawn(move || lines.for_each(drop));

    let mut request = format!("ws://{address}").into_client_request().unwrap();
    let protocol = HeaderValue::from_static("foxglove.sdk.v1");
    let headers = request.headers_mut();
    headers.insert("sec-websocket-protocol", protocol);
    let stream = TcpStream::connect(&address).expect("it listens");
    let (mut viewer, _) = client(request, stream).expect("it speaks the protocol");
    let channel = loop {
        let Message::Text(text) = viewer.read().expect("it goes on") else {
            continue;
        };
        let said: serde_json::Value = serde_json::from_str(&text).unwrap();
        let channels = said["channels"].as_array().into_iter().flatten();
        let mut angles = channels.filter(|channel| channel["topic"] == "/pan/angle");
        if let Some(angle) = angles.next() {
            break angle["id"].clone();
        }
    };
    let subscription = serde_json::json!({ "id": 1, "channelId": channel });
    let request = serde_json::json!({ "op": "subscribe", "subscriptions": [subscription] });
    let request = Message::Text(request.to_string().into());
    viewer.send(request.clone()).expect("it reads");
    let sample = loop {
        match viewer.read().expect("it goes on") {
            Message::Binary(bytes) => break bytes,
            // The library knows a channel a moment after it has advertised it.
            Message::Text(text) if text.contains("Unknown channel ID") => {
                viewer.send(request.clone()).expect("it reads");
            }
            _ => {}
        }
    };
    // A kind, the subscription, the time.
    let sample = sample[13..].to_vec();
    // Field 1 of luna.f64x1, a double.
    assert!(sample.len() == 9 && sample[0] == 0x09, "{sample:?}");
    let value = f64::from_le_bytes(sample[1..].try_into().unwrap());
    assert!(value.is_finite(), "{value}");
    child.kill().expect("it runs");
    child.wait().expect("it ends");
}

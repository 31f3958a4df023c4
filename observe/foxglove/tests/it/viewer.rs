//! A viewer: what Foxglove's application does of the protocol `foxglove.sdk.v1`.

use serde_json::{Value as Json, json};
use std::collections::HashMap;
use std::net::{SocketAddr, TcpStream};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

pub(crate) struct Viewer {
    socket: WebSocket<TcpStream>,
    /// The channels that were advertised, by their topics.
    pub(crate) channels: HashMap<String, Json>,
}

/// A message of a topic that was subscribed to.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Data {
    pub(crate) subscription: u32,
    /// In nanoseconds.
    pub(crate) time: u64,
    pub(crate) content: Vec<u8>,
}

impl Data {
    pub(crate) fn json(&self) -> Json {
        serde_json::from_slice(&self.content).unwrap()
    }
}

impl Viewer {
    pub(crate) fn connect(address: SocketAddr) -> Viewer {
        let mut request = format!("ws://{address}").into_client_request().unwrap();
        let protocol = HeaderValue::from_static("foxglove.sdk.v1");
        request
            .headers_mut()
            .insert("sec-websocket-protocol", protocol);
        let stream = TcpStream::connect(address).unwrap();
        // So that a server that says nothing fails the test.
        let limit = std::time::Duration::from_secs(60);
        stream.set_read_timeout(Some(limit)).unwrap();
        let (socket, response) = tungstenite::client(request, stream).unwrap();
        assert_eq!(
            response.headers()["sec-websocket-protocol"],
            "foxglove.sdk.v1"
        );
        let mut viewer = Viewer {
            socket,
            channels: HashMap::new(),
        };
        assert_eq!(viewer.text()["op"], "serverInfo");
        viewer
    }

    /// The next message that is text.
    fn text(&mut self) -> Json {
        loop {
            if let Message::Text(text) = self.socket.read().unwrap() {
                return serde_json::from_str(&text).unwrap();
            }
        }
    }

    /// Waits until this topic is advertised, then subscribes to it by this number.
    pub(crate) fn subscribe(&mut self, topic: &str, number: u32) -> Json {
        while !self.channels.contains_key(topic) {
            let text = self.text();
            if text["op"] != "advertise" {
                continue;
            }
            for channel in text["channels"].as_array().unwrap() {
                let topic = channel["topic"].as_str().unwrap().to_owned();
                self.channels.insert(topic, channel.clone());
            }
        }
        let channel = self.channels[topic].clone();
        let request = json!({
            "op": "subscribe",
            "subscriptions": [{ "id": number, "channelId": channel["id"] }],
        });
        let request = Message::Text(request.to_string().into());
        self.socket.send(request).unwrap();
        channel
    }

    /// The next message of a topic.
    pub(crate) fn data(&mut self) -> Data {
        loop {
            if let Message::Binary(bytes) = self.socket.read().unwrap()
                && bytes[0] == 1
            {
                return Data {
                    subscription: u32::from_le_bytes(bytes[1..5].try_into().unwrap()),
                    time: u64::from_le_bytes(bytes[5..13].try_into().unwrap()),
                    content: bytes[13..].to_vec(),
                };
            }
        }
    }
}

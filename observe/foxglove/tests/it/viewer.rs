//! A viewer: what Foxglove's application does of the protocol `foxglove.sdk.v1`.

use prost::Message as _;
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
    /// What was subscribed to.
    subscriptions: Vec<Json>,
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

    /// The value of a sample of an `f64`.
    pub(crate) fn double(&self) -> f64 {
        #[derive(prost::Message)]
        struct Form {
            #[prost(double, tag = "1")]
            value: f64,
        }
        Form::decode(&*self.content).unwrap().value
    }

    /// The values of a sample of an array of small integers.
    pub(crate) fn small(&self) -> Vec<i32> {
        #[derive(prost::Message)]
        struct Form {
            #[prost(sint32, repeated, tag = "1")]
            value: Vec<i32>,
        }
        Form::decode(&*self.content).unwrap().value
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
            subscriptions: Vec::new(),
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
                self.again(&text);
                continue;
            }
            for channel in text["channels"].as_array().unwrap() {
                let topic = channel["topic"].as_str().unwrap().to_owned();
                self.channels.insert(topic, channel.clone());
            }
        }
        let channel = self.channels[topic].clone();
        let subscription = json!({ "id": number, "channelId": channel["id"] });
        self.send(&subscription);
        self.subscriptions.push(subscription);
        channel
    }

    fn send(&mut self, subscription: &Json) {
        let request = json!({ "op": "subscribe", "subscriptions": [subscription] });
        let request = Message::Text(request.to_string().into());
        self.socket.send(request).unwrap();
    }

    /// The library knows a channel a moment after it has advertised it. Until then it answers a
    /// subscription by an error, which a viewer on the same machine may meet: it subscribes again.
    fn again(&mut self, status: &Json) {
        let text = status["message"].as_str().unwrap_or_default();
        let unknown = text.strip_prefix("Unknown channel ID: ");
        let refused = self
            .subscriptions
            .iter()
            .find(|one| Some(&*one["channelId"].to_string()) == unknown);
        if let Some(refused) = refused.cloned() {
            self.send(&refused);
        }
    }

    /// The next message of a topic.
    pub(crate) fn data(&mut self) -> Data {
        loop {
            match self.socket.read().unwrap() {
                Message::Binary(bytes) if bytes[0] == 1 => {
                    return Data {
                        subscription: u32::from_le_bytes(bytes[1..5].try_into().unwrap()),
                        time: u64::from_le_bytes(bytes[5..13].try_into().unwrap()),
                        content: bytes[13..].to_vec(),
                    };
                }
                Message::Text(text) => self.again(&serde_json::from_str(&text).unwrap()),
                _ => {}
            }
        }
    }
}

//! A viewer's connection.
//!
//! The scope sends blocks (binary) and messages (JSON): `hello`, `begin`, `missed`, `overview`,
//! `loops`, `status`, `parameters`, `authorized`, `set`. The viewer may send `token`, `set` and
//! `seek`.

use crate::replay::Range;
use crate::scope::{REST, Shared};
use crate::store::{News, Position};
use serde::Deserialize;
use serde_json::{Value, json};
use std::io::{self, ErrorKind};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// How often both directions are served.
const ROUND: Duration = Duration::from_millis(16);
/// How often a viewer is looked at that is to take the rest.
const SHORT: Duration = Duration::from_millis(2);
/// How often the counts are sent.
const COUNTS: Duration = Duration::from_millis(500);
/// The limit of the bytes of a viewer's message.
const LONGEST: usize = 4 << 10;
/// The limit of the bytes of blocks in transit to a viewer, beside declarations and one block;
/// messages are not included.
const ON_THE_WAY: usize = 1 << 20;
/// How many wrong tokens a viewer may send.
const GUESSES: u32 = 3;
/// The limit of a viewer's messages handled in a round.
const MAX_MESSAGES: usize = 16;

/// A viewer's message.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Request {
    Token {
        token: String,
    },
    /// Of a file: a span of seconds since its first time.
    Seek {
        from: f64,
        until: f64,
    },
    Set {
        id: u64,
        name: String,
        value: Value,
    },
}

struct Viewer<'a> {
    shared: &'a Shared,
    socket: WebSocket<TcpStream>,
    position: Position,
    is_authorized: bool,
    wrong: u32,
    loops: Option<u64>,
    /// The last status sent, so that it is not sent twice.
    status: Value,
    parameters: Value,
}

/// Serves a viewer until it leaves, is too slow or violates the protocol.
pub(super) fn show(stream: TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_nonblocking(true)?;
    let config = WebSocketConfig::default()
        .read_buffer_size(LONGEST)
        .write_buffer_size(64 << 10)
        .max_write_buffer_size(usize::MAX)
        .max_message_size(Some(LONGEST))
        .max_frame_size(Some(LONGEST));
    let mut viewer = Viewer {
        shared,
        socket: WebSocket::from_raw_socket(stream, Role::Server, Some(config)),
        position: Position::default(),
        is_authorized: false,
        wrong: 0,
        loops: None,
        status: Value::Null,
        parameters: Value::Null,
    };
    match viewer.rounds() {
        Ok(()) | Err(Error::ConnectionClosed | Error::AlreadyClosed) => {}
        // The message is too long, or not of the protocol.
        Err(_) => {
            let _ = viewer.socket.close(None);
            let _ = viewer.socket.flush();
        }
    }
    Ok(())
}

impl Viewer<'_> {
    fn rounds(&mut self) -> Result<(), Error> {
        let settings = &self.shared.settings;
        self.send(&json!({
            "type": "hello",
            "version": env!("CARGO_PKG_VERSION"),
            "parameters": settings.parameters.is_some(),
            "can_set": settings.parameters.is_some() && settings.token.is_some(),
            "picture": settings.picture.as_deref(),
        }))?;
        let mut taken = Instant::now();
        let mut counted = None;
        loop {
            let has_taken = self.flush()?;
            if has_taken {
                taken = Instant::now();
                self.news()?;
                if counted.is_none_or(|counted: Instant| counted.elapsed() >= COUNTS) {
                    counted = Some(Instant::now());
                    self.counts()?;
                }
                self.flush()?;
            } else if taken.elapsed() > settings.patience {
                return Err(Error::ConnectionClosed);
            }
            self.listen()?;
            if self.shared.closes_within(ROUND) {
                return self.rest();
            }
        }
    }

    /// Sends what is left, says that the scope is closed, and waits until the viewer has taken it;
    /// for a limited time.
    fn rest(&mut self) -> Result<(), Error> {
        let end = Instant::now() + REST;
        let mut is_last = false;
        while Instant::now() < end {
            if !self.flush()? {
                std::thread::sleep(SHORT);
            } else if is_last {
                break;
            } else if !self.news()? {
                self.counts()?;
                is_last = true;
            }
        }
        self.socket.close(None)?;
        while Instant::now() < end {
            // It fails when the viewer has closed the connection too.
            if waits(self.socket.read())?.is_none() {
                std::thread::sleep(SHORT);
            }
        }
        Ok(())
    }

    fn send(&mut self, what: &Value) -> Result<(), Error> {
        waits(self.socket.write(Message::text(what.to_string()))).map(drop)
    }

    /// Sends. Returns whether everything is on its way.
    fn flush(&mut self) -> Result<bool, Error> {
        waits(self.socket.flush()).map(|done| done.is_some())
    }

    /// Returns whether there was anything new.
    fn news(&mut self) -> Result<bool, Error> {
        if let Some(together) = &self.shared.together {
            together.release(self.shared);
        }
        let News {
            blocks,
            declarations,
            missed,
            begins,
            start,
            until,
            last,
            kept_from,
            overviews,
        } = self.shared.store().news(&mut self.position, ON_THE_WAY);
        if begins {
            self.loops = None;
            self.status = Value::Null;
            self.send(&json!({
                "type": "begin",
                "declarations": declarations,
                "start": start.map(|time| time.to_string()),
                "until": until.map(|time| time.to_string()),
                "last": last.map(|time| time.to_string()),
                "kept_from": kept_from.map(|time| time.map(|time| time.to_string())),
            }))?;
        }
        if missed > 0 && !begins {
            self.send(&json!({"type": "missed", "blocks": missed, "declarations": declarations}))?;
        }
        let (declared, blocks) = blocks.split_at(declarations);
        self.blocks(declared)?;
        overviews
            .iter()
            .try_for_each(|overview| self.send(overview))?;
        self.blocks(blocks)?;
        Ok(begins || missed > 0 || !blocks.is_empty())
    }

    fn blocks(&mut self, blocks: &[Arc<[u8]>]) -> Result<(), Error> {
        for block in blocks {
            waits(self.socket.write(Message::binary(block.to_vec())))?;
        }
        Ok(())
    }

    fn counts(&mut self) -> Result<(), Error> {
        let parameters = self.shared.parameters();
        let (loops, status) = {
            let store = self.shared.store();
            let loops = store.loops();
            let is_new = self.loops != Some(loops.version());
            self.loops = Some(loops.version());
            (is_new.then(|| loops.json()), store.status())
        };
        if let Some(loops) = loops {
            self.send(&loops)?;
        }
        if status != self.status {
            self.status.clone_from(&status);
            self.send(&json!({"type": "status", "status": status}))?;
        }
        if let Some(parameters) = parameters {
            let list = json!(parameters);
            if list != self.parameters {
                self.parameters.clone_from(&list);
                self.send(&json!({"type": "parameters", "list": list}))?;
            }
        }
        Ok(())
    }

    fn listen(&mut self) -> Result<(), Error> {
        for _ in 0..MAX_MESSAGES {
            match waits(self.socket.read())? {
                None => break,
                Some(Message::Text(text)) => {
                    let answer = match serde_json::from_str(&text) {
                        Ok(request) => self.handle(request),
                        // Not from this page.
                        Err(_) => return Err(Error::AttackAttempt),
                    };
                    if let Some(answer) = answer {
                        self.send(&answer)?;
                    }
                    if self.wrong >= GUESSES {
                        return Err(Error::AttackAttempt);
                    }
                }
                Some(Message::Binary(_)) => return Err(Error::AttackAttempt),
                Some(_) => {}
            }
        }
        Ok(())
    }

    fn handle(&mut self, request: Request) -> Option<Value> {
        let settings = &self.shared.settings;
        match request {
            Request::Token { token } => {
                let is_right = settings.token.as_ref().is_some_and(|own| own.is(&token));
                self.is_authorized |= is_right;
                self.wrong += u32::from(!is_right);
                Some(json!({"type": "authorized", "ok": is_right}))
            }
            Request::Seek { from, until } => {
                let file = self.shared.store().file();
                if let Some(start) = file {
                    let after = |seconds: f64| start.saturating_add((seconds * 1e9) as u64);
                    self.shared.seek(Range {
                        from: after(from),
                        until: after(until),
                    });
                }
                None
            }
            Request::Set { id, name, value } => {
                let done = match &settings.parameters {
                    _ if !self.is_authorized => {
                        Err("setting needs the token that the scope was started with".to_owned())
                    }
                    None => Err("there are no parameters".to_owned()),
                    Some(parameters) => {
                        // Changes from before are marked as such, before this one.
                        self.shared.parameters();
                        parameters.set(&name, &value)
                    }
                };
                self.shared.parameters();
                Some(json!({"type": "set", "id": id, "name": name, "error": done.err()}))
            }
        }
    }
}

/// The result; none if the operation would block.
fn waits<T>(done: Result<T, Error>) -> Result<Option<T>, Error> {
    match done {
        Ok(value) => Ok(Some(value)),
        Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => Ok(None),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_is_set_is_the_number_that_was_sent() {
        // The nearest double to these digits; a parser that rounds twice returns its neighbour.
        let message = r#"{"type":"set","id":1,"name":"kp","value":21.476612524468646}"#;
        let Request::Set { value, .. } = serde_json::from_str(message).unwrap() else {
            panic!("the message sets a parameter");
        };
        assert_eq!(value, json!(21.476_612_524_468_646_f64));
    }
}

//! The conversation of a site's page with its program.

use crate::scope::Shared;
use crate::site::Site;
use serde::Deserialize;
use std::io::{self, ErrorKind};
use std::net::TcpStream;
use std::time::Duration;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// How often is looked whether the scope is closed.
const ROUND: Duration = Duration::from_millis(200);
/// The limit of the bytes of a message.
const LONGEST: usize = 1 << 20;

/// The first message.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum First {
    Token { token: String },
}

/// Answers until the page leaves, violates the protocol, or the scope is closed.
pub(super) fn serve(stream: TcpStream, site: &dyn Site, shared: &Shared) -> io::Result<()> {
    stream.set_read_timeout(Some(ROUND))?;
    stream.set_write_timeout(Some(shared.settings.patience))?;
    let config = WebSocketConfig::default()
        .max_message_size(Some(LONGEST))
        .max_frame_size(Some(LONGEST));
    let mut socket = WebSocket::from_raw_socket(stream, Role::Server, Some(config));
    if talk(&mut socket, site, shared).is_err() {
        // It may be gone.
        let _ = socket.close(None);
        let _ = socket.flush();
    }
    Ok(())
}

fn talk(socket: &mut WebSocket<TcpStream>, site: &dyn Site, shared: &Shared) -> Result<(), Error> {
    let Some(first) = next(socket, shared)? else {
        return Ok(());
    };
    let token = shared.settings.token.as_ref();
    let is_right = serde_json::from_str(&first)
        .is_ok_and(|First::Token { token: given }| token.is_some_and(|own| own.is(&given)));
    if !is_right {
        return Err(Error::AttackAttempt);
    }
    socket.send(Message::text("{\"type\":\"authorized\"}"))?;
    while let Some(message) = next(socket, shared)? {
        socket.send(Message::text(site.answer(&message)))?;
    }
    Ok(())
}

/// The next text; nothing if the scope is closed.
fn next(socket: &mut WebSocket<TcpStream>, shared: &Shared) -> Result<Option<String>, Error> {
    while !shared.is_closed() {
        match socket.read() {
            Ok(Message::Text(text)) => return Ok(Some(text.to_string())),
            Ok(Message::Binary(_)) => return Err(Error::AttackAttempt),
            Ok(_) => {}
            Err(Error::Io(error))
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}

//! Connections and their answers.
//!
//! Each connection has a thread. It reads the request, and then either answers or serves a viewer.
//! Each of these three has a limit of its own, so that many connections in one of them leave the
//! others their places: 32 for requests, 32 for answers, and those of the viewers.

mod places;
mod request;
mod talk;
mod viewer;

use crate::page;
use crate::scope::Shared;
pub(crate) use places::Places;
use places::{Place, Until};
use request::{Refusal, Request};
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The limit of the bytes of a request's line and headers.
const LONGEST: usize = 8 << 10;
/// A request is there as a whole within this time.
const READING: Duration = Duration::from_secs(5);
/// The client has taken an answer as a whole within this time.
const ANSWERING: Duration = Duration::from_secs(5);
/// After this silence the client's request counts as complete.
const SILENCE: Duration = Duration::from_millis(200);

/// Takes connections until the scope is closed.
pub(crate) fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    loop {
        let accepted = listener.accept();
        if shared.is_closed() {
            return;
        }
        let Ok((stream, _)) = accepted else {
            // No descriptors are left, mostly: others may end.
            if shared.closes_within(Duration::from_millis(50)) {
                return;
            }
            continue;
        };
        let stream = Arc::new(stream);
        let place = shared.reading.enter(&stream);
        let shared = shared.clone();
        // Without a thread the connection is closed.
        let _ = std::thread::Builder::new()
            .name("luna-scope-user".to_owned())
            .stack_size(512 << 10)
            .spawn(move || {
                let _ = serve(stream, place, &shared);
            });
    }
}

/// A viewer's place, released on drop.
struct Permit<'a>(&'a Shared);

impl Permit<'_> {
    fn take(shared: &Shared) -> Option<Permit<'_>> {
        let most = shared.settings.viewers;
        let taken = shared
            .viewers
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |taken| {
                (taken < most).then_some(taken + 1)
            });
        taken.is_ok().then_some(Permit(shared))
    }
}

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        self.0.viewers.fetch_sub(1, Ordering::Relaxed);
        self.0.has_changed();
    }
}

/// Serves a connection. Its request is read in the place `reading`.
fn serve(stream: Arc<TcpStream>, reading: Place, shared: &Shared) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let request = match read(&stream) {
        Ok(Some(bytes)) => Request::parse(&bytes),
        Ok(None) => Err(Refusal::TooLong),
        Err(_) => return Ok(()),
    };
    let local = stream.local_addr()?.ip();
    let request = request.and_then(|request| {
        request.check(local, &shared.settings.hosts)?;
        let viewer = match &request.web_socket {
            Some(_) => Some(Permit::take(shared).ok_or(Refusal::TooMany)?),
            None => None,
        };
        Ok((request, viewer))
    });
    match request {
        Ok((request, Some(_viewer))) => {
            drop(reading);
            // The place had the other reference.
            let Some(stream) = Arc::into_inner(stream) else {
                return Ok(());
            };
            welcome(&stream, &request)?;
            match &shared.settings.site {
                Some(site) => talk::serve(stream, &*site.0, shared),
                None => viewer::show(stream, shared),
            }
        }
        other => {
            let _answering = shared.answering.enter(&stream);
            drop(reading);
            let asset = other.and_then(|(request, _)| {
                let site = shared.settings.site.as_ref();
                let own = || page::asset(&request.path).map(|found| (found.kind, found.content));
                let found = site.and_then(|site| site.0.file(&request.path));
                let found = found.or_else(own).ok_or(Refusal::NoSuchPath)?;
                Ok((found, request.wants_body))
            });
            match asset {
                Ok(((kind, content), with_body)) => {
                    answer(&stream, "200 OK", kind, content, with_body)
                }
                Err(refusal) => refuse(&stream, &refusal),
            }
        }
    }
}

/// Begins the WebSocket.
fn welcome(stream: &TcpStream, request: &Request) -> io::Result<()> {
    let key = request.web_socket.as_deref().unwrap_or_default();
    let accept = tungstenite::handshake::derive_accept_key(key.as_bytes());
    let end = Instant::now() + ANSWERING;
    write!(
        Until { stream, end },
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n"
    )
}

/// The line and headers of a request, or nothing if they are too long.
fn read(stream: &TcpStream) -> io::Result<Option<Vec<u8>>> {
    let end = Instant::now() + READING;
    let mut stream = Until { stream, end };
    let mut bytes = Vec::with_capacity(1024);
    let mut some = [0; 1024];
    loop {
        let got = stream.read(&mut some)?;
        if got == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes.extend_from_slice(&some[..got]);
        // Bytes after the headers are a body, which no request here has, or a frame sent too early.
        if let Some(end) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
            bytes.truncate(end + 4);
            return Ok((bytes.len() <= LONGEST).then_some(bytes));
        }
        if bytes.len() > LONGEST {
            return Ok(None);
        }
    }
}

/// Answers a request that is refused.
fn refuse(stream: &TcpStream, refusal: &Refusal) -> io::Result<()> {
    let until = Instant::now() + ANSWERING;
    let text = format!("{refusal}\n");
    let kind = "text/plain; charset=utf-8";
    answer(stream, refusal.status(), kind, text.as_bytes(), true)?;
    // What was sent and not read would make the system take the answer back.
    stream.shutdown(std::net::Shutdown::Write)?;
    let mut rest = [0; 4096];
    drain(
        |left| {
            stream.set_read_timeout(Some(left.min(SILENCE)))?;
            (&*stream).read(&mut rest)
        },
        || until.saturating_duration_since(Instant::now()),
    )
}

/// Reads to the end or until the time has passed, however small the pieces are.
fn drain(
    mut read: impl FnMut(Duration) -> io::Result<usize>,
    mut left: impl FnMut() -> Duration,
) -> io::Result<()> {
    loop {
        let left = left();
        if left.is_zero() || read(left)? == 0 {
            return Ok(());
        }
    }
}

/// Sends an answer, within [`ANSWERING`].
fn answer(
    stream: &TcpStream,
    status: &str,
    kind: &str,
    content: &[u8],
    with_body: bool,
) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\n\
         Content-Type: {kind}\r\n\
         Content-Length: {}\r\n\
         Connection: close\r\n\
         Cache-Control: no-store\r\n\
         Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n\
         Referrer-Policy: no-referrer\r\n\
         X-Content-Type-Options: nosniff\r\n\r\n",
        content.len()
    );
    let end = Instant::now() + ANSWERING;
    let mut stream = Until { stream, end };
    stream.write_all(head.as_bytes())?;
    if with_body {
        stream.write_all(content)?;
    }
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endless_request_is_read_for_a_limited_time() {
        let mut left = [200, 140, 80, 20, 0].map(Duration::from_millis).into_iter();
        let mut limits = Vec::new();
        let byte = |limit: Duration| {
            limits.push(limit.as_millis());
            Ok(1)
        };
        drain(byte, || left.next().expect("it has ended")).unwrap();
        assert_eq!(limits, [200, 140, 80, 20]);
    }

    #[test]
    fn a_complete_request_is_answered_at_once() {
        let mut pieces = [4096, 7, 0].into_iter();
        drain(|_| Ok(pieces.next().unwrap()), || SILENCE).unwrap();
        assert_eq!(pieces.next(), None);
    }
}

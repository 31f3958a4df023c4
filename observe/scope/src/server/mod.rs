//! Connections and their answers.
//!
//! Each connection has a thread, up to a limit. It ends with the answer, or serves a viewer.

mod request;
mod viewer;

use crate::page;
use crate::scope::Shared;
use request::{Refusal, Request};
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The limit of connections for files of the page, beside the viewers.
const ASKING: usize = 32;
/// The limit of the bytes of a request's line and headers.
const LONGEST: usize = 8 << 10;
/// A request is there as a whole within this time, and an answer is taken.
const PATIENCE: Duration = Duration::from_secs(5);
/// The longest time for an answer without a thread of its own, whatever the client does.
const BRIEF: Duration = Duration::from_millis(200);
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
        let most = shared.settings.viewers + ASKING;
        let Some(place) = Permit::take(shared, |shared| &shared.connections, most) else {
            // All others wait for this thread, and so does the scope's end.
            let _ = refuse(stream, &Refusal::TooMany, BRIEF);
            continue;
        };
        // Without a thread the connection is closed.
        let _ = std::thread::Builder::new()
            .name("luna-scope-user".to_owned())
            .stack_size(512 << 10)
            .spawn(move || {
                let _ = serve(stream, &place.shared);
            });
    }
}

/// One of a limited number of connections, released on drop.
pub(crate) struct Permit {
    shared: Arc<Shared>,
    of: fn(&Shared) -> &AtomicUsize,
}

impl Permit {
    fn take(shared: &Arc<Shared>, of: fn(&Shared) -> &AtomicUsize, most: usize) -> Option<Permit> {
        of(shared)
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |taken| {
                (taken < most).then_some(taken + 1)
            })
            .ok()?;
        Some(Permit {
            shared: shared.clone(),
            of,
        })
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        (self.of)(&self.shared).fetch_sub(1, Ordering::Relaxed);
    }
}

fn serve(mut stream: TcpStream, shared: &Arc<Shared>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let request = match read(&mut stream) {
        Ok(Some(bytes)) => Request::parse(&bytes),
        Ok(None) => Err(Refusal::TooLong),
        Err(_) => return Ok(()),
    };
    let local = stream.local_addr()?.ip();
    let request = request.and_then(|request| {
        request.check(local, &shared.settings.hosts)?;
        Ok(request)
    });
    match request {
        Err(refusal) => refuse(stream, &refusal, PATIENCE),
        Ok(Request {
            web_socket: Some(key),
            ..
        }) => {
            let most = shared.settings.viewers;
            match Permit::take(shared, |shared| &shared.viewers, most) {
                Some(_place) => {
                    write!(
                        stream,
                        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {}\r\n\r\n",
                        tungstenite::handshake::derive_accept_key(key.as_bytes())
                    )?;
                    viewer::show(stream, shared)
                }
                None => refuse(stream, &Refusal::TooMany, PATIENCE),
            }
        }
        Ok(request) => match page::asset(&request.path) {
            Some(asset) => answer(
                &mut stream,
                "200 OK",
                asset.kind,
                asset.content,
                request.wants_body,
            ),
            None => refuse(stream, &Refusal::NoSuchPath, PATIENCE),
        },
    }
}

/// The line and headers of a request, or nothing if they are too long.
fn read(stream: &mut TcpStream) -> io::Result<Option<Vec<u8>>> {
    let until = Instant::now() + PATIENCE;
    let mut bytes = Vec::with_capacity(1024);
    let mut some = [0; 1024];
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left))?;
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

/// Answers, within `patience` in all.
fn refuse(mut stream: TcpStream, refusal: &Refusal, patience: Duration) -> io::Result<()> {
    let until = Instant::now() + patience;
    // The system's buffer has room for a short answer, which is the first one on this connection.
    stream.set_nonblocking(true)?;
    let text = format!("{refusal}\n");
    answer(
        &mut stream,
        refusal.status(),
        "text/plain; charset=utf-8",
        text.as_bytes(),
        true,
    )?;
    stream.set_nonblocking(false)?;
    // What was sent and not read would make the system take the answer back.
    stream.shutdown(std::net::Shutdown::Write)?;
    let mut rest = [0; 4096];
    drain(
        |left| {
            stream.set_read_timeout(Some(left.min(SILENCE)))?;
            stream.read(&mut rest)
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

fn answer(
    stream: &mut TcpStream,
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
        drain(|_| Ok(pieces.next().unwrap()), || BRIEF).unwrap();
        assert_eq!(pieces.next(), None);
    }
}

//! Reads and writes of a TCP stream with a limit, in short slices, so that the thread can be told
//! to end meanwhile.

use super::receive::LOOK;
use super::wire::PeerError;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Reads all of `bytes`. `Some(false)` if the stream ends before the first one, `None` once
/// `is_over`.
pub(super) fn read(
    mut stream: &TcpStream,
    bytes: &mut [u8],
    within: Duration,
    is_over: impl Fn() -> bool,
) -> io::Result<Option<bool>> {
    let mut at = 0;
    repeat(within, is_over, |left| {
        stream.set_read_timeout(Some(left))?;
        match stream.read(&mut bytes[at..])? {
            0 if at == 0 => return Ok(Some(false)),
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            got => at += got,
        }
        Ok((at == bytes.len()).then_some(true))
    })
}

/// Writes all of `bytes`. `None` once `is_over`.
pub(super) fn write(
    mut stream: &TcpStream,
    bytes: &[u8],
    within: Duration,
    is_over: impl Fn() -> bool,
) -> io::Result<Option<()>> {
    let mut rest = bytes;
    repeat(within, is_over, |left| {
        stream.set_write_timeout(Some(left))?;
        let written = stream.write(rest)?;
        rest = &rest[written..];
        Ok(rest.is_empty().then_some(()))
    })
}

fn repeat<T>(
    within: Duration,
    is_over: impl Fn() -> bool,
    mut step: impl FnMut(Duration) -> io::Result<Option<T>>,
) -> io::Result<Option<T>> {
    let begin = Instant::now();
    loop {
        if is_over() {
            return Ok(None);
        }
        let left = within.saturating_sub(begin.elapsed());
        if left.is_zero() {
            return Err(io::Error::new(ErrorKind::TimedOut, PeerError::Silent));
        }
        match step(left.min(LOOK)) {
            Ok(None) => {}
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            outcome => return outcome,
        }
    }
}

//! Sockets that do not block, and whether this platform can wait for them.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test is a program that uses a part"
)]

use crate::support::{Watchdog, skip, watchdog};
use luna_core::{FileError, block_on, prepare_files, readable, writable};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;

/// A watchdog; none where files cannot be waited for, which is reported.
pub(crate) fn with_files() -> Option<Watchdog> {
    match block_on(async { prepare_files() }).unwrap() {
        Ok(()) => Some(watchdog()),
        Err(error) => {
            assert!(error.is_unsupported(), "{error}");
            skip(&error.to_string());
            None
        }
    }
}

pub fn pair() -> (UnixStream, UnixStream) {
    let (one, two) = UnixStream::pair().unwrap();
    one.set_nonblocking(true).unwrap();
    two.set_nonblocking(true).unwrap();
    (one, two)
}

/// Reads a byte, waiting for it; `None` at the end.
pub async fn read_byte(mut file: &UnixStream) -> Result<Option<u8>, FileError> {
    let mut byte = [0];
    loop {
        match file.read(&mut byte) {
            Ok(0) => return Ok(None),
            Ok(_) => return Ok(Some(byte[0])),
            Err(error) if error.kind() == ErrorKind::WouldBlock => readable(file).await?,
            Err(error) => panic!("{error}"),
        }
    }
}

pub async fn write_byte(mut file: &UnixStream, byte: u8) -> Result<(), FileError> {
    loop {
        match file.write(&[byte]) {
            Ok(_) => return Ok(()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => writable(file).await?,
            Err(error) => panic!("{error}"),
        }
    }
}

/// Writes until there is no more room.
pub fn fill(mut file: &UnixStream) {
    while file.write(&[0; 4096]).is_ok() {}
}

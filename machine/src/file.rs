//! Reading and writing open files without waiting: what a link to a device does on the real-time
//! path, and how it is prepared for it.

use crate::socket::unless_interrupted;
use luna_platform::path::Call;
use std::fs::File;
use std::io::{Read, Result, Write};
use std::os::fd::AsFd;

/// Makes reading and writing `file` fail with [`WouldBlock`](std::io::ErrorKind::WouldBlock) where
/// they would wait.
///
/// All duplicates of the descriptor share this mode, also those in other programs. Files on a disk
/// have it without effect. Two system calls; not for the real-time path.
///
/// # Errors
///
/// The error of the system; it refuses no open file that can be read or written.
///
/// ```
/// use std::io::{ErrorKind, Read};
///
/// let (mut near, _far) = std::os::unix::net::UnixStream::pair()?;
/// luna_machine::file::set_non_blocking(&near)?;
/// assert_eq!(near.read(&mut [0]).unwrap_err().kind(), ErrorKind::WouldBlock);
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn set_non_blocking(file: &impl AsFd) -> Result<()> {
    crate::backend::file::set_non_blocking(file.as_fd())
}

/// Reads what is there, at most as much as fits; 0 is the end of the file. Real-time path: one
/// system call, more only if signals come.
///
/// # Errors
///
/// The error of the system, [`WouldBlock`](std::io::ErrorKind::WouldBlock) if nothing is there. It
/// allocates nothing.
///
/// ```
/// let zeros = std::fs::File::open("/dev/zero")?;
/// assert_eq!(luna_machine::file::read(&zeros, &mut [1; 8])?, 8);
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn read(mut file: &File, to: &mut [u8]) -> Result<usize> {
    unless_interrupted(Call::File, || file.read(to))
}

/// Writes what fits, and returns how much. Real-time path: one system call, more only if
/// signals come.
///
/// A pipe or socket without a reader also raises SIGPIPE, which Rust programs ignore from their
/// start on.
///
/// # Errors
///
/// The error of the system, [`WouldBlock`](std::io::ErrorKind::WouldBlock) if there is no room. It
/// allocates nothing.
///
/// ```
/// let nowhere = std::fs::File::create("/dev/null")?;
/// assert_eq!(luna_machine::file::write(&nowhere, b"hello")?, 5);
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn write(mut file: &File, from: &[u8]) -> Result<usize> {
    unless_interrupted(Call::File, || file.write(from))
}

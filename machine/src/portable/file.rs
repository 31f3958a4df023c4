//! The mode of open files.

use std::io::Result;
use std::os::fd::BorrowedFd;
use std::os::unix::net::UnixStream;

pub(crate) fn set_non_blocking(file: BorrowedFd<'_>) -> Result<()> {
    // The standard library sets the mode of sockets alone, but by the call that serves all files;
    // the duplicate shares the mode.
    UnixStream::from(file.try_clone_to_owned()?).set_nonblocking(true)
}

//! The mode of open files.

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use std::io::Result;
use std::os::fd::BorrowedFd;

pub(crate) fn set_non_blocking(file: BorrowedFd<'_>) -> Result<()> {
    let flags = OFlag::from_bits_retain(fcntl(file, FcntlArg::F_GETFL)?);
    fcntl(file, FcntlArg::F_SETFL(flags | OFlag::O_NONBLOCK))?;
    Ok(())
}

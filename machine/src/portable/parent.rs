//! The standard library knows no parent.

use crate::parent::Watched;
use std::convert::Infallible;
use std::io;

/// Watches the parent. This backend cannot: [`new`](Self::new) fails.
#[derive(Debug)]
pub struct ParentWatch {
    never: Infallible,
}

impl ParentWatch {
    /// Fails.
    ///
    /// # Errors
    ///
    /// Always.
    pub fn new() -> io::Result<Self> {
        Err(io::ErrorKind::Unsupported.into())
    }

    /// There is none to wait for.
    pub fn wait(&self) -> Watched {
        match self.never {}
    }

    /// There is none to wait for.
    #[cfg(unix)]
    pub fn wait_for_input(&self, _: std::os::fd::BorrowedFd<'_>) -> bool {
        match self.never {}
    }

    /// There is none to be stopped.
    pub fn stop(&self) {
        match self.never {}
    }
}

pub(crate) fn outlive_requests() {}

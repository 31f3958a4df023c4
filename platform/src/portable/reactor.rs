//! The standard library cannot wait for files.

use crate::clock::Instant;
use crate::reactor::{BorrowedFd, Ended, Interest, ReactorError, Readiness};

/// Waits for files. This backend cannot: [`new`](Self::new) always fails.
#[derive(Debug)]
pub enum Reactor {}

impl Reactor {
    /// Fails.
    ///
    /// # Errors
    ///
    /// Always [`ReactorError::Unsupported`].
    pub fn new() -> Result<Reactor, ReactorError> {
        Err(ReactorError::Unsupported)
    }

    /// There is no reactor to register with.
    ///
    /// # Errors
    ///
    /// Cannot be called.
    pub fn register(&self, _: BorrowedFd<'_>, _: u64, _: Interest) -> Result<(), ReactorError> {
        match *self {}
    }

    /// There is no reactor to register with.
    ///
    /// # Errors
    ///
    /// Cannot be called.
    pub fn rearm(&self, _: BorrowedFd<'_>, _: u64, _: Interest) -> Result<(), ReactorError> {
        match *self {}
    }

    /// There is no reactor to register with.
    ///
    /// # Errors
    ///
    /// Cannot be called.
    pub fn deregister(&self, _fd: BorrowedFd<'_>) -> Result<(), ReactorError> {
        match *self {}
    }

    /// There is no reactor to wait in.
    ///
    /// # Errors
    ///
    /// Cannot be called.
    pub fn wait(
        &self,
        _: Instant,
        _: &mut dyn FnMut(u64, Readiness),
    ) -> Result<Ended, ReactorError> {
        match *self {}
    }

    /// There is no reactor to wake.
    pub fn wake(&self) {
        match *self {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn says_that_it_cannot() {
        let error = Reactor::new().unwrap_err();
        assert_eq!(error, ReactorError::Unsupported);
        assert!(
            error.to_string().contains("waiting for files needs Linux"),
            "{error}"
        );
    }
}

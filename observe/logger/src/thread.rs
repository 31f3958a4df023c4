//! The logger's own threads. None of them is on the real-time path.

use luna_platform::thread::{Attributes, Policy, SpawnError, Thread, spawn};
use std::convert::Infallible;
use std::io;

/// Starts a thread without a real-time policy.
pub(crate) fn start<T: Send + 'static>(
    name: &str,
    body: impl FnOnce() -> T + Send + 'static,
) -> io::Result<Thread<T>> {
    let attributes = Attributes::framework(name, Policy::Other);
    spawn(attributes, |_| Ok(()), |()| body())
        .map_err(|error: SpawnError<Infallible>| io::Error::other(error.to_string()))
}

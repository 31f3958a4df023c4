//! The logger's own threads. None of them is on the real-time path.

use luna_machine::signals;
use luna_platform::thread::{Attributes, Policy, SpawnError, Thread, spawn};
use std::convert::Infallible;
use std::io;

/// Starts a thread without a real-time policy. What it writes raises no signal: a file that has
/// reached its limit, or a reader that is gone, is an error of the write, and does not end control.
pub(crate) fn start<T: Send + 'static>(
    name: &str,
    body: impl FnOnce() -> T + Send + 'static,
) -> io::Result<Thread<T>> {
    let attributes = Attributes::framework(name, Policy::Other);
    let prepare = |_: &_| {
        signals::refuse_write_signals_here();
        Ok(())
    };
    spawn(attributes, prepare, |()| body())
        .map_err(|error: SpawnError<Infallible>| io::Error::other(error.to_string()))
}

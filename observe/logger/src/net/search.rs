//! Resolves a host name on a detached thread, since a resolver may take half a minute to fail.

use crate::thread::start;
use std::io;
use std::net::{SocketAddr, ToSocketAddrs};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Instant;

/// A running search.
#[derive(Debug)]
pub(super) struct Search {
    answer: Receiver<io::Result<SocketAddr>>,
    pub(super) begun: Instant,
}

impl Search {
    /// Looks for the first address of `HOST:PORT`.
    pub(super) fn start(address: &str) -> io::Result<Self> {
        let address = address.to_owned();
        Self::by(move || first(&address))
    }

    /// Runs `find` on a thread of its own.
    pub(super) fn by(
        find: impl FnOnce() -> io::Result<SocketAddr> + Send + 'static,
    ) -> io::Result<Self> {
        let (answers, answer) = channel();
        start("luna-find-host", move || {
            // The receiver may be gone.
            let _ = answers.send(find());
        })?;
        Ok(Self {
            answer,
            begun: Instant::now(),
        })
    }

    /// The search's result. None while it runs.
    pub(super) fn found(&self) -> Option<io::Result<SocketAddr>> {
        match self.answer.try_recv() {
            Ok(found) => Some(found),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(io::Error::other("the search for the host broke off")))
            }
        }
    }
}

fn first(address: &str) -> io::Result<SocketAddr> {
    let mut addresses = address.to_socket_addrs()?;
    addresses
        .next()
        .ok_or_else(|| io::Error::other("the host has no address"))
}

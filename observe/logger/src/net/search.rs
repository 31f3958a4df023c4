//! Resolves a host name on a detached thread, since a resolver may take half a minute to fail.

use luna_platform::thread::{Attributes, Policy, spawn};
use std::convert::Infallible;
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
        let started = spawn(
            Attributes::framework("luna-find-host", Policy::Other),
            move |_| Ok::<_, Infallible>((answers, find)),
            |(answers, find)| {
                // The receiver may be gone.
                let _ = answers.send(find());
            },
        );
        started.map_err(|error| io::Error::other(error.to_string()))?;
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

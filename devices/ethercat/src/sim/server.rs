//! A simulated network behind a network interface.

use super::network::Network;
use crate::frame::{self, MAX_FRAME};
use crate::socket;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Answers the frames that come to a network interface from a [`Network`], by a thread of its own:
/// for tests of what is between a bus and its cable. Ends when it is dropped.
///
/// On the loopback interface `lo`, a bus on the same interface reaches it.
#[derive(Debug)]
pub struct Server {
    is_to_end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves `network` on `interface`.
    ///
    /// # Errors
    ///
    /// The system's: no such interface, no right to packet sockets (CAP_NET_RAW), no thread.
    pub fn start(network: &Network, interface: &str) -> io::Result<Self> {
        let socket = socket::open(interface)?;
        let is_to_end = Arc::new(AtomicBool::new(false));
        let (network, end) = (network.clone(), is_to_end.clone());
        let name = "ethercat-sim".to_owned();
        let thread = std::thread::Builder::new().name(name).spawn(move || {
            while !end.load(Ordering::Acquire) && serve(&network, &socket).is_ok() {}
        })?;
        Ok(Self {
            is_to_end,
            thread: Some(thread),
        })
    }
}

/// Answers what comes, for a while.
fn serve(network: &Network, socket: &File) -> io::Result<()> {
    let mut ready = [PollFd::new(socket.as_fd(), PollFlags::POLLIN)];
    if poll(&mut ready, PollTimeout::from(10_u8))? == 0 {
        return Ok(());
    }
    let mut bytes = [0; MAX_FRAME];
    let length = match luna_machine::file::read(socket, &mut bytes) {
        Ok(length) => length,
        Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
        Err(error) => return Err(error),
    };
    let request = &mut bytes[..length];
    if frame::is_request(request) && network.answer(request) {
        luna_machine::file::write(socket, request)?;
    }
    Ok(())
}

impl Drop for Server {
    fn drop(&mut self) {
        self.is_to_end.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            // It has panicked if a test has: nothing is to be added.
            let _ = thread.join();
        }
    }
}

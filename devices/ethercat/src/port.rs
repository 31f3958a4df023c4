//! What frames are sent by.

use crate::sim::Network;
use crate::socket;
use crate::timer;
use luna::Instant;
use luna::external::FileError;
use luna_machine::file;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use std::fs::File;
use std::future::{Future, poll_fn};
use std::io::{self, ErrorKind};
use std::os::fd::AsFd;
use std::pin::pin;
use std::task::Poll;

/// Where subdevices are.
#[derive(Debug, Clone)]
pub struct Wire(Kind);

#[derive(Debug, Clone)]
enum Kind {
    Interface(String),
    Simulated(Network),
}

impl Wire {
    /// At a network interface (`"eth0"`), which is to be up and used for nothing else. The program
    /// needs the right to packet sockets: CAP_NET_RAW.
    pub fn interface(name: &str) -> Self {
        Self(Kind::Interface(name.to_owned()))
    }

    /// In this program.
    pub fn simulated(network: &Network) -> Self {
        Self(Kind::Simulated(network.clone()))
    }

    /// What the device manager calls it.
    pub(crate) fn name(&self) -> String {
        match &self.0 {
            Kind::Interface(name) => format!("ethercat:{name}"),
            Kind::Simulated(network) => format!("ethercat:simulated-{}", network.number()),
        }
    }

    pub(crate) fn open(&self) -> io::Result<Port> {
        Ok(match &self.0 {
            Kind::Interface(name) => Port::Socket(socket::open(name)?),
            Kind::Simulated(network) => {
                network.clear();
                Port::Simulated(network.clone())
            }
        })
    }
}

/// An open [`Wire`].
#[derive(Debug)]
pub(crate) enum Port {
    Socket(File),
    Simulated(Network),
}

impl Port {
    /// Another handle to the same.
    pub(crate) fn try_clone(&self) -> io::Result<Self> {
        Ok(match self {
            Self::Socket(file) => Self::Socket(file.try_clone()?),
            Self::Simulated(network) => Self::Simulated(network.clone()),
        })
    }

    /// The time by which a set-up has its timeouts (ns). A system's virtual clock stands meanwhile.
    pub(crate) fn now(&self) -> u64 {
        match self {
            Self::Simulated(network) if network.is_virtual() => network.time(),
            _ => Instant::now_real().as_nanos(),
        }
    }

    /// What distributed clocks are set to (ns).
    pub(crate) fn time(&self) -> u64 {
        match self {
            Self::Socket(_) => timer::time_of_day(),
            // Always the same on virtual time.
            Self::Simulated(network) => network.time(),
        }
    }

    /// Whether it goes by a system's virtual clock.
    pub(crate) fn is_simulated(&self) -> bool {
        matches!(self, Self::Simulated(_))
    }

    /// Sends a frame, without waiting.
    pub(crate) fn send(&self, frame: &[u8]) -> io::Result<usize> {
        match self {
            Self::Socket(socket) => file::write(socket, frame),
            Self::Simulated(network) => {
                network.send(frame);
                Ok(frame.len())
            }
        }
    }

    /// Receives the next frame, if one has come.
    pub(crate) fn receive(&self, to: &mut [u8]) -> io::Result<Option<usize>> {
        match self {
            Self::Socket(socket) => match file::read(socket, to) {
                Ok(length) => Ok(Some(length)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(None),
                Err(error) => Err(error),
            },
            Self::Simulated(network) => Ok(network.receive(to)),
        }
    }

    /// Waits until there may be a frame, for `deadline` at most.
    pub(crate) async fn readable(&self, deadline: Instant) -> Result<(), FileError> {
        let socket = match self {
            Self::Socket(socket) => socket,
            Self::Simulated(network) => {
                let next = network.next_answer().map(|after| luna::now() + after);
                luna::at(next.map_or(deadline, |next| next.min(deadline))).await;
                return Ok(());
            }
        };
        let mut ready = pin!(luna::external::readable(socket));
        let mut late = pin!(luna::at(deadline));
        poll_fn(|cx| match ready.as_mut().poll(cx) {
            Poll::Ready(waited) => Poll::Ready(waited),
            Poll::Pending => late.as_mut().poll(cx).map(Ok),
        })
        .await
    }

    /// Blocks until there may be a frame, for a millisecond at most.
    pub(crate) fn wait(&self) -> io::Result<()> {
        match self {
            Self::Socket(socket) => {
                let mut ready = [PollFd::new(socket.as_fd(), PollFlags::POLLIN)];
                poll(&mut ready, PollTimeout::from(1_u8))?;
            }
            // Its time advances by being looked at.
            Self::Simulated(network) if network.is_virtual() => {}
            Self::Simulated(_) => std::thread::yield_now(),
        }
        Ok(())
    }
}

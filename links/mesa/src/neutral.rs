//! How a link's outputs are taken away.

use luna_platform::path::{self, Call};
use std::fmt;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// It goes out this often, since it may be lost.
const COPIES: usize = 3;

/// Takes a link's outputs away: for [`on_emergency`](luna::System::on_emergency), or for anybody, from any thread. Clones are of the same link.
///
/// The packet sets all outputs neutral and lets the card's watchdog bite at once, which makes inputs of all pins: none of the link's write packets that are still under way gives them back.
/// The link itself sends it too when it ends, whatever the reason; and if this program is killed, nobody feeds the card's watchdog.
#[derive(Clone)]
pub struct Neutral(Arc<Inner>);

struct Inner {
    socket: UdpSocket,
    packet: Vec<u8>,
    is_engaged: AtomicBool,
}

impl Neutral {
    pub(crate) fn new(socket: UdpSocket, packet: Vec<u8>) -> Self {
        Self(Arc::new(Inner {
            socket,
            packet,
            is_engaged: AtomicBool::new(false),
        }))
    }

    /// Takes the outputs away, for good: the link sends nothing else from now on, and ends. Three system calls that do not wait; allocates nothing.
    pub fn engage(&self) {
        self.0.is_engaged.store(true, Ordering::SeqCst);
        self.send();
    }

    /// Whether it has been.
    pub fn is_engaged(&self) -> bool {
        self.0.is_engaged.load(Ordering::SeqCst)
    }

    fn send(&self) {
        for _ in 0..COPIES {
            // What the system refuses cannot be helped from here: the watchdog is left.
            let _ = path::expected(Call::File, || self.0.socket.send(&self.0.packet));
        }
    }
}

impl fmt::Debug for Neutral {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Neutral")
            .field("is_engaged", &self.is_engaged())
            .finish_non_exhaustive()
    }
}

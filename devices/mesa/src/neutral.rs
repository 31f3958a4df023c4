//! How a link's outputs are taken away.

use luna_core::path::{self, Call};
use std::io;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// It goes out this often, since it may be lost.
const COPIES: usize = 3;

/// Disables a link's outputs: for [`on_emergency`](luna::System::on_emergency), or from any thread.
/// Clones belong to the same link.
///
/// The packet sets all outputs neutral and makes the card's watchdog expire at once, which makes
/// all pins inputs: none of the link's write packets in transit enables them again. The link itself
/// sends it too when it ends, for whatever reason; and if this program is killed, the card's
/// watchdog expires.
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

    /// Disables the outputs, for good: the link sends nothing else from now on, and ends. Three
    /// system calls that do not block; allocates nothing.
    ///
    /// # Panics
    ///
    /// The system sends none of the three packets: so the report of the emergency functions shows
    /// the failure, and a guardian acts. The card's watchdog expires at the end of its time.
    pub fn engage(&self) {
        if let Err(error) = self.try_engage() {
            panic!("the card's outputs cannot be taken away, its watchdog is left: {error}");
        }
    }

    /// As [`engage`](Self::engage), without a panic.
    ///
    /// # Errors
    ///
    /// The system's error for the last of the three, if it sent none of them. The link has ended
    /// nevertheless, so the card's watchdog expires.
    pub fn try_engage(&self) -> io::Result<()> {
        self.0.is_engaged.store(true, Ordering::SeqCst);
        self.send()
    }

    /// Whether it has been.
    pub fn is_engaged(&self) -> bool {
        self.0.is_engaged.load(Ordering::SeqCst)
    }

    fn send(&self) -> io::Result<()> {
        let mut sent = Ok(());
        let mut is_sent = false;
        for _ in 0..COPIES {
            sent = path::expected(Call::File, || self.0.socket.send(&self.0.packet)).map(drop);
            is_sent |= sent.is_ok();
        }
        // An error of one may be what an earlier packet met.
        if is_sent { Ok(()) } else { sent }
    }
}

luna_platform::debug_fields!(Neutral, |neutral| is_engaged: neutral.is_engaged());

#[cfg(test)]
mod tests {
    use super::*;
    use luna::prelude::*;
    use luna::report::FunctionOutcome;

    #[test]
    fn what_cannot_be_sent_is_a_failure_in_the_report() {
        // It is not connected, so the system refuses to send.
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let neutral = Neutral::new(socket, vec![0]);
        let mut system = System::new("refused");
        let function = neutral.clone();
        // The panic's backtrace takes long on a busy machine.
        let limit = std::time::Duration::from_secs(60);
        system.on_emergency_within("card", limit, move || function.engage());
        let main = system.executor("main").build().unwrap();
        main.process("raises")
            .spawn(async { Err(luna::emergency(luna::Error::other("a test"))) })
            .unwrap();
        system.run().unwrap_err();
        let safety = system.report().unwrap().safety;
        assert_eq!(safety.functions[0].outcome, FunctionOutcome::Panicked);
        assert!(neutral.is_engaged() && neutral.try_engage().is_err());
    }
}

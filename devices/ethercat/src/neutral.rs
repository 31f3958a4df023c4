//! How the outputs are taken away.

use crate::State;
use crate::frame::{Writer, command};
use crate::port::Port;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// It goes out this often, since it may be lost.
const COPIES: usize = 3;
/// The register by which a state is requested.
pub(crate) const AL_CONTROL: u16 = 0x0120;

/// Makes a bus safe: for [`on_emergency`](luna::System::on_emergency), or from any thread. Clones
/// belong to the same link.
///
/// One frame sets all outputs to their safe values and requests SAFE-OP of all subdevices, in
/// which they ignore outputs. None of the link's frames in transit changes them again; one that the
/// link sends at that moment is followed by this frame. The link itself sends it too when it ends,
/// for whatever reason; and if this program is killed, the watchdogs of the subdevices expire.
#[derive(Clone)]
pub struct Neutral(Arc<Inner>);

struct Inner {
    port: Port,
    frame: Vec<u8>,
    is_engaged: AtomicBool,
}

impl Neutral {
    /// With the safe values of all outputs, which begin at a logical address.
    pub(crate) fn new(port: Port, address: u32, outputs: &[u8]) -> Self {
        let mut writer = Writer::new();
        if !outputs.is_empty() {
            writer = writer.datagram(command::LWR, address, outputs);
        }
        let request = u16::from(State::SafeOp.bits()).to_le_bytes();
        let frame = writer
            .datagram(command::BWR, u32::from(AL_CONTROL) << 16, &request)
            .finish();
        Self(Arc::new(Inner {
            port,
            frame,
            is_engaged: AtomicBool::new(false),
        }))
    }

    /// Makes the bus safe, for good: the link sends nothing else from now on, and ends. Three
    /// system calls that do not block; allocates nothing.
    ///
    /// # Panics
    ///
    /// The system sends none of the three frames: so the report of the emergency functions shows
    /// the failure, and a guardian acts. The subdevices' watchdogs expire at the end of their time.
    pub fn engage(&self) {
        if let Err(error) = self.try_engage() {
            panic!("the outputs cannot be made safe, the subdevices' watchdogs are left: {error}");
        }
    }

    /// As [`engage`](Self::engage), without a panic.
    ///
    /// # Errors
    ///
    /// The system's error for the last of the three, if it sent none of them. The link has ended
    /// nevertheless, so the watchdogs expire.
    pub fn try_engage(&self) -> io::Result<()> {
        self.0.is_engaged.store(true, Ordering::SeqCst);
        let mut sent = Ok(());
        let mut is_sent = false;
        for _ in 0..COPIES {
            sent = self.0.port.send(&self.0.frame).map(drop);
            is_sent |= sent.is_ok();
        }
        // An error of one may be what an earlier frame met.
        if is_sent { Ok(()) } else { sent }
    }

    /// Whether it has been.
    pub fn is_engaged(&self) -> bool {
        self.0.is_engaged.load(Ordering::SeqCst)
    }
}

luna_platform::debug_fields!(Neutral, |neutral| is_engaged: neutral.is_engaged());

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Application, Identity, Network, SubDevice};
    use crate::{Expected, Wire};
    use luna::{Buffer, System};
    use std::sync::OnceLock;
    use std::sync::atomic::AtomicU32;
    use std::time::Duration;

    /// Marks the bus as made safe while a frame is on its way, as a thread does whose own frames
    /// go out before that one.
    #[derive(Debug)]
    struct Overtaken {
        neutral: Arc<OnceLock<Neutral>>,
        /// Until that frame.
        frames: AtomicU32,
    }

    impl Application for Overtaken {
        fn step(&mut self, _: Duration, _: &[u8], _: &mut [u8]) {
            if let Some(neutral) = self.neutral.get()
                && self.frames.fetch_sub(1, Ordering::SeqCst) == 1
            {
                neutral.0.is_engaged.store(true, Ordering::SeqCst);
            }
        }
    }

    #[test]
    fn a_request_of_op_that_overtakes_it_is_taken_back() {
        let network = Network::on_virtual_time();
        let late = Arc::new(OnceLock::new());
        let overtaken = Overtaken {
            neutral: late.clone(),
            // After an exchange comes the request.
            frames: AtomicU32::new(2),
        };
        let identity = Identity::default();
        network.add(SubDevice::new("LAMP", identity, &[8], &[8], overtaken));
        let mut system = System::new("test");
        system.virtual_clock();
        let expected = [Expected::new("lamp", 0, 0)];
        let wire = Wire::simulated(&network);
        let bus = crate::open(&system.devices(), &wire, &expected).unwrap();
        let mut link = bus.link("bus", Duration::from_millis(1));
        let (_keep, lamps) = luna::buffered::<u8>(Buffer::overwrite_oldest(1));
        link.output(0, 0, 0, lamps);
        let process = link.process().unwrap();
        let neutral = process.neutral();
        late.set(neutral.clone()).unwrap();
        let main = system.executor("main").build().unwrap();
        main.process("bus").spawn(process).unwrap();
        let (sent, states) = luna::buffered(Buffer::fifo(1));
        main.process("look")
            .spawn(async move {
                while !neutral.is_engaged() {
                    luna::after(Duration::from_micros(100)).await;
                }
                sent.send(network.state(0)).await?;
                Ok(())
            })
            .unwrap();
        system.run().unwrap();
        let state = states.try_recv().unwrap();
        assert_eq!(state, State::SafeOp);
    }
}

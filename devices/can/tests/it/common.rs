//! What the tests share.

#![allow(dead_code, unused_imports, reason = "some of it is for Linux alone")]

#[path = "../../../../tests/shared/mod.rs"]
mod shared;
#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

use luna::prelude::*;
use luna::system::Executor;
use luna_can::{Counts, Filter, Frame, sim};
pub(crate) use shared::{skip, watchdog};
pub(crate) use spawn::SpawnOk;

/// Bits a second in the tests: a bit is 2 µs.
pub(crate) const RATE: u32 = 500_000;

/// A system on a virtual clock, with nodes on a simulated bus.
pub(crate) struct Bench {
    pub(crate) system: System,
    pub(crate) main: Executor,
    bus: Option<sim::Bus>,
    pub(crate) control: sim::Control,
}

/// A node with both directions.
pub(crate) struct Node {
    pub(crate) send: Sender<Frame>,
    pub(crate) received: Receiver<Frame>,
    pub(crate) counts: Counts,
}

/// So that a closure takes all of a node: a half that stays behind would keep its controller.
impl Drop for Node {
    fn drop(&mut self) {}
}

impl Bench {
    pub(crate) fn new() -> Self {
        let mut bench = Self::in_real_time();
        bench.system.virtual_clock();
        bench
    }

    /// On the machine's clock, for programs that take part.
    pub(crate) fn in_real_time() -> Self {
        let mut system = System::new("bus");
        let main = system.executor("main").build().unwrap();
        let bus = sim::Bus::new(RATE).unwrap();
        let control = bus.control();
        Self {
            system,
            main,
            bus: Some(bus),
            control,
        }
    }

    /// A device on the bus.
    pub(crate) fn open(&mut self, name: &str) -> luna::devices::Device<sim::Port> {
        let devices = self.system.devices();
        let bus = self.bus.as_mut().expect("the bus runs already");
        bus.open(&devices, name).unwrap()
    }

    /// A node that gets all frames, with its controller.
    pub(crate) fn node(&mut self, name: &str) -> Node {
        let (incoming, received) = luna::buffered(Buffer::fifo(64));
        let (send, outgoing) = luna::buffered(Buffer::fifo(64));
        let device = self.open(name);
        let controller = luna_can::controller(&device)
            .send(outgoing)
            .receive(&[Filter::ANY], incoming);
        let counts = controller.counts();
        self.main.process(name).spawn_ok(controller);
        Node {
            send,
            received,
            counts,
        }
    }

    pub(crate) fn run(&mut self) -> luna::Result<()> {
        if let Some(bus) = self.bus.take() {
            self.main.process("the bus").spawn_ok(bus);
        }
        self.system.run().map(drop)
    }
}

/// A data frame.
pub(crate) fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::standard(id, data).unwrap()
}

//! What needs a process of its own: counted allocations.

#[path = "../../../../tests/counting/mod.rs"]
mod counting;
#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

use counting::Counting;
use luna::devices::Sharing;
use luna::prelude::*;
use luna_can::canopen::{Network, NodeEvent, NodeId, OnMissed};
use luna_can::{Filter, Frame, Incoming, Port, PortError};
use spawn::SpawnOk;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

/// What is sent comes back: a port without a bus, since the simulated one allocates.
struct Echo {
    send: Sender<Frame>,
    back: Receiver<Frame>,
}

impl Port for Echo {
    const IS_OUTSIDE: bool = false;

    async fn transmit(&self, frame: Frame) -> Result<(), PortError> {
        self.send.send(frame).await.map_err(|_| PortError::Gone)
    }

    async fn receive(&self) -> Result<Incoming, PortError> {
        let frame = self.back.recv().await.map_err(|_| PortError::Gone)?;
        Ok(Incoming::Frame(frame))
    }

    fn listen(&self, _: &[Filter]) -> Result<(), PortError> {
        Ok(())
    }

    fn transmit_at_once(&self, _: Frame) -> Result<(), PortError> {
        Err(PortError::Full)
    }
}

/// Thousands of frames, typed values, overruns, heartbeats and SYNC messages. One test alone, since
/// the allocator counts the whole program.
#[test]
fn a_controller_and_the_parts_of_canopen_allocate_nothing() {
    let mut system = System::new("quiet");
    let (send, back) = luna::buffered(Buffer::fifo(64));
    let open = || Ok(Echo { send, back });
    let device = system
        .devices()
        .open("echo", "port", Sharing::Exclusive, open)
        .unwrap();
    let main = system.executor("main").build().unwrap();
    let node = NodeId::new(5).unwrap();
    let mut network = Network::new(&device);
    let (value, values) = luna::buffered::<(u16, i32)>(Buffer::fifo(4));
    network.tpdo(0x185, value).unwrap();
    let (full, _unread) = luna::buffered::<(u16, i32)>(Buffer::fifo(1));
    network.tpdo(0x185, full).unwrap();
    let (target, targets) = luna::channel();
    let producer = network.rpdo(0x185, targets).unwrap();
    main.process("pdo").spawn_ok(producer);
    let (event, events) = luna::buffered::<NodeEvent>(Buffer::fifo(4));
    let consumer = network.heartbeats(event);
    let limit = Duration::from_secs(60);
    main.process("heartbeats")
        .spawn_ok(consumer.watch(node, limit, OnMissed::Emergency));
    let (state, states) = luna::channel();
    let period = Duration::from_millis(1);
    main.process("heartbeat")
        .spawn_ok(network.heartbeat(node, period, states));
    let (switch, switches) = luna::channel::<bool>();
    main.process("sync")
        .spawn_ok(network.sync(period, switches));
    let counts = network.counts();
    main.process("can").spawn_ok(network.controller());
    drop(device);
    main.process("user").spawn_ok(async move {
        for number in 0..2_000 {
            target.send((number as u16, number)).await?;
            assert_eq!(values.recv().await?, (number as u16, number));
        }
        assert_eq!(events.recv().await?, NodeEvent::BootUp(node));
        drop((state, switch, _unread));
        Ok(())
    });
    system.run().unwrap();
    assert!(counts.received() >= 2_000 && counts.overruns() >= 1_999);
    assert_eq!(ALLOCATOR.on_path(), (0, 0));
    assert!(ALLOCATOR.everywhere().0 > 0, "it does count");
}

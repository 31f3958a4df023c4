//! A bus neither allocates nor frees on the real-time path. One test alone, since the allocator
//! counts the whole program.

#[path = "../common/mod.rs"]
#[allow(dead_code, reason = "the tests of faults use the rest")]
mod common;
#[path = "../../../../tests/counting/mod.rs"]
mod counting;

use common::{DRIVE, SpawnOk, TERMINAL, register};
use counting::Counting;
use luna_ethercat::sim::{Network, SubDevice};
use luna_ethercat::{Expected, Sample, State, Wire};
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: Counting = Counting::new();

/// A start with distributed clocks, and a thousand cycles with lost frames.
#[test]
fn a_bus_allocates_nothing() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(16, 8).with_clock(50.0));
    network.add(SubDevice::servo().with_clock(-50.0));
    let mut system = common::system();
    let expected = common::expected().map(Expected::sync0);
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", common::PERIOD);
    let (position, positions) = register::<Sample<i32>>();
    let (lamp, lamps) = register::<bool>();
    link.follow_clock(Duration::from_micros(300))
        .input(DRIVE, 2, position)
        .output_bit(TERMINAL, 9, false, lamps);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        // Both are on this thread. The bus does not yet go to OP: its loop is not in step.
        luna::after(5 * common::PERIOD).await;
        assert_eq!(network.state(DRIVE), State::SafeOp);
        let before = ALLOCATOR.here();
        for cycle in 0..1_000 {
            positions.recv().await?;
            lamp.send(cycle % 2 == 0).await?;
            if cycle % 100 == 50 {
                network.lose(2);
            }
        }
        assert_eq!(ALLOCATOR.here(), before);
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(health.missed(), 20);
}

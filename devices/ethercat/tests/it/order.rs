//! Which frames go out, when, and which answers count.

use crate::common::{self, DRIVE, SpawnOk, TERMINAL, register};
use luna_ethercat::sim::Network;
use luna_ethercat::sim::SubDevice;
use luna_ethercat::{Fault, Sample, State, Wire};
use std::time::Duration;

#[test]
fn a_frame_that_was_lost_is_not_sent_again() {
    // The library would send it again after 100 ms, when it is looked at.
    const PERIOD: Duration = Duration::from_millis(400);
    let network = Network::on_virtual_time();
    for subdevice in [SubDevice::digital(16, 8), SubDevice::servo()] {
        network.add(subdevice.with_watchdog(Duration::ZERO));
    }
    let mut system = common::system();
    let wire = Wire::simulated(&network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &common::expected()).unwrap();
    let mut link = bus.link("bus", PERIOD);
    let (position, positions) = register::<Sample<i32>>();
    link.input(DRIVE, 2, position);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let counted = health.clone();
    main.process("control").spawn_ok(async move {
        positions.recv().await?;
        let before = network.frames();
        network.lose(1);
        // Longer than the answer is awaited.
        luna::after(PERIOD.mul_f64(1.95)).await;
        assert_eq!((network.frames() - before, counted.missed()), (1, 1));
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(health.missed(), 1);
}

#[test]
fn outputs_are_safe_before_the_reason_is_known() {
    let network = common::machine();
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (lamp, lamps) = register::<bool>();
    link.output_bit(TERMINAL, 0, false, lamps);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(link.process().unwrap());
    let (seen, states) = luna::buffered(luna::Buffer::fifo(1));
    let slow = network.clone();
    main.process("lamp").spawn_ok(async move {
        for _ in 0..50 {
            lamp.send(true).await?;
            luna::after(common::PERIOD).await;
        }
        assert_eq!(slow.written(TERMINAL), [1, 0]);
        // The answer comes in time, and that to the question takes as long again.
        slow.set_latency(Duration::from_micros(700));
        slow.fall(DRIVE, 0x001b);
        let frames = slow.frames();
        while slow.frames() == frames {
            luna::after(Duration::from_micros(50)).await;
        }
        luna::after(Duration::from_micros(750)).await;
        seen.send((slow.state(TERMINAL), slow.written(TERMINAL)))
            .await?;
        luna::after(Duration::from_secs(1)).await;
        Ok(())
    });
    let expected = Fault::Left {
        position: DRIVE,
        state: State::SafeOp,
        code: Some(0x001b),
    };
    assert_eq!(common::fault(system.run()), expected);
    let seen = states.try_recv().unwrap();
    assert_eq!(seen, (State::SafeOp, vec![0, 0]));
}

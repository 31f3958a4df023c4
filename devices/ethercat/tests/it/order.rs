//! Which frames go out, when, and which answers count.

use crate::common::{self, DRIVE, SpawnOk, TERMINAL, register};
use luna_ethercat::sim::Network;
use luna_ethercat::sim::SubDevice;
use luna_ethercat::{Expected, Fault, Sample, State, Wire};
use std::time::Duration;

/// Runs a bus with a period of 400 ms: each frame goes out once, though the library would send it
/// again after 100 ms. Returns the missed cycles.
fn long(fault: impl FnOnce(&Network) + Send + 'static) -> u64 {
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
    main.process("control").spawn_ok(async move {
        positions.recv().await?;
        let before = network.frames();
        fault(&network);
        // Until after the time for which the answer of the last cycle is awaited.
        luna::after(PERIOD.mul_f64(3.95)).await;
        assert_eq!(network.frames() - before, 3);
        Ok(())
    });
    system.run().unwrap();
    health.missed()
}

#[test]
fn a_frame_that_was_lost_is_not_sent_again() {
    assert_eq!(long(|network| network.lose(1)), 1);
}

#[test]
fn an_answer_may_take_longer_than_the_librarys_timeout() {
    let slow = Duration::from_millis(250);
    assert_eq!(long(move |network| network.set_latency(slow)), 0);
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

/// Answers that come late are not taken for those of the cycle, which have the same numbers: none
/// counts from cycle 11 to 23.
fn delayed(latency: Duration) {
    // With 64 datagrams a cycle, the number of a frame comes again after four cycles.
    const COUNT: usize = 62;
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(8, 8).with_clock(0.0));
    for _ in 1..COUNT {
        network.add(SubDevice::digital(8, 8));
    }
    let terminal = Expected::new("terminal", SubDevice::VENDOR, SubDevice::DIGITAL);
    let mut system = common::system();
    let wire = Wire::simulated(&network);
    let expected = vec![terminal; COUNT];
    let bus = luna_ethercat::open(&system.devices(), &wire, &expected).unwrap();
    let mut link = bus.link("bus", common::PERIOD);
    let (level, levels) = register::<Sample<u8>>();
    link.tolerate(100).input(COUNT - 1, 0, level);
    let process = link.process().unwrap();
    let health = process.health();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        for number in 0..30 {
            let sample = levels.recv().await?;
            network.set_inputs(COUNT - 1, &[number]);
            match number {
                10 => network.set_latency(latency),
                20 => network.set_latency(Duration::ZERO),
                _ => {}
            }
            let expected = match number {
                0..=10 => number.saturating_sub(1),
                // Answers come in their order.
                11..=23 => 9,
                _ => number - 1,
            };
            assert_eq!(sample.held(), expected, "in {number}");
        }
        Ok(())
    });
    system.run().unwrap();
    assert_eq!((health.missed(), health.dropped()), (13, 13));
}

#[test]
fn an_old_answer_with_the_same_number_is_not_used() {
    // Before the exchange with the same number begins, and while it awaits its own answer.
    delayed(Duration::from_micros(3_900));
    delayed(Duration::from_micros(4_100));
}

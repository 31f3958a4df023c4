//! The way from SAFE-OP to OP.

use crate::common::{self, DRIVE, PERIOD, SpawnOk, TERMINAL, register};
use luna_ethercat::sim::{Network, SubDevice};
use luna_ethercat::{Fault, Health, Sample, State, Wire};
use std::sync::Arc;
use std::time::Duration;

/// Runs a bus until a sample has come, with a `fault` from SAFE-OP on. Returns what it counted.
fn start(
    network: &Network,
    period: Duration,
    limit: Duration,
    fault: impl FnOnce(),
) -> (luna::Result<luna::Report>, Arc<Health>) {
    let mut system = common::system();
    let wire = Wire::simulated(network);
    let bus = luna_ethercat::open(&system.devices(), &wire, &common::expected()).unwrap();
    let mut link = bus.link("bus", period);
    let (position, positions) = register::<Sample<i32>>();
    link.start_within(limit).input(DRIVE, 2, position);
    let process = link.process().unwrap();
    let health = process.health();
    fault();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let seen = network.clone();
    main.process("control").spawn_ok(async move {
        positions.recv().await?;
        assert_eq!(seen.state(DRIVE), State::Op);
        Ok(())
    });
    (system.run(), health)
}

const LIMIT: Duration = Duration::from_secs(2);

#[test]
fn a_request_of_op_that_is_lost_is_repeated() {
    let network = common::machine();
    // Of each exchange and its request, the request.
    let lossy = network.clone();
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (position, positions) = register::<Sample<i32>>();
    link.input(DRIVE, 2, position);
    let process = link.process().unwrap();
    let health = process.health();
    network.lose_one_in(Some(2));
    let before = network.frames();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    main.process("mends").spawn_ok(async move {
        luna::after(Duration::from_micros(1_500)).await;
        assert_eq!(
            (lossy.state(TERMINAL), (lossy.frames() - before) % 2),
            (State::SafeOp, 0)
        );
        lossy.lose_one_in(None);
        Ok(())
    });
    main.process("control").spawn_ok(async move {
        positions.recv().await?;
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(health.missed(), 0);
    assert!((50..60).contains(&health.cycles()), "{}", health.cycles());
}

#[test]
fn a_request_is_repeated_in_time_with_a_long_period() {
    const LONG: Duration = Duration::from_millis(400);
    let network = Network::on_virtual_time();
    for subdevice in [SubDevice::digital(16, 8), SubDevice::servo()] {
        network.add(subdevice.with_watchdog(Duration::ZERO));
    }
    // The exchange comes, and the request does not.
    let (outcome, health) = start(&network, LONG, LIMIT, || network.lose_one_in(Some(2)));
    outcome.unwrap();
    assert!(health.cycles() < 6, "{}", health.cycles());
}

#[test]
fn a_subdevice_that_refuses_op_ends_the_start() {
    let network = common::machine();
    let mut system = common::system();
    let mut link = common::open(&system, &network).unwrap();
    let (lamp, lamps) = register::<bool>();
    link.output_bit(TERMINAL, 0, true, lamps);
    let process = link.process().unwrap();
    // An error that nobody acknowledges keeps it there.
    network.fall(DRIVE, 0x0016);
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let seen = network.clone();
    main.process("lamp").spawn_ok(async move {
        loop {
            lamp.send(false).await?;
            luna::after(Duration::from_millis(1)).await;
            // The terminal may be in OP; set-points count when all are.
            assert_eq!(seen.written(TERMINAL), [1, 0]);
        }
    });
    let fault = common::fault(system.run());
    // It is asked before the second request.
    let expected = Fault::NotOperational {
        position: DRIVE,
        state: State::SafeOp,
        code: Some(0x0016),
        after: Duration::from_millis(50),
    };
    assert_eq!(fault, expected);
    assert_eq!(network.written(TERMINAL), [1, 0]);
}

#[test]
fn a_start_that_takes_too_long_ends() {
    let network = common::machine();
    let limit = Duration::from_millis(30);
    let (outcome, _) = start(&network, PERIOD, limit, || network.fall(DRIVE, 0x0016));
    let expected = Fault::NotOperational {
        position: DRIVE,
        state: State::SafeOp,
        code: Some(0x0016),
        after: Duration::from_millis(31),
    };
    assert_eq!(common::fault(outcome), expected);
}

#[test]
fn before_op_a_subdevice_may_take_no_outputs() {
    let network = common::machine();
    let (outcome, health) = start(&network, PERIOD, LIMIT, || network.miscount(20));
    outcome.unwrap();
    assert_eq!((health.miscounted(), health.missed()), (20, 0));
}

#[test]
fn in_op_all_subdevices_are_to_take_part() {
    let network = common::machine();
    let (outcome, _) = start(&network, PERIOD, LIMIT, || network.miscount(u32::MAX));
    let expected = Fault::Miscounted {
        counter: 5,
        expected: 6,
        within: LIMIT,
    };
    assert_eq!(common::fault(outcome), expected);
}

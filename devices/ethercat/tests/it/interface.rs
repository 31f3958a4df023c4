//! A bus at a network interface: the simulation answers on the loopback interface.

use crate::common::{self, DRIVE, SpawnOk, TERMINAL, register};
use luna::prelude::*;
use luna_ethercat::sim::{Network, Server, SubDevice};
use luna_ethercat::{Fault, Sample, State, Wire};
use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::time::{Duration, Instant};

/// Keeps the tests that use `lo` apart, also those of another run on this computer: each socket
/// gets all frames.
fn alone() -> File {
    let place = std::env::temp_dir().join("luna-ethercat-lo.lock");
    let made = OpenOptions::new().create(true).append(true).open(&place);
    // One that another user made can be read.
    let file = made.or_else(|_| File::open(&place)).unwrap();
    file.lock().unwrap();
    file
}

/// None, with a message, where this user may not open packet sockets.
fn serve(network: &Network) -> Option<Server> {
    match Server::start(network, "lo") {
        Ok(server) => Some(server),
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            println!("skipped: frames on an interface: {error} (CAP_NET_RAW)");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

fn machine() -> Network {
    let network = Network::new();
    for subdevice in [SubDevice::digital(16, 8), SubDevice::servo()] {
        network.add(subdevice.with_watchdog(Duration::ZERO));
    }
    network
}

/// So long that a busy machine does not change the outcome.
const LONG: Duration = Duration::from_millis(20);

#[test]
fn values_go_both_ways_over_an_interface() {
    let _alone = alone();
    let network = machine();
    let Some(_server) = serve(&network) else {
        return;
    };
    network.set_inputs(TERMINAL, &[0b100]);
    let mut system = System::new("test");
    let wire = Wire::interface("lo");
    let bus = luna_ethercat::open(&system.devices(), &wire, &common::expected()).unwrap();
    let mut link = bus.link("bus", LONG);
    link.tolerate(500);
    let (switch, switches) = register::<Sample<bool>>();
    let (lamp, lamps) = register::<bool>();
    link.greatest_age(None)
        .input_bit(TERMINAL, 2, switch)
        .output_bit(TERMINAL, 9, false, lamps);
    let process = link.process().unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let seen = network.clone();
    main.process("control").spawn_ok(async move {
        lamp.send(true).await?;
        // Until what was sent has come back.
        while seen.outputs(TERMINAL) != [0, 2] {
            assert!(switches.recv().await?.held());
        }
        Ok(())
    });
    system.run().unwrap();
    until(|| network.state(DRIVE) == State::SafeOp && network.written(TERMINAL) == [0, 0]);
}

#[test]
fn an_interface_knows_no_virtual_clock() {
    let _alone = alone();
    let network = machine();
    let Some(_server) = serve(&network) else {
        return;
    };
    let mut system = common::system();
    let wire = Wire::interface("lo");
    let bus = luna_ethercat::open(&system.devices(), &wire, &common::expected()).unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("bus")
        .spawn_ok(bus.link("bus", LONG).process().unwrap());
    assert_eq!(common::fault(system.run()), Fault::VirtualTime);
}

/// The server's thread takes a while for the last frames.
fn until(is_so: impl Fn() -> bool) {
    let begin = Instant::now();
    while !is_so() {
        assert!(
            begin.elapsed() < Duration::from_secs(10),
            "it never came to be so"
        );
        std::thread::yield_now();
    }
}

//! What a bus has, and errors about what it does not have.

use crate::common::{self, DRIVE, PERIOD, TERMINAL, register};
use luna::System;
use luna::devices::DeviceError;
use luna_ethercat::sim::{Identity, Network, Nothing, SubDevice};
use luna_ethercat::{Bus, Expected, LinkError, OpenError, Sample, State, Wire};
use std::time::Duration;

#[test]
fn all_subdevices_are_found_with_their_process_data() {
    let network = common::machine();
    let bus = Bus::open(&Wire::simulated(&network), &common::expected()).unwrap();
    let found = bus.subdevices();
    assert_eq!(
        (found[TERMINAL].name.as_str(), found[DRIVE].name.as_str()),
        ("DIGITAL", "SERVO")
    );
    assert_eq!((found[TERMINAL].outputs, found[TERMINAL].inputs), (2, 1));
    assert_eq!((found[DRIVE].outputs, found[DRIVE].inputs), (6, 10));
    assert_eq!(found[DRIVE].revision, 1);
    for position in [TERMINAL, DRIVE] {
        assert_eq!(network.state(position), State::PreOp);
    }
}

#[test]
fn a_link_brings_the_bus_to_safe_op() {
    let network = common::machine();
    let system = common::system();
    let link = common::open(&system, &network).unwrap();
    assert_eq!(network.state(DRIVE), State::PreOp);
    let process = link.process().unwrap();
    assert_eq!(network.state(DRIVE), State::SafeOp);
    drop(process);
}

#[test]
fn a_bus_is_open_once() {
    let network = common::machine();
    let system = common::system();
    let link = common::open(&system, &network).unwrap();
    let again = common::open(&system, &network).unwrap_err();
    assert!(
        matches!(again, OpenError::Device(DeviceError::Busy { .. })),
        "{again}"
    );
    drop(link);
    common::open(&system, &network).unwrap();
}

#[test]
fn another_subdevice_than_was_expected() {
    let network = common::machine();
    let wire = Wire::simulated(&network);
    let [terminal, drive] = common::expected();
    let open = |expected: &[Expected]| Bus::open(&wire, expected).unwrap_err();

    let swapped = open(&[drive.clone(), terminal.clone()]);
    assert_eq!(
        swapped.to_string(),
        "at position 0 `drive` (vendor 0x4c554e41, product 0x5e44) was expected, and `DIGITAL` \
         (vendor 0x4c554e41, product 0xd101, revision 0x1) was found"
    );
    let OpenError::Mismatch {
        position,
        expected,
        found,
    } = swapped
    else {
        panic!("{swapped}");
    };
    assert_eq!(
        (position, *expected, found.product),
        (0, drive.clone(), SubDevice::DIGITAL)
    );

    let newer = open(&[terminal.clone(), drive.clone().revision(2)]);
    assert!(
        matches!(newer, OpenError::Mismatch { position: 1, .. }),
        "{newer}"
    );

    let fewer = open(&[terminal.clone(), drive.clone(), drive.clone()]);
    assert!(
        matches!(
            fewer,
            OpenError::Missing {
                position: 2,
                count: 2,
                ..
            }
        ),
        "{fewer}"
    );

    let more = open(&[terminal]);
    assert!(
        matches!(more, OpenError::Unexpected { position: 1, .. }),
        "{more}"
    );
}

#[test]
fn nobody_answers() {
    let network = Network::on_virtual_time();
    let wire = Wire::simulated(&network);
    // Nothing comes back: the library waits for it three times, on the machine's clock.
    let silent = Bus::open(&wire, &[]).unwrap_err();
    assert!(matches!(silent, OpenError::Nobody { .. }), "{silent}");
    network.add(SubDevice::servo());
    network.cut(0);
    let cut = luna_ethercat::scan(&wire).unwrap_err();
    assert!(matches!(cut, OpenError::Nobody { .. }), "{cut}");
    network.mend();
    assert_eq!(luna_ethercat::scan(&wire).unwrap().len(), 1);
}

#[test]
fn an_interface_that_is_not_there() {
    let error = luna_ethercat::scan(&Wire::interface("luna-none")).unwrap_err();
    let OpenError::Interface { wire, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!(wire, "ethercat:luna-none");
    let text = error.to_string();
    assert!(
        text.ends_with("there is no such network interface"),
        "{text}"
    );
}

#[test]
fn more_process_data_than_a_frame_has_room_for() {
    let network = Network::on_virtual_time();
    let identity = Identity::default();
    let much = vec![248; 24];
    assert_eq!(24 * 248 / 8, 744);
    for _ in 0..2 {
        network.add(SubDevice::new("MUCH", identity, &much, &[], Nothing));
    }
    let expected = [Expected::new("much", 0, 0), Expected::new("much", 0, 0)];
    let error = Bus::open(&Wire::simulated(&network), &expected).unwrap_err();
    let OpenError::TooMuchData { bytes, most } = error else {
        panic!("{error}");
    };
    assert_eq!((bytes, most), (1488, 1466));
}

#[test]
fn more_subdevices_than_a_bus_can_have() {
    let network = Network::on_virtual_time();
    for _ in 0..65 {
        network.add(SubDevice::digital(1, 1));
    }
    let error = luna_ethercat::scan(&Wire::simulated(&network)).unwrap_err();
    assert!(matches!(error, OpenError::TooMany { most: 64 }), "{error}");
}

#[test]
fn a_subdevice_with_many_values_is_whole() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(255, 255));
    let found = luna_ethercat::scan(&Wire::simulated(&network)).unwrap();
    assert_eq!(found[0].name, "DIGITAL");
    let expected = [Expected::new("many", SubDevice::VENDOR, SubDevice::DIGITAL)];
    let bus = Bus::open(&Wire::simulated(&network), &expected).unwrap();
    let found = &bus.subdevices()[0];
    assert_eq!((found.outputs, found.inputs), (32, 32));
}

#[test]
#[should_panic(expected = "too much process data")]
fn a_subdevice_has_a_limit() {
    SubDevice::new("MUCH", Identity::default(), &[248; 67], &[], Nothing);
}

#[test]
fn an_answer_may_come_never() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::servo().with_clock(0.0));
    network.set_latency(Duration::MAX);
    let error = luna_ethercat::scan(&Wire::simulated(&network)).unwrap_err();
    assert!(matches!(error, OpenError::Nobody { .. }), "{error}");
}

#[test]
fn values_that_the_bus_does_not_have() {
    let network = common::machine();
    let refused = |connect: &dyn Fn(&mut luna_ethercat::Link)| {
        let system = System::new("test");
        let mut link = common::open(&system, &network).unwrap();
        connect(&mut link);
        link.process().unwrap_err()
    };
    let (numbers, _keep_numbers) = register::<Sample<u16>>();
    let beyond = refused(&|link| {
        link.input(TERMINAL, 0, numbers.clone());
    });
    assert_eq!(
        beyond.to_string(),
        "input of 2 bytes at byte 0 at position 0 is beyond the 1 bytes that `DIGITAL` \
         (vendor 0x4c554e41, product 0xd101, revision 0x1) has there"
    );
    let nobody = refused(&|link| {
        link.input(2, 0, numbers.clone());
    });
    assert!(
        matches!(
            nobody,
            LinkError::NoSubDevice {
                position: 2,
                count: 2
            }
        ),
        "{nobody}"
    );
    let huge = refused(&|link| {
        link.input(DRIVE, usize::MAX, numbers.clone());
    });
    assert!(matches!(huge, LinkError::Outside { .. }), "{huge}");
    let twice = refused(&|link| {
        let (_, words) = register::<u16>();
        let (_, bits) = register::<bool>();
        link.output(TERMINAL, 0, 0, words)
            .output_bit(TERMINAL, 15, false, bits);
    });
    let LinkError::Twice { place } = twice else {
        panic!("{twice}");
    };
    assert_eq!((place.position, place.bit, place.bits), (TERMINAL, 15, 1));
}

#[test]
fn settings_that_are_none() {
    let network = common::machine();
    let wrong = |set: &dyn Fn(&mut luna_ethercat::Link)| {
        let system = System::new("test");
        let mut link = common::open(&system, &network).unwrap();
        set(&mut link);
        link.process().unwrap_err().to_string()
    };
    let patience = wrong(&|link| {
        link.patience(1.0);
    });
    assert!(patience.contains("less than 1"), "{patience}");
    let phase = wrong(&|link| {
        link.follow_clock(PERIOD);
    });
    assert!(phase.contains("less than a period"), "{phase}");
    let clock = wrong(&|link| {
        link.follow_clock(Duration::ZERO);
    });
    assert!(clock.contains("clock is missing"), "{clock}");
}

#[test]
fn pulses_need_a_clock() {
    let network = Network::on_virtual_time();
    network.add(SubDevice::digital(8, 8).with_clock(0.0));
    network.add(SubDevice::servo());
    let [terminal, drive] = common::expected();
    let open = |expected: &[Expected]| {
        let bus = Bus::open(&Wire::simulated(&network), expected).unwrap();
        bus.link("bus", PERIOD)
    };
    let mut link = open(&[terminal.clone(), drive.clone().sync0()]);
    link.follow_clock(Duration::ZERO);
    let none = link.process().unwrap_err();
    assert!(
        matches!(none, LinkError::NoSync { position: 1, .. }),
        "{none}"
    );
    let free = open(&[terminal.sync0(), drive]).process().unwrap_err();
    assert!(
        free.to_string().contains("does not follow the clock"),
        "{free}"
    );
}

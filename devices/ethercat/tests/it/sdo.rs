//! Objects that are written over mailboxes at set-up, and the mapping that they ask for.

use crate::common::{self, DRIVE, PERIOD, SpawnOk, TERMINAL, register};
use luna_ethercat::sim::{Application, Dictionary, Identity, Network, Nothing, Servo, SubDevice};
use luna_ethercat::{Bus, Expected, OpenError, Sample, SdoError, SdoValue, State, StepError, Wire};
use std::time::Duration;

const MODE: u16 = 0x6060;
const OUTPUTS: u16 = 0x1c12;
const INPUTS: u16 = 0x1c13;
/// Cycles in which values have come back.
const ENOUGH: u32 = 1_000;

/// Opens the bus of [`common::machine`] with SDOs for the drive.
fn open(network: &Network, list: impl FnOnce(Expected) -> Expected) -> Result<Bus, OpenError> {
    let [terminal, drive] = common::expected();
    Bus::open(&Wire::simulated(network), &[terminal, list(drive)])
}

/// What the drive refuses, and why.
fn refused(network: &Network, list: impl FnOnce(Expected) -> Expected) -> SdoError {
    match open(network, list).unwrap_err() {
        OpenError::Sdo {
            position: DRIVE,
            error,
            ..
        } => error,
        other => panic!("{other}"),
    }
}

fn code(error: SdoError) -> u32 {
    match error {
        SdoError::Aborted { code, .. } => code,
        other => panic!("{other}"),
    }
}

#[test]
fn the_drive_gets_its_mode_of_operation() {
    let network = common::machine();
    let mode = |sub| network.object(DRIVE, sub, 0);
    assert_eq!(mode(MODE), Some(Servo::VELOCITY.into()));
    open(&network, |drive| drive.sdo(MODE, 0, Servo::POSITION)).unwrap();
    assert_eq!(mode(MODE), Some(Servo::POSITION.into()));
    // It is kept, and the application shows that it has it.
    open(&network, |drive| drive.expect_sdo(0x6061, 0, 8_i8)).unwrap();
    assert_eq!(network.object(TERMINAL, MODE, 0), None);
}

#[test]
fn the_order_of_the_list_is_kept() {
    let network = common::machine();
    let both = |drive: Expected| {
        drive
            .sdo(MODE, 0, Servo::POSITION)
            .sdo(MODE, 0, Servo::VELOCITY)
    };
    open(&network, both).unwrap();
    assert_eq!(network.object(DRIVE, MODE, 0), Some(Servo::VELOCITY.into()));
}

/// A position is followed over another mapping than the default: each value has another place.
#[test]
fn another_mapping_moves_the_values() {
    let network = common::machine();
    let bus = open(&network, |drive| {
        drive
            .sdo(MODE, 0, Servo::POSITION)
            .sdo_list(OUTPUTS, &[0x1601_u16])
            // The mode, a byte that is left free, the position.
            .sdo_list(INPUTS, &[] as &[u16])
            .sdo_list(0x1a00, &[0x6061_0008, 0x0000_0008, 0x6064_0020_u32])
            .sdo_list(INPUTS, &[0x1a00_u16])
    });
    let bus = bus.unwrap();
    let found = &bus.subdevices()[DRIVE];
    assert_eq!((found.outputs, found.inputs), (6, 6));
    let mut system = common::system();
    let (mode, modes) = register::<Sample<i8>>();
    let (position, positions) = register::<Sample<i32>>();
    let (control, controls) = register::<u16>();
    let (target, targets) = register::<i32>();
    let mut link = bus.link("bus", PERIOD);
    link.input(DRIVE, 0, mode)
        .input(DRIVE, 2, position)
        .output(DRIVE, 0, 0, controls)
        .output(DRIVE, 2, 0, targets);
    let process = link.process().unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    let shared = network.clone();
    main.process("control").spawn_ok(async move {
        for _ in 0..ENOUGH {
            if positions.recv().await?.held() == -1_234_567 {
                break;
            }
            control.send(Servo::ENABLED).await?;
            target.send(-1_234_567).await?;
        }
        assert_eq!(positions.recv().await?.held(), -1_234_567);
        assert_eq!(modes.recv().await?.held(), Servo::POSITION);
        assert_eq!(shared.state(DRIVE), State::Op);
        let velocity = shared.object(DRIVE, 0x606c, 0);
        assert!(velocity.is_some(), "it is there, though not mapped");
        Ok(())
    });
    system.run().unwrap();
}

/// Two PDOs of one direction, and values of bits, follow each other without room between.
#[test]
fn several_pdos_are_packed() {
    /// Shows each output as an input.
    #[derive(Debug)]
    struct Mirror;

    impl Application for Mirror {
        fn step(&mut self, _: Duration, outputs: &[u8], inputs: &mut [u8]) {
            inputs.copy_from_slice(outputs);
        }
    }

    let network = Network::on_virtual_time();
    let dictionary = Dictionary::new()
        .output(0x7000, 1, 1)
        .output(0x7000, 2, 3)
        .output(0x7000, 3, 16)
        .input(0x6000, 1, 1)
        .input(0x6000, 2, 3)
        .input(0x6000, 3, 16)
        .pdo(0x1600, &[(0x7000, 1), (0x7000, 2)])
        .pdo(0x1601, &[(0x7000, 3)])
        .pdo(0x1a00, &[(0x6000, 1), (0x6000, 2)])
        .pdo(0x1a01, &[(0x6000, 3)]);
    network.add(SubDevice::coe(
        "BITS",
        Identity::default(),
        dictionary,
        Mirror,
    ));
    let bits = Expected::new("bits", 0, 0)
        .sdo_list(OUTPUTS, &[0x1601_u16, 0x1600])
        .sdo_list(INPUTS, &[0x1a00_u16, 0x1a01]);
    let bus = Bus::open(&Wire::simulated(&network), &[bits]).unwrap();
    assert_eq!(bus.subdevices()[0].outputs, 3);
    assert_eq!(bus.subdevices()[0].inputs, 3);
    let mut system = common::system();
    let (word, words) = register::<u16>();
    let (bit, bits) = register::<bool>();
    let (seen, sight) = register::<Sample<bool>>();
    let (low, lows) = register::<Sample<u16>>();
    let mut link = bus.link("bus", PERIOD);
    link.output(0, 0, 0, words)
        .output_bit(0, 17, false, bits)
        .input_bit(0, 1, seen)
        .input(0, 0, low);
    let process = link.process().unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("bus").spawn_ok(process);
    main.process("control").spawn_ok(async move {
        for _ in 0..ENOUGH {
            let is_seen = sight.recv().await?.held();
            // The word begins at the fifth bit of the inputs.
            if is_seen && lows.recv().await?.held() >> 4 == 0x0abc {
                return Ok(());
            }
            word.send(0xfabc).await?;
            bit.send(true).await?;
        }
        panic!("the bit is {}", sight.recv().await?.held());
    });
    system.run().unwrap();
}

#[test]
fn what_the_drive_refuses_is_named() {
    let network = common::machine();
    let error = open(&network, |drive| drive.sdo(MODE, 0, -3_i8)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "at position 1 `drive`: 0x6060:00 = -3 (0xfd, i8): it was aborted with 0x06090030: Value \
         range of parameter exceeded (only for write access)"
    );
    let OpenError::Sdo { sdo, .. } = error else {
        panic!("{error}");
    };
    assert_eq!((sdo.index, sdo.sub, sdo.value), (MODE, 0, SdoValue::I8(-3)));
    assert_eq!(network.object(DRIVE, MODE, 0), Some(Servo::VELOCITY.into()));
    assert_eq!(network.state(DRIVE), State::PreOp);
    // It is usable.
    open(&network, |drive| drive).unwrap();
}

#[test]
fn each_refusal_has_its_code() {
    let network = common::machine();
    let code = |index: u16, sub: u8, value: SdoValue| {
        code(refused(&network, |drive| drive.sdo(index, sub, value)))
    };
    let cases = [
        (0x2000, 0, SdoValue::U8(0), 0x0602_0000, "no such object"),
        (MODE, 1, SdoValue::U8(0), 0x0609_0011, "no such sub-index"),
        (0x1000, 0, SdoValue::U32(0), 0x0601_0002, "read only"),
        (0x6041, 0, SdoValue::U16(0), 0x0601_0002, "an input"),
        (0x6040, 0, SdoValue::U16(0), 0x0601_0006, "an output"),
        (MODE, 0, SdoValue::U16(8), 0x0607_0012, "too long"),
        (OUTPUTS, 1, SdoValue::U8(0), 0x0607_0013, "too short"),
        (OUTPUTS, 1, SdoValue::U16(0x1601), 0x0601_0003, "not empty"),
        (OUTPUTS, 17, SdoValue::U16(0x1601), 0x0609_0011, "too many"),
        (OUTPUTS, 0, SdoValue::U8(17), 0x0609_0030, "too many"),
    ];
    for (index, sub, value, expected, what) in cases {
        assert_eq!(code(index, sub, value), expected, "{what}");
    }
}

#[test]
fn a_mapping_that_the_drive_does_not_have() {
    // The entry itself is refused, and the list stays empty.
    let refused = |index: u16, value: SdoValue| {
        let network = common::machine();
        let list = |drive: Expected| drive.sdo_list(index, &[value]);
        let error = open(&network, list).unwrap_err();
        let OpenError::Sdo { sdo, error, .. } = error else {
            panic!("{error}");
        };
        assert_eq!((sdo.index, sdo.sub, sdo.value), (index, 1, value));
        assert_eq!(network.object(DRIVE, index, 0), Some(0_u8.into()));
        code(error)
    };
    assert_eq!(refused(OUTPUTS, SdoValue::U16(0x1a00)), 0x0609_0030);
    assert_eq!(refused(INPUTS, SdoValue::U16(0x1a07)), 0x0609_0030);
    // An input is no output; 16 bits are not 8.
    for entry in [0x6041_0010, 0x6040_0008] {
        assert_eq!(refused(0x1600, SdoValue::U32(entry)), 0x0604_0041);
    }
    // A number of entries that are not all there.
    let network = common::machine();
    let short = |drive: Expected| drive.sdo(OUTPUTS, 0, 0_u8).sdo(OUTPUTS, 0, 2_u8);
    assert_eq!(code(self::refused(&network, short)), 0x0609_0030);
    assert_eq!(network.object(DRIVE, OUTPUTS, 0), Some(0_u8.into()));
    // As many gaps as make 2049 bytes and more.
    let network = Network::on_virtual_time();
    let pdos = (0x1600..0x1610).fold(Dictionary::new(), |it, index| it.pdo(index, &[]));
    network.add(SubDevice::coe("GAPS", Identity::default(), pdos, Nothing));
    let gaps = |it: Expected, index| it.sdo_list(index, &[0x0000_00ff_u32; 16]);
    let expected = (0x1600..0x1610).fold(Expected::new("gaps", 0, 0), gaps);
    let all: Vec<u16> = (0x1600..0x1610).collect();
    let wire = Wire::simulated(&network);
    let fits = expected.clone().sdo_list(OUTPUTS, &all[..2]);
    let mapped = Bus::open(&wire, &[fits]).unwrap();
    assert_eq!(mapped.subdevices()[0].outputs, 2 * 16 * 255 / 8);
    let error = Bus::open(&wire, &[expected.sdo_list(OUTPUTS, &all)]).unwrap_err();
    let OpenError::Sdo { error, .. } = error else {
        panic!("{error}");
    };
    assert_eq!(code(error), 0x0604_0042);
    assert_eq!(network.object(0, OUTPUTS, 0), Some(0_u8.into()));
}

/// Without outputs, its inputs are still those of sync manager 3.
#[test]
fn a_sensor_with_a_mailbox() {
    let network = Network::on_virtual_time();
    let dictionary = Dictionary::new()
        .input(0x6000, 1, 16)
        .input(0x6000, 2, 8)
        .pdo(0x1a00, &[(0x6000, 2), (0x6000, 1)]);
    let identity = Identity::default();
    network.add(SubDevice::coe("SENSOR", identity, dictionary, Nothing));
    let sensor = Expected::new("sensor", 0, 0).expect_sdo(INPUTS, 1, 0x1a00_u16);
    let bus = Bus::open(&Wire::simulated(&network), &[sensor]).unwrap();
    let found = &bus.subdevices()[0];
    assert_eq!((found.outputs, found.inputs), (0, 3));
    network.set_inputs(0, &[1, 2, 3]);
    assert_eq!(network.inputs(0), [1, 2, 3]);
    assert_eq!(network.object(0, 0x6000, 1), Some(0x0302_u16.into()));
}

#[test]
fn a_value_that_is_not_as_expected() {
    let network = common::machine();
    let error = refused(&network, |drive| drive.expect_sdo(0x6061, 0, 8_i8));
    let SdoError::Differs { there } = error else {
        panic!("{error}");
    };
    assert_eq!(there, SdoValue::I8(Servo::VELOCITY));
    let none = refused(&network, |drive| drive.expect_sdo(0x2000, 3, 8_i8));
    assert_eq!(code(none), 0x0602_0000);
    let several = |drive: Expected| {
        drive
            .expect_sdo(0x1000, 0, 0x0002_0192_u32)
            .expect_sdo(OUTPUTS, 1, 0x1600_u16)
            .expect_sdo(0x1a00, 2, 0x6064_0020_u32)
    };
    open(&network, several).unwrap();
}

#[test]
fn a_subdevice_without_a_mailbox() {
    let network = common::machine();
    let [terminal, drive] = common::expected();
    let expected = [terminal.sdo(0x8000, 1, 5_u16), drive];
    let error = Bus::open(&Wire::simulated(&network), &expected).unwrap_err();
    let text = error.to_string();
    let OpenError::Sdo {
        position: TERMINAL,
        name,
        error: SdoError::NoMailbox,
        ..
    } = error
    else {
        panic!("{error}");
    };
    assert_eq!(name, "terminal");
    assert!(text.contains("0x8000:01 = 5 (0x5, u16)"), "{text}");
}

#[test]
fn a_mailbox_that_never_answers() {
    let network = common::machine();
    network.hang_mailbox(DRIVE);
    let error = open(&network, |drive| drive.sdo(MODE, 0, 8_i8)).unwrap_err();
    let text = error.to_string();
    assert!(
        matches!(
            error,
            OpenError::Sdo {
                position: DRIVE,
                error: SdoError::Silent,
                ..
            }
        ),
        "{text}"
    );
    assert!(text.contains("`drive`"), "{text}");
    assert!(text.contains("0x6060:00 = 8"), "{text}");
    assert_eq!(network.object(DRIVE, MODE, 0), Some(Servo::VELOCITY.into()));
}

#[test]
fn a_drive_that_reports_an_emergency() {
    let network = common::machine();
    // The library panics at the first of them, and cannot decode the second.
    for code in [0x3220, 0x7305] {
        network.report_emergency(DRIVE, code);
        let error = refused(&network, |drive| drive.sdo(MODE, 0, 8_i8));
        assert!(matches!(error, SdoError::OtherMessage), "{error}");
    }
    network.report_emergency(DRIVE, 0x3220);
    let error = open(&network, |drive| drive).unwrap_err();
    let OpenError::Step {
        error: StepError::Emergency,
        ..
    } = error
    else {
        panic!("{error}");
    };
    // It is reported once.
    open(&network, |drive| drive.sdo(MODE, 0, 8_i8)).unwrap();
}

#[test]
fn lost_frames_do_not_disturb_it() {
    let network = common::machine();
    network.lose_one_in(Some(9));
    let list = |drive: Expected| {
        drive
            .sdo(MODE, 0, Servo::POSITION)
            .sdo_list(OUTPUTS, &[0x1601_u16])
            .sdo_list(INPUTS, &[0x1a01_u16])
    };
    let bus = open(&network, list).unwrap();
    let found = &bus.subdevices()[DRIVE];
    assert_eq!((found.outputs, found.inputs), (6, 7));
    assert_eq!(network.object(DRIVE, MODE, 0), Some(Servo::POSITION.into()));
}

//! The codec: generated packets are parsed back, and nothing panics.

use hostmot2::idrom::Idrom;
use hostmot2::lbp16::{Command, MAX_COUNT, MAX_PACKET, Operations, Packet, Space, Width};
use proptest::prelude::*;

fn seeded() -> proptest::test_runner::Config {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    proptest::test_runner::Config {
        rng_seed: proptest::test_runner::RngSeed::Fixed(seed.unwrap_or(20_261_121)),
        failure_persistence: None,
        cases: 2_000,
        ..Default::default()
    }
}

prop_compose! {
    fn command()(
        flags in any::<[bool; 3]>(),
        space in 0_u16..8,
        width in 0_u16..4,
        count in 1..=MAX_COUNT,
        address in any::<Option<u16>>(),
    ) -> Command {
        Command {
            write: flags[0],
            info: flags[1],
            space: Space::from_bits(space),
            width: Width::from_bits(width),
            increment: flags[2],
            count,
            address,
        }
    }
}

fn data(command: &Command, seed: u8) -> Vec<u8> {
    match command.write {
        true => (0..command.data_len())
            .map(|n| (n as u8).wrapping_mul(31).wrapping_add(seed))
            .collect(),
        false => Vec::new(),
    }
}

proptest! {
    #![proptest_config(seeded())]

    #[test]
    fn a_word_is_its_command(command in command()) {
        prop_assert_eq!(Command::from_word(command.word(), command.address), Some(command));
        prop_assert_eq!(Command::has_address(command.word()), command.address.is_some());
    }

    #[test]
    fn every_word_is_a_command_or_empty(word in any::<u16>(), address in any::<u16>()) {
        let address = Command::has_address(word).then_some(address);
        match Command::from_word(word, address) {
            Some(command) => prop_assert_eq!(command.word(), word),
            None => prop_assert_eq!(word & 0x7F, 0),
        }
    }

    #[test]
    fn what_is_made_is_read_again(
        commands in prop::collection::vec((command(), any::<u8>()), 0..20),
    ) {
        let (mut packet, mut taken, mut answer) = (Packet::new(), Vec::new(), 0);
        for (command, seed) in commands {
            let data = data(&command, seed);
            if packet.push(command, &data).is_ok() {
                answer += if command.write { 0 } else { command.data_len() };
                taken.push((command, data));
            }
        }
        prop_assert!(packet.bytes().len() <= MAX_PACKET && packet.answer_len() <= MAX_PACKET);
        prop_assert_eq!(packet.answer_len(), answer);
        let read: Vec<_> = Operations::new(packet.bytes())
            .map(|operation| operation.map(|operation| (operation.command, operation.data.to_vec())))
            .collect::<Result<_, _>>()
            .expect("it was made by a packet");
        prop_assert_eq!(read, taken);
    }

    #[test]
    fn arbitrary_bytes_are_read_to_their_end_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let (mut length, mut failed) = (0, false);
        for operation in Operations::new(&bytes) {
            prop_assert!(!failed, "nothing comes after an error");
            match operation {
                Ok(operation) => {
                    let command = operation.command;
                    let address = if command.address.is_some() { 2 } else { 0 };
                    length += 2 + address + operation.data.len();
                }
                Err(_) => failed = true,
            }
        }
        prop_assert!(length <= bytes.len());
        prop_assert!(failed || length == bytes.len());
    }

    #[test]
    fn an_arbitrary_idrom_is_read_or_refused(mut bytes in prop::collection::vec(any::<u8>(), 0..1_200), plausible in any::<bool>()) {
        if plausible && bytes.len() > 64 {
            // Past the first checks.
            for (word, value) in [(0, 3), (1, 64), (2, 448), (7, 2), (8, 34), (9, 17)] {
                bytes[4 * word..4 * word + 4].copy_from_slice(&u32::to_le_bytes(value));
            }
        }
        if let Ok(idrom) = Idrom::parse(&bytes) {
            prop_assert_eq!(idrom.pins.len(), idrom.width as usize);
            for module in &idrom.modules {
                for register in [0, 1, module.registers] {
                    let _ = module.address(register, module.instances);
                }
            }
        }
    }
}

#[test]
fn the_manuals_example() {
    let mut packet = Packet::new();
    packet
        .read(Space::HostMot2, Width::Bits32, 0x0100, 1)
        .unwrap();
    assert_eq!(packet.bytes(), [0x01, 0x42, 0x00, 0x01]);
    packet.clear();
    packet.write_register(0x1000, 0x0102_0304).unwrap();
    assert_eq!(packet.bytes(), [0x01, 0xC2, 0x00, 0x10, 4, 3, 2, 1]);
}

#[test]
fn a_packet_takes_no_more_than_there_is_room_for() {
    let mut packet = Packet::new();
    for data in [&[0_u8; 127 * 8][..], &[0; 56 * 8]] {
        packet
            .write(Space::HostMot2, Width::Bits64, 0, data)
            .unwrap();
    }
    let before = packet.bytes().to_vec();
    assert!(packet.write_register(0, 0).is_err());
    assert!(packet.write(Space::Flash, Width::Bits32, 0, &[]).is_err());
    assert!(
        packet
            .write(Space::Flash, Width::Bits32, 0, &[1, 2, 3])
            .is_err()
    );
    assert_eq!(packet.bytes(), before);
}

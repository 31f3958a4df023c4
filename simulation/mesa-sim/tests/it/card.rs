//! The card alone: its registers, and that no packet makes it panic.

use hostmot2::lbp16::{Command, MAX_PACKET, Packet, Space, Width};
use hostmot2::{Description, Layout, OutputPin, Selection, SequenceWindow};
use luna_mesa_sim::{Card, Server, Settings};
use proptest::prelude::*;

const MS: u64 = 1_000_000;

fn seeded() -> proptest::test_runner::Config {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok());
    proptest::test_runner::Config {
        rng_seed: proptest::test_runner::RngSeed::Fixed(seed.unwrap_or(20_261_121)),
        failure_persistence: None,
        cases: 500,
        ..Default::default()
    }
}

fn description() -> Description {
    let server = Server::start(Settings::default()).unwrap();
    let mut client = hostmot2::Client::connect(server.address()).unwrap();
    client.describe().unwrap()
}

fn selection() -> Selection {
    Selection {
        encoders: 2,
        latch_index: 0b10,
        pwms: 2,
        outputs: vec![OutputPin {
            pin: 12,
            neutral: true,
        }],
        watchdog_ns: 10 * MS,
        ..Selection::default()
    }
}

/// A driven card, and its layout; the last write packet came at 0 and has number 1.
fn driven() -> (Card, Layout, Packet) {
    let layout = Layout::new(&description(), &selection()).unwrap();
    let (mut card, mut packet, mut answer) = (Card::new(), Packet::new(), Vec::new());
    for packet in layout.set_up().unwrap() {
        card.handle(packet.bytes(), 0, &mut answer).unwrap();
    }
    assert!(card.is_neutral());
    layout.start_request(0, &mut packet).unwrap();
    card.handle(packet.bytes(), 0, &mut answer).unwrap();
    assert_eq!(card.driven_level(12), Some(true));
    let mut outputs = layout.outputs_at_rest();
    outputs.set_duty(1, 0.5);
    outputs.set_enabled(1, true);
    layout.set_output(&mut outputs, 0, false);
    layout.write_request(1, &outputs, &mut packet).unwrap();
    card.handle(packet.bytes(), 0, &mut answer).unwrap();
    assert!(answer.is_empty(), "a write has no answer");
    (card, layout, packet)
}

#[test]
fn it_answers_the_manuals_example() {
    let (mut card, mut answer) = (Card::new(), Vec::new());
    card.handle(&[0x01, 0x42, 0x00, 0x01], 0, &mut answer)
        .unwrap();
    assert_eq!(answer, [0xFE, 0xCA, 0xAA, 0x55]);
}

#[test]
fn a_cycle_drives_and_reads() {
    let (mut card, layout, mut packet) = driven();
    assert_eq!((card.duty(0), card.duty(1)), (0.0, 0.5));
    assert_eq!(card.driven_level(12), Some(false));
    card.turn_encoder(0, -3, 2 * MS);
    card.set_level(13, false);
    let mut answer = Vec::new();
    layout.read_request(77, &mut packet).unwrap();
    assert_eq!(packet.answer_len(), layout.answer_len());
    card.handle(packet.bytes(), 5 * MS, &mut answer).unwrap();
    let read = layout.decode(&answer).unwrap();
    assert_eq!((read.sequence, read.echo, read.has_bitten), (77, 1, false));
    assert!(read.is_driving());
    let encoder = read.encoder(0).unwrap();
    assert_eq!(encoder.count as i16, -3);
    // Stamps are microseconds here: it was turned 3 ms ago.
    assert_eq!(read.stamp.wrapping_sub(encoder.stamp), 3_000);
    assert_eq!(
        (read.pin(12, 17), read.pin(13, 17)),
        (Some(false), Some(false))
    );
    assert_eq!((read.pin(14, 17), read.pin(40, 17)), (Some(true), None));
    let window = |last| SequenceWindow { first: 0, last };
    assert_eq!(read.echo_state(window(1)), hostmot2::EchoState::UpToDate);
    assert_eq!(read.echo_state(window(2)), hostmot2::EchoState::Behind);
    assert_eq!(read.echo_state(window(0)), hostmot2::EchoState::Foreign);
}

#[test]
fn a_card_that_was_restarted_is_known_though_write_packets_go_on() {
    let nothing_driven = Selection {
        encoders: 1,
        latch_index: 1,
        ..Selection::default()
    };
    let layout = Layout::new(&description(), &nothing_driven).unwrap();
    let (mut packet, mut answer) = (Packet::new(), Vec::new());
    for is_started in [true, false] {
        let mut card = Card::new();
        if is_started {
            layout.start_request(9, &mut packet).unwrap();
            card.handle(packet.bytes(), 0, &mut answer).unwrap();
        }
        layout
            .write_request(10, &layout.outputs_at_rest(), &mut packet)
            .unwrap();
        card.handle(packet.bytes(), 0, &mut answer).unwrap();
        layout.read_request(7, &mut packet).unwrap();
        card.handle(packet.bytes(), 0, &mut answer).unwrap();
        let read = layout.decode(&answer).unwrap();
        assert!(read.is_driving() && !read.has_bitten);
        assert_eq!(
            (read.echo, read.session),
            (10, if is_started { 9 } else { 0 })
        );
        let window = SequenceWindow { first: 9, last: 10 };
        let expected = match is_started {
            true => hostmot2::EchoState::UpToDate,
            false => hostmot2::EchoState::Foreign,
        };
        assert_eq!(read.echo_state(window), expected);
    }
}

#[test]
fn the_index_is_latched_from_the_start_on_and_not_from_the_set_up() {
    let latching = Selection {
        encoders: 1,
        latch_index: 1,
        ..Selection::default()
    };
    let layout = Layout::new(&description(), &latching).unwrap();
    let (mut card, mut packet, mut answer) = (Card::new(), Packet::new(), Vec::new());
    card.set_index(0, 1_000);
    for packet in layout.set_up().unwrap() {
        card.handle(packet.bytes(), 0, &mut answer).unwrap();
    }
    card.turn_encoder(0, 1_500, 0);
    layout.start_request(1, &mut packet).unwrap();
    card.handle(packet.bytes(), 0, &mut answer).unwrap();
    for (count, index) in [(1_900, None), (2_100, Some(2_000)), (3_100, Some(2_000))] {
        card.turn_encoder(0, count, 0);
        layout.read_request(7, &mut packet).unwrap();
        card.handle(packet.bytes(), 0, &mut answer).unwrap();
        assert_eq!(
            layout.decode(&answer).unwrap().encoder(0).unwrap().index,
            index
        );
    }
}

#[test]
fn its_watchdog_bites_after_its_time_and_lets_go_of_all_pins() {
    let (mut card, layout, mut packet) = driven();
    card.advance(10 * MS - 100);
    assert!(!card.is_neutral());
    card.advance(10 * MS);
    assert!(card.is_neutral() && card.watchdog().has_bitten());
    // Restarting the watchdog does not bring the pins back.
    let mut outputs = layout.outputs_at_rest();
    outputs.set_duty(1, 0.5);
    outputs.set_enabled(1, true);
    layout.write_request(2, &outputs, &mut packet).unwrap();
    card.handle(packet.bytes(), 11 * MS, &mut Vec::new())
        .unwrap();
    assert!(card.is_neutral());
}

#[test]
fn feeds_keep_the_watchdog_from_expiring() {
    let (mut card, _, packet) = driven();
    for time in 1..50 {
        card.handle(packet.bytes(), 9 * time * MS, &mut Vec::new())
            .unwrap();
        assert!(!card.is_neutral());
    }
}

#[test]
fn after_the_neutral_packet_no_packet_of_a_cycle_drives_anything() {
    let (mut card, layout, cycle) = driven();
    let mut neutral = Packet::new();
    layout.neutral_request(&mut neutral).unwrap();
    card.handle(neutral.bytes(), MS, &mut Vec::new()).unwrap();
    assert!(card.is_neutral());
    // Packets that were overtaken.
    for time in 2..5 {
        card.handle(cycle.bytes(), time * MS, &mut Vec::new())
            .unwrap();
        assert!(card.is_neutral());
    }
}

#[test]
fn commands_without_an_address_go_on_where_the_space_was_left() {
    let (mut card, mut answer, mut packet) = (Card::new(), Vec::new(), Packet::new());
    packet.read(Space::Board, Width::Bits8, 0, 2).unwrap();
    let on = Command {
        write: false,
        info: false,
        space: Space::Board,
        width: Width::Bits8,
        increment: true,
        count: 2,
        address: None,
    };
    packet.push(on, &[]).unwrap();
    card.handle(packet.bytes(), 0, &mut answer).unwrap();
    assert_eq!(answer, b"7I92");
}

#[test]
fn flash_is_erased_to_ones_and_written_to_zeroes() {
    let (mut card, mut answer) = (Card::new(), Vec::new());
    let mut packet = Packet::new();
    let word = |packet: &mut Packet, at: u16, value: u32| {
        let value = value.to_le_bytes();
        packet
            .write(Space::Flash, Width::Bits32, at, &value)
            .map(drop)
            .unwrap();
    };
    word(&mut packet, 0, 0x1_0000);
    word(&mut packet, 4, 0x0F0F_0F0F);
    word(&mut packet, 0, 0x1_0000);
    packet.read(Space::Flash, Width::Bits32, 4, 1).unwrap();
    word(&mut packet, 0x0C, 0);
    packet.read(Space::Flash, Width::Bits32, 4, 1).unwrap();
    card.handle(packet.bytes(), 0, &mut answer).unwrap();
    assert_eq!(answer, [0x0F, 0x0F, 0x0F, 0x0F, 0xFF, 0xFF, 0xFF, 0xFF]);
}

proptest! {
    #![proptest_config(seeded())]

    #[test]
    fn no_packet_makes_it_panic(
        packets in prop::collection::vec((prop::collection::vec(any::<u8>(), 0..200), any::<u64>()), 1..8),
    ) {
        let (mut card, mut answer) = (Card::new(), Vec::new());
        for (packet, now) in packets {
            let done = card.handle(&packet, now >> 1, &mut answer);
            prop_assert!(answer.len() <= MAX_PACKET);
            prop_assert!(done.is_ok() || answer.is_empty());
        }
    }

    /// A card's answer to a packet of any layout is an answer of that layout.
    #[test]
    fn answers_have_the_announced_length(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let (mut card, layout, mut packet) = driven();
        let mut answer = Vec::new();
        let _ = card.handle(&bytes, MS, &mut answer);
        layout.read_request(5, &mut packet).unwrap();
        card.handle(packet.bytes(), 2 * MS, &mut answer).unwrap();
        prop_assert_eq!(layout.decode(&answer).unwrap().sequence, 5);
    }
}

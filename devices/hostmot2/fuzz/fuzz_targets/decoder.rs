//! Everything read from the wire: packets, answers, descriptions, and what is computed of them.
#![no_main]

use hostmot2::encoder::{Stamps, Tracker};
use hostmot2::idrom::{Idrom, Pin, SIZE, Tag};
use hostmot2::lbp16::{Operations, Packet};
use hostmot2::{Board, Description, Layout, OutputPin, Selection, SequenceWindow};
use libfuzzer_sys::fuzz_target;
use std::time::Duration;

fuzz_target!(|bytes: &[u8]| {
    packet(bytes);
    if let Ok(idrom) = Idrom::parse(bytes) {
        assert_eq!(idrom.pins.len(), idrom.width as usize);
        let _ = idrom.pins.iter().filter(|pin| Pin::is_module_output(pin)).count();
        card(idrom, bytes.get(SIZE..).unwrap_or(bytes));
    }
});

/// A packet that is read and made again is the same.
fn packet(bytes: &[u8]) {
    let mut again = Packet::new();
    let (mut length, mut fits, mut failed) = (0, true, false);
    for operation in Operations::new(bytes) {
        match operation {
            Ok(operation) => {
                let address = if operation.command.address.is_some() { 2 } else { 0 };
                length += 2 + address + operation.data.len();
                fits &= again.push(operation.command, operation.data).is_ok();
            }
            Err(_) => failed = true,
        }
    }
    assert!(length <= bytes.len() && (failed || length == bytes.len()));
    if fits {
        assert_eq!(again.bytes(), &bytes[..length]);
    }
}

/// A card with this description and this answer.
fn card(idrom: Idrom, bytes: &[u8]) {
    let count = |tag| idrom.module(tag).map_or(0, |module| module.instances);
    let selection = Selection {
        encoders: count(Tag::ENCODERS).min(8),
        latch_index: 0b101,
        pwms: count(Tag::PWM).min(8),
        outputs: vec![OutputPin { pin: 12, neutral: true }],
        ..Selection::default()
    };
    let board = Board {
        name: String::new(),
        lbp16_version: 0,
        firmware_version: 0,
        jumpers: 0,
    };
    let description = Description { board, configuration: String::new(), idrom };
    let Ok(layout) = Layout::new(&description, &selection) else { return };
    let mut made = Packet::new();
    let _ = layout.set_up();
    let _ = layout.start_request(1, &mut made);
    let _ = layout.neutral_request(&mut made);
    let _ = layout.write_request(2, &layout.outputs_at_rest(), &mut made);
    if layout.read_request(3, &mut made).is_ok() {
        assert_eq!(made.answer_len(), layout.answer_len());
    }
    let mut stamps = Stamps::new(layout.stamps_per_second());
    let mut trackers = vec![Tracker::new(1e6).ignoring_quadrature_errors(); layout.encoders()];
    for answer in bytes.chunks(layout.answer_len()) {
        let Ok(answer) = layout.decode(answer) else { continue };
        let elapsed = Duration::from_micros(answer.sequence.into());
        stamps.update(answer.stamp, elapsed);
        for (number, tracker) in trackers.iter_mut().enumerate() {
            if let Some(raw) = answer.encoder(number) {
                let _ = tracker.update(raw, &stamps, elapsed);
            }
        }
        let _ = (answer.is_driving(), answer.pin(12, 17), answer.pin(255, 0));
        let _ = answer.echo_state(SequenceWindow { first: 0, last: answer.sequence });
    }
}

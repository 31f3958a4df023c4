//! The simulated card, given any packets at any times.
#![no_main]

use hostmot2::lbp16::MAX_PACKET;
use libfuzzer_sys::fuzz_target;
use luna_mesa_sim::{Card, ENCODERS, PINS, PWMS};

fuzz_target!(|bytes: &[u8]| {
    let (mut card, mut answer, mut now) = (Card::new(), Vec::new(), 0_u64);
    let mut rest = bytes;
    // Each packet with its length and the time before it.
    while let Some(([length, time], packets)) = rest.split_first_chunk::<2>() {
        let length = usize::from(*length).min(packets.len());
        let (packet, after) = packets.split_at(length);
        rest = after;
        now += u64::from(*time) * 1_000_000;
        card.turn_encoder(usize::from(*time) % (ENCODERS + 1), now as i64 * 7, now);
        let done = card.handle(packet, now, &mut answer);
        assert!(answer.len() <= MAX_PACKET);
        assert!(done.is_ok() || answer.is_empty());
        for pwm in 0..=PWMS {
            assert!(card.duty(pwm).abs() < 1.0);
        }
        let _ = (0..=PINS).filter_map(|pin| card.driven_level(pin)).count();
    }
});

//! Sides that are restarted, on a wire that keeps datagrams of earlier sessions for long.

use super::wire::{Arrival, BEGIN, Faults, SimulatedClock, Wire};
use crate::common::{Random, seed, watchdog};
use luna_links::cycle::{Protocol, Received, Settings};
use std::time::Duration;

const PERIOD: u64 = 1_000_000;

/// The opening of the sender, and what it counts.
type Side = Protocol<[u8; 16], [u8; 16]>;

fn value(opening: u64, number: u64) -> [u8; 16] {
    (u128::from(opening) << 64 | u128::from(number)).to_le_bytes()
}

#[test]
fn a_restarted_side_is_heard_again_and_nothing_old_is_delivered() {
    let _watch = watchdog();
    let mut random = Random::new(seed());
    let faults = Faults {
        // Some take longer than a session lives.
        delay: 300_000_000,
        slow: 40,
        ..Faults::MANY
    };
    let settings = Settings::new(Duration::from_nanos(PERIOD)).stale_after(8);
    let clock = SimulatedClock::default();
    let mut wire = Wire::new(random.split(), faults);
    let open = |opening: u64, side: usize, now| {
        Side::new(opening * 2 + side as u64 + 1, &settings, clock.moment(now))
    };
    let mut openings = [0_u64; 2];
    let mut opened = [BEGIN; 2];
    let mut sides = [0, 1].map(|side| open(0, side, BEGIN));
    // Of the sender, as the other side has last seen it.
    let mut last = [(0, 0); 2];
    let mut received_since = [0; 2];
    for number in 1..=20_000_u64 {
        let now = BEGIN + number * PERIOD;
        for side in [0, 1] {
            if random.below(1_000_u32) == 0 {
                // Both hear each other well before most restarts.
                openings[side] += 1;
                opened[side] = now;
                sides[side] = open(openings[side], side, now);
                received_since[side] = 0;
                last[side] = (0, 0);
            }
            let moment = clock.moment(now);
            let bytes = sides[side].send(&value(openings[side], number), None, moment);
            wire.send(1 - side, bytes, now);
        }
        while let Some(arrival) = wire.next(now + PERIOD - 1) {
            let Arrival { now, to, sent, .. } = arrival;
            match sides[to].receive(&arrival.bytes, clock.moment(now)) {
                Received::Sample(sample) => {
                    let all = u128::from_le_bytes(sample.value);
                    let (opening, number) = ((all >> 64) as u64, all as u64);
                    assert!((opening, number) > last[to], "{opening}, {number}");
                    assert!(sent >= opened[to], "it was sent to an earlier opening");
                    last[to] = (opening, number);
                    received_since[to] += 1;
                }
                Received::Answer => {
                    let hello = sides[to].hello(clock.moment(now)).to_vec();
                    wire.send(1 - to, &hello, now);
                }
                Received::Nothing => {}
            }
        }
    }
    assert!(openings.iter().all(|count| *count > 5), "{openings:?}");
    // The wire delivers nearly nine in ten on time: both are connected most of the time.
    for (side, protocol) in sides.iter().enumerate() {
        let status = protocol.status();
        let since = (BEGIN + 20_000 * PERIOD - opened[side].max(opened[1 - side])) / PERIOD;
        assert!(since < 100 || received_since[side] > 0, "{status:?}");
    }
}

#[test]
fn a_partner_that_lives_is_not_replaced() {
    let settings = Settings::new(Duration::from_nanos(PERIOD)).stale_after(3);
    let at = |cycles: u64| SimulatedClock::default().moment(BEGIN + cycles * PERIOD);
    let [mut here, mut there, mut intruder] =
        [1, 2, 3].map(|session| Side::new(session, &settings, at(0)));
    assert_eq!(here.receive(there.hello(at(0)), at(0)), Received::Answer);
    there.receive(here.hello(at(0)), at(0));
    here.receive(there.hello(at(0)), at(0));
    assert_eq!(here.status().sessions(), 1);
    // The intruder hears what goes to the partner, and speaks.
    intruder.receive(here.hello(at(1)), at(1));
    assert_eq!(
        here.receive(intruder.hello(at(1)), at(1)),
        Received::Nothing
    );
    assert_eq!(
        here.status().foreign(),
        2,
        "the partner's first hello is one"
    );
    let sample = here.receive(there.send(&[5; 16], None, at(2)), at(2));
    assert!(matches!(sample, Received::Sample(sample) if sample.session == 1));
    // When the partner is silent for longer than three cycles, another one is asked.
    assert_eq!(here.silence(at(5).instant), None);
    let silence = here.silence(at(6).instant).unwrap();
    assert_eq!((silence.since, silence.has_heard), (at(2).instant, true));
    assert_eq!(here.receive(intruder.hello(at(6)), at(6)), Received::Answer);
    // Its old knowledge is no answer.
    assert_eq!(here.receive(intruder.hello(at(6)), at(6)), Received::Answer);
    intruder.receive(here.hello(at(6)), at(6));
    let sample = here.receive(intruder.send(&[6; 16], None, at(7)), at(7));
    assert!(matches!(sample, Received::Sample(sample) if sample.session == 2));
    assert_eq!(
        (here.status().stale(), here.silence(at(8).instant)),
        (1, None)
    );
}

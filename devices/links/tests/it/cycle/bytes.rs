//! Bytes that are no datagram, and datagrams that were changed on their way.

use super::wire::{BEGIN, SimulatedClock};
use luna_links::cycle::{MAX_SIZE, Protocol, Received, Settings};
use proptest::prelude::*;
use std::time::Duration;

type Side = Protocol<[u8; 16], [u8; 16]>;

fn sides() -> [Side; 2] {
    let settings = Settings::new(Duration::from_millis(1));
    let now = SimulatedClock::default().moment(BEGIN);
    let mut sides = [7, 8].map(|session| Side::new(session, &settings, now));
    let [here, there] = &mut sides;
    assert_eq!(here.receive(there.hello(now), now), Received::Answer);
    assert_eq!(there.receive(here.hello(now), now), Received::Answer);
    assert_eq!(here.receive(there.hello(now), now), Received::Nothing);
    assert_eq!(there.receive(here.hello(now), now), Received::Nothing);
    assert_eq!(
        [&sides[0], &sides[1]].map(|side| side.status().sessions()),
        [1, 1]
    );
    sides
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn changed_datagrams_do_no_harm(
        changes in prop::collection::vec(
            (prop::collection::vec((0_usize..120, any::<u8>()), 0..4), 0_usize..122), 1..40),
        noise in prop::collection::vec(any::<u8>(), 0..MAX_SIZE),
    ) {
        let [mut here, mut there] = sides();
        let mut last = 0;
        for (number, (bytes, length)) in (1_u64..).zip(changes) {
            let now = SimulatedClock::default().moment(BEGIN + number * 1_000_000);
            let mut datagram = there.send(&[number as u8; 16], None, now).to_vec();
            for (at, byte) in bytes {
                datagram[at] = byte;
            }
            datagram.truncate(length);
            for bytes in [&datagram[..], &noise, &datagram] {
                if let Received::Sample(sample) = here.receive(bytes, now) {
                    prop_assert!(sample.sequence > last);
                    last = sample.sequence;
                }
            }
        }
        let status = here.status();
        prop_assert!(status.malformed() > 0, "the noise at least");
        prop_assert_eq!(status.sessions(), 1);
    }
}

#[test]
fn another_type_is_noticed_and_not_decoded() {
    let settings = Settings::new(Duration::from_millis(1));
    let now = SimulatedClock::default().moment(BEGIN);
    let mut here = Protocol::<[u8; 4], [u8; 4]>::new(1, &settings, now);
    let mut there = Protocol::<[u8; 5], [u8; 4]>::new(2, &settings, now);
    assert_eq!(
        here.receive(there.send(&[1; 5], None, now), now),
        Received::Nothing
    );
    let status = here.status();
    assert_eq!(
        (status.mistyped(), status.received(), status.sessions()),
        (1, 0, 0)
    );
    assert_eq!(status.other_type().unwrap().size, 5);
}

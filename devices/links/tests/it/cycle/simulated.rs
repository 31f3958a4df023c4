//! Two sides on a wire that loses, doubles and reorders, with clocks that drift: nothing is doubled
//! or reordered, each loss is counted, and every stamp is within its stated error.

use super::wire::{Arrival, BEGIN, Faults, HERE, SimulatedClock, THERE, Wire};
use crate::common::{Random, seed, watchdog};
use luna_links::cycle::{Moment, Protocol, Received, Sample, Settings, Status};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::time::Duration;

const PERIOD: u64 = 1_000_000;

type Side = Protocol<[u8; 8], [u8; 8]>;

/// What one side has received.
#[derive(Default)]
struct Seen {
    last: Option<u64>,
    first: u64,
    count: u64,
    lost: u64,
    greatest_error: u64,
    least_error: Option<u64>,
    /// Number of arrivals by the datagram's number, since the partner is known.
    arrivals: BTreeMap<u64, u64>,
}

impl Seen {
    fn sample(&mut self, sample: &Sample<[u8; 8]>) {
        assert_eq!(u64::from_le_bytes(sample.value), sample.sequence);
        match self.last {
            None => {
                self.first = sample.sequence;
                assert_eq!(sample.lost_before, 0);
            }
            Some(last) => {
                assert!(sample.sequence > last, "{} after {last}", sample.sequence);
                assert_eq!(sample.lost_before, sample.sequence - last - 1);
            }
        }
        self.last = Some(sample.sequence);
        self.count += 1;
        self.lost += sample.lost_before;
    }
}

struct World {
    sides: [Side; 2],
    clocks: [SimulatedClock; 2],
    seen: [Seen; 2],
    wire: Wire,
}

impl World {
    fn new(random: Random, faults: Faults, clocks: [SimulatedClock; 2]) -> Self {
        let settings = Settings::new(Duration::from_nanos(PERIOD)).stale_after(200);
        let side =
            |number: u64, clock: SimulatedClock| Side::new(number, &settings, clock.moment(BEGIN));
        Self {
            sides: [side(11, clocks[HERE]), side(22, clocks[THERE])],
            clocks,
            seen: Default::default(),
            wire: Wire::new(random, faults),
        }
    }

    fn moment(&self, side: usize, now: u64) -> Moment {
        self.clocks[side].moment(now)
    }

    /// Both sides send a value in each cycle.
    fn run(&mut self, cycles: u64) {
        for number in 1..=cycles {
            let now = BEGIN + number * PERIOD;
            for side in [HERE, THERE] {
                let moment = self.moment(side, now);
                let value = number.to_le_bytes();
                let bytes = self.sides[side].send(&value, Some(moment.stamp), moment);
                self.wire.send(1 - side, bytes, now);
            }
            while let Some(arrival) = self.wire.next(now + PERIOD - 1) {
                self.arrive(&arrival);
            }
        }
    }

    fn arrive(&mut self, arrival: &Arrival) {
        let Arrival { now, to, .. } = *arrival;
        let moment = self.moment(to, now);
        let was_known = self.sides[to].status().sessions() > 0;
        let received = self.sides[to].receive(&arrival.bytes, moment);
        if was_known || self.sides[to].status().sessions() > 0 {
            let number = u64::from_le_bytes(arrival.bytes[40..48].try_into().unwrap());
            *self.seen[to].arrivals.entry(number).or_default() += 1;
        }
        match received {
            Received::Sample(sample) => {
                self.check_stamps(arrival, &sample);
                self.seen[to].sample(&sample);
            }
            Received::Answer => {
                let hello = self.sides[to].hello(moment).to_vec();
                self.wire.send(1 - to, &hello, now);
            }
            Received::Nothing => {}
        }
    }

    /// Against the truth that only the simulation knows.
    fn check_stamps(&mut self, arrival: &Arrival, sample: &Sample<[u8; 8]>) {
        let Arrival { now, to, sent, .. } = *arrival;
        let offset = self.sides[to]
            .status()
            .offset()
            .expect("both ways are known");
        let [here, there] = [to, 1 - to].map(|side| self.clocks[side].stamp(now));
        let wrong = there.nanos_since(here).abs_diff(offset.nanos);
        assert!(wrong <= offset.error, "{wrong} > {}", offset.error);
        let seen = &mut self.seen[to];
        seen.greatest_error = seen.greatest_error.max(offset.error);
        let least = seen.least_error.unwrap_or(u64::MAX);
        seen.least_error = Some(least.min(offset.error));

        let age = sample.age.expect("there is an offset");
        let real = here.nanos_since(self.clocks[to].stamp(sent)).unsigned_abs();
        let wrong = (age.time.as_nanos() as u64).abs_diff(real);
        assert!(
            wrong <= age.error.as_nanos() as u64,
            "{age:?}, really {real}"
        );
        let tick = sample.tick.expect("it was sent with one");
        let wrong = tick
            .at
            .nanos_since(self.clocks[to].stamp(sent))
            .unsigned_abs();
        assert!(wrong <= tick.error.as_nanos() as u64, "{tick:?}, {wrong}");
    }

    fn check_counts(&self, side: usize) -> Status {
        let (seen, status) = (&self.seen[side], self.sides[side].status());
        let last = seen.last.expect("something has come");
        assert_eq!(status.received(), seen.count);
        assert_eq!(status.lost(), seen.lost);
        assert_eq!(seen.lost + seen.count, last - seen.first + 1);
        // None came so late that duplicates cannot be distinguished from overtaken ones.
        let again: u64 = seen.arrivals.values().map(|times| times - 1).sum();
        let early = seen
            .arrivals
            .range(..seen.first + 20)
            .map(|(_, times)| times - 1);
        assert!(status.duplicates() <= again);
        assert!(status.duplicates() + early.sum::<u64>() >= again);
        assert!(status.overtaken() <= status.lost());
        assert_eq!((status.malformed(), status.mistyped()), (0, 0));
        assert_eq!(
            (status.sessions(), status.clock_steps(), status.stale()),
            (1, 0, 0)
        );
        status
    }
}

#[test]
fn each_loss_is_counted_and_nothing_comes_twice_or_late() {
    let _watch = watchdog();
    let random = Random::new(seed());
    let clocks = [
        SimulatedClock { offset: 0, ppb: 0 },
        SimulatedClock {
            offset: -900_000_000_000,
            ppb: 60_000,
        },
    ];
    let mut world = World::new(random, Faults::MANY, clocks);
    world.run(20_000);
    for side in [HERE, THERE] {
        let status = world.check_counts(side);
        // The wire did what it should.
        for count in [status.lost(), status.overtaken(), status.duplicates()] {
            assert!(count > 300, "{status:?}");
        }
        // Between some that took 20 µs, and the drift over those that took a millisecond.
        assert!(
            world.seen[side].least_error.unwrap() < 200_000,
            "{status:?}"
        );
    }
}

#[test]
fn a_wire_without_faults_loses_nothing() {
    let clocks = [
        SimulatedClock::default(),
        SimulatedClock {
            offset: 5,
            ppb: -1_000,
        },
    ];
    let mut world = World::new(Random::new(1), Faults::NONE, clocks);
    world.run(1_000);
    for side in [HERE, THERE] {
        let status = world.check_counts(side);
        let counts = (
            status.received(),
            status.lost(),
            status.duplicates(),
            status.overtaken(),
        );
        assert!(
            counts.0 >= 998 && (counts.1, counts.2, counts.3) == (0, 0, 0),
            "{status:?}"
        );
        // Half of the way there and back, and a cycle's drift.
        assert!(world.seen[side].greatest_error < 20_500, "{status:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn stamps_are_within_their_error_for_all_clocks_and_wires(
        seed in any::<u64>(),
        offsets in [-900_000_000_000_i64..2_000_000_000_000_000, -900_000_000_000_i64..900_000_000_000],
        ppb in [-95_000_i64..95_000, -95_000_i64..95_000],
        lost in 0_u8..200,
        doubled in 0_u8..100,
        slow in 0_u8..100,
        least in 0_u64..3_000_000,
        jitter in 0_u64..3_000_000,
    ) {
        let faults = Faults { lost, doubled, slow, delay: 50_000_000, least, jitter };
        let clocks = [0, 1].map(|side| SimulatedClock { offset: offsets[side], ppb: ppb[side] });
        // It asserts.
        World::new(Random::new(seed), faults, clocks).run(300);
    }
}

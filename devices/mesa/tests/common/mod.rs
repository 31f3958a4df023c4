//! A card with an encoder that turns at a known speed, and a system around its link.

#![allow(
    dead_code,
    unused_imports,
    reason = "each test program uses some of it"
)]

#[path = "../../../../tests/shared/mod.rs"]
mod shared;
#[path = "../../../../tests/shared/spawn.rs"]
mod spawn;

use luna::prelude::*;
use luna_mesa::{Bucket, Card, Fault, Link, Reading, Sample};
use luna_mesa_sim::{Card as SimCard, Server, Settings};
pub(crate) use spawn::SpawnOk;
use std::time::Duration;

pub(crate) const PERIOD: Duration = Duration::from_millis(2);

/// Counts a second of encoder 0: 20 a period.
pub(crate) const SPEED: f64 = 10_000.0;
/// The link's greatest speed: a silence of two seconds is then not too long.
pub(crate) const FASTEST: f64 = 12_000.0;

/// Where encoder 0 is at a time (ns).
pub(crate) fn count_at(now: u64) -> i64 {
    (now / 100_000) as i64
}

/// A card with encoder 0 turning at [`SPEED`] for ever.
pub(crate) fn turning() -> Server {
    let settings = Settings {
        world: Box::new(|now: u64, card: &mut SimCard| card.turn_encoder(0, count_at(now), now)),
        seed: seed(),
        ..Settings::default()
    };
    Server::start(settings).unwrap()
}

pub(crate) fn seed() -> u64 {
    shared::seed_or_else(|| 20_261_121)
}

/// A tolerant link, so that a busy machine does not change the outcome.
pub(crate) fn patient(server: &Server) -> Link {
    patient_link(Card::open(server.address()).unwrap())
}

/// As [`patient`], of a card that is open.
pub(crate) fn patient_link(card: Card) -> Link {
    let mut link = card.link("card", PERIOD);
    link.watchdog(Duration::from_secs(5))
        .tolerance(Bucket::new(1, 1, 5_000));
    link
}

pub(crate) fn samples() -> (Sender<Sample<Reading>>, Receiver<Sample<Reading>>) {
    luna::buffered(Buffer::fifo(256))
}

pub(crate) fn register<T: Copy + Send>() -> (Sender<T>, Receiver<T>) {
    luna::buffered(Buffer::overwrite_oldest(1))
}

/// Invariants of a controller's samples: fresh values are those of their time, others the last
/// fresh one.
#[derive(Debug, Default)]
pub(crate) struct Truth {
    /// Where the counter may have been at position 0.
    zero: Option<[i64; 2]>,
    last: Option<Sample<Reading>>,
    pub(crate) fresh: u32,
    pub(crate) stale: u32,
    pub(crate) longest: u32,
}

impl Truth {
    pub(crate) fn check(&mut self, sample: Sample<Reading>) {
        match sample.fresh() {
            Some(reading) => {
                let [asked, answered] = sample.measured_between();
                let zero = [asked, answered].map(|at| count_at(at.as_nanos()) - reading.position);
                let [low, high] = self.zero.unwrap_or(zero);
                let both = [low.max(zero[0]), high.min(zero[1])];
                assert!(
                    both[0] <= both[1],
                    "a wrong position: {sample:?}, zero {zero:?}, before {low}..={high}"
                );
                self.zero = Some(both);
                self.fresh += 1;
            }
            None => {
                let last = self.last.expect("nothing is sent before the first answer");
                assert_eq!(sample.held(), last.held());
                assert_eq!(sample.measured_between(), last.measured_between());
                assert_eq!(sample.stale_cycles(), last.stale_cycles() + 1);
                self.stale += 1;
                self.longest = self.longest.max(sample.stale_cycles());
            }
        }
        self.last = Some(sample);
    }
}

/// The fault that has ended a run.
pub(crate) fn fault(outcome: luna::Result<luna::Report>) -> Fault {
    let error = outcome.expect_err("the link has failed");
    let luna::Error::Process { source, .. } = &error else {
        panic!("not of a process: {error}");
    };
    let luna::Error::Other(other) = &**source else {
        panic!("not a link's: {error}");
    };
    other
        .get()
        .downcast_ref::<Fault>()
        .expect("a fault")
        .clone()
}

/// Looks at the card until it is so, for ten seconds at most.
pub(crate) fn wait_until(server: &Server, is_so: impl Fn(&SimCard) -> bool) {
    let deadline = luna::now() + Duration::from_secs(10);
    while !server.with_card(|card, _| is_so(card)) {
        assert!(luna::now() < deadline, "it never came to be so");
        std::thread::yield_now();
    }
}

//! Shared by the test programs of all crates: a watchdog, skipped tests, random numbers. Needs the
//! standard library alone.

#![allow(
    dead_code,
    missing_debug_implementations,
    reason = "each test program uses some of it"
)]

use std::sync::mpsc;
use std::time::Duration;

/// As `eprintln`, but not captured by the harness.
#[allow(unused_macros, reason = "each test program uses some of it")]
macro_rules! report {
    ($($text:tt)*) => {{
        let _ = std::io::Write::write_fmt(&mut std::io::stderr(), format_args!("{}\n", format_args!($($text)*)));
    }};
}

#[macro_use]
pub(crate) mod own_process;

/// Ends the whole program if the test that made it is not done after five minutes: a test that
/// hangs has failed, and its name is printed.
pub(crate) struct Watchdog {
    _alive: mpsc::Sender<()>,
}

impl Watchdog {
    pub(crate) fn new() -> Self {
        let (alive, ended) = mpsc::channel::<()>();
        let (starting, started) = mpsc::channel::<()>();
        let test = current_test();
        std::thread::spawn(move || {
            drop(starting);
            if ended.recv_timeout(Duration::from_secs(300)) == Err(mpsc::RecvTimeoutError::Timeout)
            {
                eprintln!("`{test}` hangs");
                std::process::abort();
            }
        });
        // What its start allocates has been allocated then.
        let _ = started.recv();
        Self { _alive: alive }
    }
}

pub(crate) fn watchdog() -> Watchdog {
    Watchdog::new()
}

fn current_test() -> String {
    std::thread::current().name().unwrap_or("a test").to_owned()
}

/// Writes a line to standard error itself, since the harness captures what a macro prints.
pub(crate) fn say(text: &str) {
    report!("{text}");
}

/// Says that the calling test cannot run here.
pub(crate) fn skip(why: &str) {
    report!("skipped: {}: {why}", current_test());
}

/// The environment's LUNA_SEED, else one of the clock. It is printed, for when the test fails.
pub(crate) fn seed() -> u64 {
    seed_or_else(|| {
        std::time::UNIX_EPOCH
            .elapsed()
            .map_or(1, |since| since.as_nanos() as u64)
    })
}

/// The same, with another seed where the environment has none.
pub(crate) fn seed_or_else(other: impl FnOnce() -> u64) -> u64 {
    let seed = std::env::var("LUNA_SEED")
        .ok()
        .and_then(|seed| seed.parse().ok())
        .unwrap_or_else(other);
    println!("LUNA_SEED={seed}");
    seed
}

/// Whether `LUNA_LONG=1` asks for all that a test can try.
pub(crate) fn is_long() -> bool {
    std::env::var("LUNA_LONG").is_ok_and(|long| long == "1")
}

/// Each `every`th of these, from a place that the [seed] says; all of them if the test [is
/// long](is_long).
pub(crate) fn sample<T>(all: impl IntoIterator<Item = T>, every: usize) -> impl Iterator<Item = T> {
    let (first, every) = match is_long() {
        true => (0, 1),
        false => (Random::seeded().below(every), every),
    };
    all.into_iter().skip(first).step_by(every)
}

/// Numbers that look random: SplitMix64.
#[derive(Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Seeded by [`seed`].
    pub(crate) fn seeded() -> Self {
        Self::new(seed())
    }

    /// A sequence of its own, for a thread or a process.
    pub(crate) fn split(&mut self) -> Self {
        Self(self.next())
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`; 0 if there is none.
    pub(crate) fn below<N: TryFrom<u64> + TryInto<u64>>(&mut self, end: N) -> N {
        let end = end.try_into().unwrap_or(1).max(1);
        let below = N::try_from(self.next() % end);
        below.unwrap_or_else(|_| unreachable!("it is less than one of that type"))
    }

    /// True in `parts` of 256 cases.
    pub(crate) fn chance(&mut self, parts: u8) -> bool {
        self.below(256_u16) < u16::from(parts)
    }
}

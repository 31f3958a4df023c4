//! What runs beside a measured loop to disturb it: other loops on its executor, and a thread below
//! it that keeps the core busy.

use crate::{args, place};
use luna::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The slowest and the fastest of the other loops.
const PERIODS: (f64, f64) = (10_000.0, 1000.0);

/// What a burner leaves of the core between two bursts. The kernel gives ordinary threads some 5 %
/// of a core that real-time threads keep busy, above all of them. Taken while the core is idle,
/// that time adds to no latency.
const REST: Duration = Duration::from_millis(15);

/// Whether the measured loop has ended.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ended(Arc<AtomicBool>);

impl Ended {
    fn has_come(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Signals that the measured loop has ended, however it did.
#[derive(Debug)]
pub(crate) struct EndsOnDrop(pub(crate) Ended);

impl Drop for EndsOnDrop {
    fn drop(&mut self) {
        self.0.0.store(true, Ordering::Relaxed);
    }
}

/// Loops from 100 Hz to 1 kHz, each rate a little above the one before, at all levels below the
/// highest.
pub(crate) fn others(executor: &luna::Executor, count: u32, until: &Ended) -> luna::Result<()> {
    for number in 0..count {
        let until = until.clone();
        let name = format!("other {number}");
        executor
            .process(name.clone())
            .priority((number % 31) as u8)
            .spawn(async move {
                let mut tick = luna::periodic(&name, period(number, count))?;
                while !until.has_come() {
                    tick.next().await;
                }
                Ok(())
            })?;
    }
    Ok(())
}

/// The period of one of so many loops.
fn period(number: u32, count: u32) -> Duration {
    let (slowest, fastest) = PERIODS;
    let part = f64::from(number) / f64::from(count.max(2) - 1);
    Duration::from_secs_f64(slowest * (fastest / slowest).powf(part) / 1e6)
}

/// A thread on the same core, below the measured one, that keeps it busy for `burst` at a time.
pub(crate) fn burner(
    system: &mut System,
    place: &args::Placement,
    burst: Duration,
    until: &Ended,
) -> luna::Result<()> {
    let policy = if place.policy.priority() > 1 {
        Policy::fifo(1)
    } else {
        Policy::Other
    };
    let until = until.clone();
    place::executor_under(system, "burner", place, policy)?
        .process("burner")
        .spawn(async move {
            while !until.has_come() {
                let end = luna::now() + burst;
                while luna::now() < end {
                    std::hint::spin_loop();
                }
                luna::after(REST).await;
            }
            Ok(())
        })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_others_go_from_100_hz_to_1_khz() {
        assert_eq!(period(0, 99), Duration::from_millis(10));
        assert_eq!(period(98, 99), Duration::from_millis(1));
        assert!((0..98).all(|number| period(number, 99) > period(number + 1, 99)));
        assert_eq!(period(0, 1), Duration::from_millis(10));
    }
}

//! How long it takes to wake a thread on another core.

use super::{Measured, Measurement, WAKE_UP, threads};
use crate::doctor::finding::Finding;
use luna::{Instant, now};
use luna_platform::futex::Futex;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The most pairs that are measured. The finding says so if there are more.
const MAX_PAIRS: usize = 16;
/// An answer that takes longer ends the measurement.
const PATIENCE: Duration = Duration::from_secs(5);
const WHY: &str = "what a message to a sleeping executor on another core takes at least";

/// Each core and the next one, `each` in all.
pub(super) fn between(cores: &[usize], each: Duration) -> Vec<Finding> {
    let pairs: Vec<_> = match cores {
        // Two threads of one core can be measured too.
        [only] => vec![(*only, *only)],
        _ => cores.windows(2).map(|two| (two[0], two[1])).collect(),
    };
    let share = each / u32::try_from(pairs.len().clamp(1, MAX_PAIRS)).unwrap_or(1);
    let (measured, left_out) = pairs.split_at(pairs.len().min(MAX_PAIRS));
    let measured = measured.iter().map(|&(from, to)| {
        let measurement = Measurement {
            name: format!("wake-core-{from}-to-{to}"),
            why: WHY,
            advice: "see the findings above on idle-states, cpu-dma-latency and hypervisor; or put both ends on one executor",
            bounds: WAKE_UP,
        };
        measurement.finding(from_to(from, to, share))
    });
    let callees: Vec<_> = left_out.iter().map(|(_, to)| *to).collect();
    measured
        .chain(super::left_out("wake-other-cores", WHY, &callees))
        .collect()
}

/// What the two threads share.
struct Table {
    /// Rises by one with each wake there, and each answer.
    called: Futex,
    answered: Futex,
    /// When the call was made.
    at: AtomicU64,
}

fn from_to(from: usize, to: usize, time: Duration) -> Result<Measured, String> {
    let table = Arc::new(Table {
        called: Futex::new(0),
        answered: Futex::new(0),
        at: AtomicU64::new(0),
    });
    // Once in 100 µs: both threads sleep by then. Samples beyond that room are left out.
    let most = usize::try_from(time.as_micros() / 100).unwrap_or(0).max(20);

    let (ours, theirs) = (table.clone(), table);
    let callee = threads::on(to, threads::PRIORITY, move || {
        let mut times = Vec::with_capacity(most);
        for round in 1.. {
            if !wait_for(&theirs.called, round) {
                break;
            }
            let woken = now();
            if times.len() == most {
                break;
            }
            times.push(woken.nanos_since(Instant::from_nanos(theirs.at.load(Ordering::Acquire))));
            announce(&theirs.answered, round);
        }
        times
    })?;
    let caller = threads::on(from, threads::PRIORITY, move || {
        let never = Futex::new(0);
        // From now on: it may take long until a busy machine has made this thread.
        let end = now() + time;
        for round in 1.. {
            if now() >= end {
                break;
            }
            // The other thread goes to sleep meanwhile.
            never.wait(0, now() + Duration::from_micros(100));
            ours.at.store(now().as_nanos(), Ordering::Release);
            announce(&ours.called, round);
            if !wait_for(&ours.answered, round) {
                break;
            }
        }
        // The last call has a number of its own.
        announce(&ours.called, LAST);
    })?;
    let how = format!(
        "{} to {}",
        threads::how(caller.obtained()),
        threads::how(callee.obtained())
    );
    threads::end(caller)?;
    let times = threads::end(callee)?;
    Ok(Measured { times, how })
}

/// A round that never comes.
const LAST: u32 = u32::MAX;

fn announce(futex: &Futex, round: u32) {
    futex.word().store(round, Ordering::Release);
    futex.wake_one();
}

/// Whether the round came; not if the other has ended, or does not answer.
fn wait_for(futex: &Futex, round: u32) -> bool {
    let deadline = now() + PATIENCE;
    loop {
        let current = futex.word().load(Ordering::Acquire);
        if current == round || current == LAST {
            return current == round;
        }
        if now() >= deadline {
            return false;
        }
        futex.wait(current, deadline);
    }
}

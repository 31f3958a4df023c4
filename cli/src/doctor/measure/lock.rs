//! How long a thread waits for the priority-inheriting lock that another one keeps taking.

use super::{Measured, Measurement, WAKE_UP, threads};
use crate::doctor::finding::Finding;
use luna::now;
use luna_platform::futex::Futex;
use luna_platform::lock::PiLock;
use std::hint::black_box;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// From one try to the next.
const PERIOD: Duration = Duration::from_micros(200);
/// How long the other holds it: longer than any section of LUNA's.
const HELD: Duration = Duration::from_micros(2);
/// For the other to begin.
const PATIENCE: Duration = Duration::from_secs(5);

/// `each` long: the low thread on the first core, the high one on the last.
pub(super) fn under_contention(cores: &[usize], each: Duration) -> Finding {
    let measurement = Measurement {
        name: "lock-contended".to_owned(),
        why: "channels, barriers and locks are guarded by this lock: what a high thread waits for a low one inside it",
        advice: "see the findings above on preemption and hypervisor",
        bounds: WAKE_UP,
    };
    let low = cores.first().copied().unwrap_or(0);
    let high = cores.last().copied().unwrap_or(0);
    measurement.finding(measure(low, high, each))
}

fn measure(low: usize, high: usize, time: Duration) -> Result<Measured, String> {
    let lock = Arc::new(PiLock::new(0_u64));
    let begun = Arc::new(Futex::new(FREE));
    let most = usize::try_from(time.as_nanos() / PERIOD.as_nanos())
        .unwrap_or(0)
        .max(20);

    // The high one first: on a machine of one core, a thread below the low one would not get to run
    // to make it.
    let (ours, is_held) = (lock.clone(), begun.clone());
    let taker = threads::on(high, threads::PRIORITY, move || {
        let times = take(&ours, &is_held, most, time);
        is_held.word().store(OVER, Ordering::Relaxed);
        times
    })?;
    let holder = threads::on(low, threads::PRIORITY - 1, move || {
        // Unless the other thread has stopped meanwhile.
        if begun
            .word()
            .compare_exchange(FREE, HOLDS, Ordering::Relaxed, Ordering::Relaxed)
            .is_ok()
        {
            begun.wake_one();
        }
        while begun.word().load(Ordering::Relaxed) == HOLDS {
            let mut count = lock.lock();
            let until = now() + HELD;
            while now() < until {
                *count = black_box(*count + 1);
            }
        }
    });
    let how = threads::how(taker.obtained());
    let times = threads::end(taker)?;
    threads::end(holder?)?;
    Ok(Measured { times, how })
}

/// The values of the word between the two.
const FREE: u32 = 0;
const HOLDS: u32 = 1;
const OVER: u32 = 2;

/// Takes the lock every period, once another thread holds it.
fn take(lock: &PiLock<u64>, is_held: &Futex, most: usize, time: Duration) -> Vec<u64> {
    let mut times = Vec::with_capacity(most);
    let give_up = now() + PATIENCE;
    while is_held.word().load(Ordering::Relaxed) == FREE && now() < give_up {
        is_held.wait(FREE, give_up);
    }
    let never = Futex::new(0);
    let end = now() + time;
    let mut slot = now() + PERIOD;
    while times.len() < most && now() < end {
        never.wait(0, slot);
        let before = now();
        let held = lock.lock();
        times.push(now().nanos_since(before));
        drop(held);
        slot = (slot + PERIOD).max(now());
    }
    times
}

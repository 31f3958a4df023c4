//! How late a thread wakes that sleeps until an instant, on each core.

use super::{Measured, Measurement, WAKE_UP, threads};
use crate::doctor::finding::Finding;
use luna::{Instant, now};
use luna_platform::futex::Futex;
use std::time::Duration;

/// As a fast control loop.
const PERIOD: Duration = Duration::from_millis(1);
/// The fewest wake-ups that allow a verdict.
const FEWEST: u32 = 20;
const WHY: &str = "what every loop on this core is late by, before it has done anything";

/// After this long no other core is begun.
const PATIENCE: Duration = Duration::from_secs(5);

/// One core after the other, twice `each` in all, but at least 20 wake-ups for a core. The last
/// cores of a very large or very busy machine are left out, and the finding says so.
pub(super) fn on_each(cores: &[usize], each: Duration) -> Vec<Finding> {
    let all = 2 * each;
    let share = all / u32::try_from(cores.len().max(1)).unwrap_or(u32::MAX);
    let wake_ups = u32::try_from(share.as_millis() / PERIOD.as_millis())
        .unwrap_or(u32::MAX)
        .max(FEWEST);
    let end = now() + PATIENCE;
    let (mut findings, mut left_out) = (Vec::new(), Vec::new());
    for &core in cores {
        if now() >= end {
            left_out.push(core);
            continue;
        }
        let measurement = Measurement {
            name: format!("wake-up-core-{core}"),
            why: WHY,
            advice: "see the findings above on preemption, isolated-cores, idle-states, governor and hypervisor, then measure for \
                     longer: `luna jitter`",
            bounds: WAKE_UP,
        };
        findings.push(measurement.finding(on(core, wake_ups)));
    }
    findings.extend(super::left_out("wake-up-other-cores", WHY, &left_out));
    findings
}

fn on(core: usize, wake_ups: u32) -> Result<Measured, String> {
    let thread = threads::on(core, threads::PRIORITY, move || {
        let never = Futex::new(0);
        let mut times = Vec::with_capacity(wake_ups as usize);
        let mut slot = now() + PERIOD;
        for _ in 0..wake_ups {
            times.push(sleep_until(&never, slot));
            // The next slot to come, so that a hole of the machine is counted once.
            let woken = now();
            while slot <= woken {
                slot += PERIOD;
            }
        }
        times
    })?;
    let how = threads::how(thread.obtained());
    let times = threads::end(thread)?;
    Ok(Measured { times, how })
}

/// Sleeps, and gives how many nanoseconds it was too long.
fn sleep_until(never: &Futex, slot: Instant) -> u64 {
    loop {
        never.wait(0, slot);
        let woken = now();
        // A wait may end without a cause.
        if woken >= slot {
            return woken.nanos_since(slot);
        }
    }
}

//! Two loops of one period that alternate exactly, half a period apart on different executors, and
//! a third that follows an external clock: a bus with beats that drift by 50 ppm. Checks its own
//! results.

use luna::prelude::*;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(2);
const CYCLES: u64 = 50;

/// Collects the slots of its cycles, by number.
async fn slots(
    name: &str,
    phase: Duration,
    cycles: Sender<(u64, luna::Instant)>,
) -> luna::Result<()> {
    let mut tick = luna::periodic(name, PERIOD)?
        .phase(phase)?
        .guard_spin(PERIOD / 32)?; // awake before each slot, so the wake-up adds almost no lateness
    for _ in 0..CYCLES {
        let cycle = tick.next().await;
        cycles.send((cycle.number, cycle.deadline)).await?;
    }
    Ok(())
}

/// A bus that beats each `PERIOD` by its own clock, which is 50 ppm faster than ours.
struct Bus {
    first: luna::Instant,
}

impl Bus {
    const BEAT: Duration = Duration::from_nanos(2_000_000 - 100);

    /// How far the beat that is nearest to `now` is from it, in nanoseconds.
    fn offset(&self, now: luna::Instant) -> i64 {
        let beat = Self::BEAT.as_nanos() as i64;
        let since = (now - self.first).as_nanos() as i64 % beat;
        if since > beat / 2 {
            beat - since
        } else {
            -since
        }
    }
}

/// Follows the bus: corrects its phase in each cycle. Collects the offsets.
async fn follow(bus: Bus) -> luna::Result<Vec<(u64, i64)>> {
    let mut tick = luna::periodic("follower", PERIOD)?;
    let mut offsets = Vec::with_capacity(120);
    for _ in 0..120 {
        let cycle = tick.next().await;
        let offset = bus.offset(cycle.deadline);
        tick.correct(offset); // at most 1 % of the period is corrected
        offsets.push((cycle.missed, offset));
    }
    Ok(offsets)
}

fn main() -> luna::Result<()> {
    let mut system = System::new("phases");
    let sensing = system.executor("sensing").build()?;
    let acting = system.executor("acting").build()?;
    let (sensed, all_sensed) = luna::buffered(Buffer::fifo(CYCLES as usize));
    let (acted, all_acted) = luna::buffered(Buffer::fifo(CYCLES as usize));
    sensing
        .process("sense")
        .spawn(slots("sense", Duration::ZERO, sensed))?;
    acting
        .process("act")
        .spawn(slots("act", PERIOD / 2, acted))?;
    let (followed, offsets) = luna::buffered(Buffer::fifo(1));
    sensing.process("follower").priority(20).spawn(async move {
        let bus = Bus {
            first: luna::now() + PERIOD / 3,
        };
        followed.send(follow(bus).await?).await?;
        Ok(())
    })?;
    let report = system.run()?;

    // The slots of one number are half a period apart, to the nanosecond.
    let start = |phase: Duration, (number, slot): (u64, luna::Instant)| {
        slot.as_nanos() - (phase.as_nanos() + u128::from(number) * PERIOD.as_nanos()) as u64
    };
    let mut starts = Vec::new();
    while let Ok(slot) = all_sensed.try_recv() {
        starts.push(start(Duration::ZERO, slot));
    }
    while let Ok(slot) = all_acted.try_recv() {
        starts.push(start(PERIOD / 2, slot));
    }
    assert_eq!(starts.len() as u64, 2 * CYCLES);
    assert!(starts.iter().all(|one| *one == starts[0]));
    println!(
        "{} slots on one grid, half of them {:?} behind",
        starts.len(),
        PERIOD / 2
    );

    // From one cycle to the next at most 1 % of the period is corrected, and the bus drifts on: by
    // 100 ns for each slot, also for missed ones.
    let offsets = offsets.try_recv()?;
    for pair in offsets.windows(2) {
        let [(_, before), (missed, after)] = [pair[0], pair[1]];
        let left = (before.abs() - 20_000).max(0);
        let drift = 100 * (1 + missed as i64);
        assert!(
            after.abs() <= left + drift + 1,
            "{before} ns off, then {after}"
        );
    }
    println!(
        "the follower began {} ns off the bus, and ended {} ns off",
        offsets[0].1, offsets[119].1
    );
    for name in ["sense", "act", "follower"] {
        let one = &report.loops[name];
        assert_eq!(one.cycles + one.missed, one.slots_elapsed);
        println!(
            "{name:<9} late by {:?} (p50), missed {}",
            one.wake_latency.percentile(50.0),
            one.missed
        );
    }
    Ok(())
}

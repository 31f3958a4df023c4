//! Periodic loops: absolute slots, their numbers, and what is counted of them.

use crate::common::{Random, SpawnOk, burn_until, watchdog};
use futures_lite::future;
use luna::prelude::*;
use luna::report::LoopReport;
use luna::time::{Cycle, Overrun};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

/// Runs a process with loops; gives what it returned and the loops' reports.
fn run_loops<T: Send + 'static>(
    body: impl AsyncFnOnce() -> luna::Result<T> + Send + 'static,
) -> (T, std::collections::BTreeMap<String, LoopReport>) {
    let (sender, receiver) = luna::buffered(Buffer::fifo(1));
    let mut system = super::system("loops");
    let executor = system.executor("control").build().unwrap();
    executor.process("looping").spawn_ok(move || async move {
        let value = body().await?;
        sender.try_send(value)?;
        Ok(())
    });
    let loops = system.run().unwrap().loops;
    (receiver.try_recv().unwrap(), loops)
}

#[test]
fn smoke() {
    let _watch = watchdog();
    let (cycles, loops) = run_loops(async || {
        let before = luna::now();
        let mut tick = luna::periodic("loop", PERIOD)?;
        let after = luna::now();
        assert_eq!(tick.period(), PERIOD);
        assert!(format!("{tick:?}").contains("loop"));
        let mut cycles = Vec::new();
        for _ in 0..5 {
            cycles.push(tick.next().await);
            assert!(luna::now() >= cycles.last().unwrap().deadline);
        }
        // The first slot is a period after the loop was made, or the next slot of the grid common
        // to loops of this period.
        let origin = origin(&cycles[0], PERIOD);
        assert!(origin <= after);
        match super::timers() {
            luna::time::Timers::Manager => assert!(before < origin + PERIOD),
            _ => assert!(before <= origin),
        }
        Ok(cycles)
    });
    assert_eq!(loops["loop"].cycles, 5);
    assert!(cycles[0].number >= 1);
}

/// The slot 0 of the grid that the cycle belongs to.
fn origin(cycle: &Cycle, period: Duration) -> luna::Instant {
    cycle.deadline - period * u32::try_from(cycle.number).unwrap()
}

#[test]
fn a_late_cycle_does_not_shift_the_next_ones() {
    let _watch = watchdog();
    for policy in [Overrun::SkipToGrid, Overrun::CatchUp] {
        let (cycles, _) = run_loops(async move || {
            let mut random = Random::seeded();
            let mut tick = luna::periodic("loop", PERIOD)?.overrun(policy);
            let mut cycles = Vec::new();
            for _ in 0..40 {
                cycles.push(tick.next().await);
                burn_until(luna::now() + PERIOD * random.below(25) as u32 / 10);
            }
            Ok(cycles)
        });
        for cycle in &cycles {
            assert_eq!(
                origin(cycle, PERIOD),
                origin(&cycles[0], PERIOD),
                "{policy:?}: {cycle:?}"
            );
        }
    }
}

#[test]
fn each_cycle_counts_from_its_own_slot() {
    let _watch = watchdog();
    run_loops(async || {
        let mut random = Random::seeded();
        let mut tick = luna::periodic("loop", PERIOD)?;
        let mut number = 0;
        for _ in 0..40 {
            let before = luna::now();
            let cycle = tick.next().await;
            let after = luna::now();
            // It began in its slot, during this call.
            let began = cycle.deadline + cycle.lateness;
            assert!(before <= began && began <= after, "{cycle:?}");
            assert!(cycle.lateness < PERIOD, "{cycle:?}");
            assert_eq!(cycle.number, number + cycle.missed + 1);
            number = cycle.number;
            burn_until(luna::now() + PERIOD * random.below(30) as u32 / 10);
        }
        Ok(())
    });
}

#[test]
fn a_slot_whose_wait_was_dropped_is_there_for_the_next_call() {
    let _watch = watchdog();
    let (served, loops) = run_loops(async || {
        let period = Duration::from_millis(20);
        // When catching up, each slot is served. So a missing number is a slot that a dropped wait
        // consumed.
        let mut tick = luna::periodic("loop", period)?.overrun(Overrun::CatchUp);
        let mut served = 0;
        let mut serve = |cycle: Option<Cycle>| {
            if let Some(cycle) = cycle {
                served += 1;
                assert_eq!(cycle.number, served);
            }
            served
        };
        while serve(None) < 4 {
            // The wait begins and is dropped: at once, and after a while.
            for _ in 0..3 {
                serve(future::poll_once(tick.next()).await);
            }
            let timeout = async {
                luna::after(period / 10).await;
                None
            };
            serve(future::or(async { Some(tick.next().await) }, timeout).await);
        }
        Ok(served)
    });
    let report = &loops["loop"];
    assert_eq!(report.cycles, served);
    assert_eq!(report.cycle_time.count(), served - 1);
    // A cycle ends when the first of its waits begins, however many there are. The last wait may
    // have been polled too.
    assert!(
        (served - 1..=served).contains(&report.run_time.count()),
        "{report:?}"
    );
}

#[test]
fn what_is_counted() {
    let _watch = watchdog();
    const BUSY: Duration = Duration::from_micros(200);
    let (cycles, loops) = run_loops(async || {
        let mut tick = luna::periodic("loop", PERIOD)?;
        let mut cycles = Vec::new();
        for _ in 0..30 {
            cycles.push(tick.next().await);
            burn_until(luna::now() + BUSY);
        }
        Ok(cycles)
    });
    let report = &loops["loop"];
    assert_eq!((report.period, report.cycles), (PERIOD, 30));
    assert_eq!(report.wake_latency.count(), 30);
    assert_eq!(report.cycle_time.count(), 29);
    // The last cycle never asked for another one.
    assert_eq!(report.run_time.count(), 29);
    assert!(
        report.run_time.min() >= BUSY && report.cycle_time.min() >= BUSY,
        "{report:?}"
    );
    assert!(report.wake_latency.max() >= cycles.iter().map(|cycle| cycle.lateness).max().unwrap());
    assert!(report.wake_latency.min() <= report.wake_latency.percentile(50.0));
    // The mean distance of cycles is that of the first and the last one, measured from where each
    // really began.
    let began = |cycle: &Cycle| cycle.deadline + cycle.lateness;
    let all = began(&cycles[29]) - began(&cycles[0]);
    assert!(
        (report.cycle_time.mean_nanos() * 29.0 - all.as_nanos() as f64).abs() < 1e3,
        "{report:?}"
    );
    for times in [&report.wake_latency, &report.cycle_time, &report.run_time] {
        assert_eq!(
            times.bins().map(|(_, count)| count).sum::<u64>(),
            times.count()
        );
    }
}

#[test]
fn a_loop_that_never_ran() {
    let _watch = watchdog();
    let ((), loops) = run_loops(async || {
        drop(luna::periodic("unused", PERIOD)?);
        // No slot comes before the wait is given up.
        let mut tick = luna::periodic("given up", Duration::from_secs(100))?;
        future::poll_once(tick.next()).await;
        Ok(())
    });
    for name in ["unused", "given up"] {
        let report = &loops[name];
        assert_eq!(
            (
                report.cycles,
                report.missed,
                report.slots_elapsed,
                report.overruns
            ),
            (0, 0, 0, 0),
            "{name}"
        );
        assert_eq!(
            report.wake_latency.count() + report.cycle_time.count() + report.run_time.count(),
            0,
            "{name}"
        );
        assert_eq!(report.wake_latency.max(), Duration::ZERO);
    }
}

#[test]
fn several_loops_in_one_process() {
    let _watch = watchdog();
    let ((), loops) = run_loops(async || {
        let run = |name: &'static str, period, cycles| async move {
            let mut tick = luna::periodic(name, period)?;
            for _ in 0..cycles {
                tick.next().await;
            }
            Ok(())
        };
        par!(
            run("fast", PERIOD, 30),
            run("slow", PERIOD * 3, 10),
            run("odd", PERIOD * 7 / 5, 20)
        )
        .await?;
        Ok(())
    });
    let cycles: Vec<_> = loops
        .iter()
        .map(|(name, report)| (name.as_str(), report.cycles))
        .collect();
    assert_eq!(cycles, [("fast", 30), ("odd", 20), ("slow", 10)]);
    for report in loops.values() {
        assert_eq!(
            report.cycles + report.missed,
            report.slots_elapsed,
            "{report:?}"
        );
    }
}

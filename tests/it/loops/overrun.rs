//! Loops that are late: no policy ever loses or doubles a slot without counting it.

use crate::common::{Random, SpawnOk, burn_until, in_process, watchdog};
use luna::prelude::*;
use luna::report::LoopReport;
use luna::time::{Cycle, Overrun};
use luna::{Error, Instant};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

/// How many whole periods lie between two instants.
fn slots_between(from: Instant, until: Instant) -> u64 {
    ((until - from).as_nanos() / PERIOD.as_nanos()) as u64
}

/// When the cycle began.
fn began(cycle: &Cycle) -> Instant {
    cycle.deadline + cycle.lateness
}

/// Slot 0 of the cycle's grid.
fn origin(cycle: &Cycle) -> Instant {
    cycle.deadline - PERIOD * u32::try_from(cycle.number).unwrap()
}

/// A loop with cycles of random length, from nothing to about three periods.
fn burn_at_random(policy: Overrun, cycles: usize) -> (Vec<Cycle>, LoopReport) {
    let (sender, receiver) = luna::buffered(Buffer::fifo(1));
    let mut random = Random::seeded();
    let mut system = super::system("late");
    let executor = system.executor("control").build().unwrap();
    executor.process("loop").spawn_ok(async move {
        let mut tick = luna::periodic("loop", PERIOD)?.overrun(policy);
        let mut seen = Vec::with_capacity(cycles);
        for _ in 0..cycles {
            seen.push(tick.next().await);
            // One in three keeps its time, so that the loop can catch up.
            if random.below(3) > 0 {
                burn_until(luna::now() + PERIOD * random.below(280) as u32 / 100);
            }
        }
        drop(tick);
        sender.try_send(seen)?;
        Ok(())
    });
    let report = system.run().unwrap().loops.remove("loop").unwrap();
    (receiver.try_recv().unwrap(), report)
}

/// What holds on every grid.
fn check_identity(report: &LoopReport, cycles: &[Cycle], elapsed: u64) {
    assert_eq!(report.cycles, cycles.len() as u64);
    assert_eq!(
        report.cycles + report.missed,
        report.slots_elapsed,
        "{report:?}"
    );
    assert_eq!(report.slots_elapsed, elapsed, "the clock says so");
    assert_eq!(report.wake_latency.count(), report.cycles);
    assert_eq!(report.cycle_time.count(), report.cycles - 1);
    assert_eq!(report.run_time.count(), report.cycles - 1);
}

#[test]
fn skipping_keeps_to_the_grid_and_serves_a_slot_while_it_lasts() {
    let _watch = watchdog();
    let (cycles, report) = burn_at_random(Overrun::SkipToGrid, 150);
    let grid = origin(&cycles[0]);
    check_identity(
        &report,
        &cycles,
        slots_between(grid, began(cycles.last().unwrap())),
    );
    assert_eq!(
        report.missed,
        cycles.iter().map(|cycle| cycle.missed).sum::<u64>(),
        "each is reported once"
    );
    let mut last = 0;
    for cycle in &cycles {
        assert_eq!(origin(cycle), grid);
        assert!(
            cycle.number > last,
            "two slots are never served for one, nor one twice: {cycle:?}"
        );
        assert_eq!(cycle.missed, cycle.number - last - 1);
        // It is the slot that lasts: so one that is late by less than a period is never lost.
        assert_eq!(cycle.number, slots_between(grid, began(cycle)), "{cycle:?}");
        last = cycle.number;
    }
    assert!(
        report.overruns > 0 && report.missed > 0,
        "the burning was long enough to matter"
    );
}

#[test]
fn catching_up_serves_every_slot() {
    let _watch = watchdog();
    let (cycles, report) = burn_at_random(Overrun::CatchUp, 150);
    let grid = origin(&cycles[0]);
    check_identity(
        &report,
        &cycles,
        slots_between(grid, began(cycles.last().unwrap())),
    );
    for (expected, cycle) in (1..).zip(&cycles) {
        assert_eq!((cycle.number, cycle.missed), (expected, 0), "{cycle:?}");
        assert_eq!(origin(cycle), grid);
    }
    assert!(report.overruns > 0);
}

#[test]
fn rephasing_begins_new_grids() {
    let _watch = watchdog();
    let (cycles, report) = burn_at_random(Overrun::Rephase, 150);
    let mut elapsed = 0;
    let mut grids = 1;
    for pair in cycles.windows(2) {
        let (before, after) = (origin(&pair[0]), origin(&pair[1]));
        if before != after || pair[1].number <= pair[0].number {
            // Slot 1 of the new grid is when the late loop asked.
            let asked = after + PERIOD;
            assert!(
                asked >= pair[0].deadline + PERIOD,
                "only a late cycle leaves the grid: {pair:?}"
            );
            // The old one ends with the slot before that, which is served late instead of missed.
            elapsed += slots_between(before, after);
            grids += 1;
        } else {
            assert_eq!(pair[1].number, pair[0].number + pair[1].missed + 1);
        }
    }
    let last = cycles.last().unwrap();
    elapsed += slots_between(origin(last), began(last));
    check_identity(&report, &cycles, elapsed);
    assert_eq!(report.overruns, grids - 1, "each late cycle begins one");
    assert_eq!(
        report.missed,
        cycles.iter().map(|cycle| cycle.missed).sum::<u64>(),
        "each is reported once"
    );
    assert!(grids > 1);
}

/// Runs a loop that computes in each cycle for as long as `burn` says, until it is ended. Returns
/// the outcome and the cycles begun.
fn run_limited(limit: u32, burn: fn(usize) -> Duration, most: usize) -> (luna::Result<()>, usize) {
    let mut begun = 0;
    let outcome = luna::run(async {
        let mut tick = luna::periodic("hog", PERIOD)?.limit(limit);
        while begun < most {
            let cycle = tick.next().await;
            let busy = burn(begun);
            begun += 1;
            // From the slot on, so that a late wake-up makes no difference.
            burn_until(cycle.deadline + busy);
        }
        Ok(())
    });
    (outcome, begun)
}

#[test]
fn at_the_limit_the_process_ends_with_an_error() {
    let _watch = watchdog();
    for limit in [1, 2, 5] {
        let (outcome, begun) = run_limited(limit, |_| PERIOD * 2, 100);
        assert_eq!(
            outcome,
            Err(Error::Overrun {
                name: "hog".to_owned(),
                consecutive: limit
            })
        );
        assert_eq!(begun, limit as usize);
        let text = outcome.unwrap_err().to_string();
        assert!(
            text.contains("`hog`") && text.contains(&format!("{limit} cycles in a row")),
            "{text}"
        );
    }
    let (outcome, begun) = run_limited(0, |_| PERIOD * 2, 100);
    assert_eq!((outcome.is_err(), begun), (true, 1), "0 counts as 1");
}

#[test]
fn a_cycle_in_time_begins_the_count_anew() {
    let _watch = watchdog();
    let late_but_for_each_third = |number: usize| {
        if number % 3 == 2 {
            Duration::ZERO
        } else {
            PERIOD * 2
        }
    };
    // A cycle that should be in time is late if the machine is busy with something else, so there
    // are several attempts.
    let outcomes: Vec<_> = (0..50)
        .map(|_| run_limited(3, late_but_for_each_third, 9))
        .collect();
    assert!(
        outcomes
            .iter()
            .any(|(outcome, begun)| outcome.is_ok() && *begun == 9),
        "{outcomes:?}"
    );
}

/// The loop `limited` of the process `hog` was late once.
#[track_caller]
fn ends_by_overrun_of_hog(system: &System) {
    let overrun = Error::Overrun {
        name: "limited".to_owned(),
        consecutive: 1,
    };
    let expected = in_process("hog", overrun);
    assert_eq!(system.run().unwrap_err(), expected);
}

#[test]
fn the_limit_ends_its_own_process_and_no_other() {
    let _watch = watchdog();
    let mut system = super::system("limited");
    let executor = system.executor("control").build().unwrap();
    let limited = || async {
        let mut tick = luna::periodic("limited", PERIOD)?.limit(1);
        burn_until(tick.next().await.deadline + PERIOD * 2);
        tick.next().await;
        panic!("the body goes on")
    };
    executor.process("hog").priority(20).spawn_ok(limited);
    let modest = async {
        let mut tick = luna::periodic("modest", PERIOD)?;
        for _ in 0..10 {
            tick.next().await;
        }
        Ok(())
    };
    let modest = executor.process("modest").spawn_ok(modest);
    ends_by_overrun_of_hog(&system);
    assert_eq!(
        system.process_handle(modest).unwrap().exit(),
        Some(luna::Exit::Completed)
    );
}

#[test]
fn the_limit_ends_a_process_that_would_end_at_the_same_poll() {
    let _watch = watchdog();
    let mut system = super::system("limited");
    let executor = system.executor("control").build().unwrap();
    // The other branch is ready and drops the wait that does not return. The failure must reach
    // this process all the same, and not the next one that its executor polls.
    let hog = async {
        let mut tick = luna::periodic("limited", PERIOD)?.limit(1);
        burn_until(tick.next().await.deadline + PERIOD * 2);
        futures_lite::future::or(async { while tick.next().await.number > 0 {} }, async {}).await;
        Ok(())
    };
    executor.process("hog").priority(20).spawn_ok(hog);
    let next = async {
        luna::yield_now().await;
        luna::after(PERIOD).await;
        Ok(())
    };
    executor.process("next").spawn_ok(next);
    ends_by_overrun_of_hog(&system);
}

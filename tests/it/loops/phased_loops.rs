//! Phases on a common grid, guards, and trims: which slot is where, exactly; and what is refused.

use crate::common::{PLACEMENTS, Random, SpawnOk, burn_until, setup_error, watchdog};
use luna::error::SetupError;
use luna::prelude::*;
use luna::time::{Cycle, Overrun};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(2);

fn nanos(from: luna::Instant, to: luna::Instant) -> i128 {
    i128::from(to.as_nanos()) - i128::from(from.as_nanos())
}

#[test]
fn loops_of_one_period_share_a_grid_wherever_they_run() {
    let _watch = watchdog();
    let phases = [
        Duration::ZERO,
        PERIOD / 2,
        PERIOD / 3,
        PERIOD - Duration::from_nanos(1),
    ];
    let cycles: Arc<Mutex<Vec<(Duration, Cycle)>>> = Arc::default();
    let mut system = super::system("phases");
    for place in PLACEMENTS {
        for phase in phases {
            let name = format!("{place:?} {phase:?}");
            let cycles = cycles.clone();
            let process = place.process(&mut system, &name.clone(), &name.clone());
            process.spawn_ok(async move {
                let mut random = Random::seeded();
                // Each begins some time after the others, and is late now and then.
                burn_until(luna::now() + PERIOD * random.below(20) as u32 / 10);
                let mut tick = luna::periodic(&name, PERIOD)?.phase(phase)?;
                for _ in 0..10 {
                    let cycle = tick.next().await;
                    cycles.lock().unwrap().push((phase, cycle));
                    burn_until(luna::now() + PERIOD * random.below(12) as u32 / 10);
                }
                Ok(())
            });
        }
    }
    let report = system.run().unwrap();
    let cycles = cycles.lock().unwrap();
    assert_eq!(cycles.len(), PLACEMENTS.len() * phases.len() * 10);
    let start = |(phase, cycle): &(Duration, Cycle)| {
        cycle.deadline.as_nanos()
            - phase.as_nanos() as u64
            - cycle.number * PERIOD.as_nanos() as u64
    };
    for one in cycles.iter() {
        assert!(one.1.number >= 1);
        assert_eq!(
            start(one),
            start(&cycles[0]),
            "{one:?} beside {:?}",
            cycles[0]
        );
    }
    for (name, one) in &report.loops {
        assert_eq!(one.cycles + one.missed, one.slots_elapsed, "{name}");
    }
}

#[test]
fn one_that_joins_late_misses_nothing_and_counts_as_the_others() {
    let _watch = watchdog();
    let (send, receive) = luna::buffered(Buffer::fifo(2));
    let mut system = super::system("late");
    let executor = system.executor("one").build().unwrap();
    let on = executor.clone();
    executor.process("early").spawn_ok(async move {
        let mut tick = luna::periodic("early", PERIOD)?.phase(PERIOD / 4)?;
        let mut cycle = tick.next().await;
        while cycle.number < 10 {
            cycle = tick.next().await;
        }
        let late = send.clone();
        on.process("late").spawn(async move {
            let mut tick = luna::periodic("late", PERIOD)?.phase(PERIOD / 4)?;
            late.send(tick.next().await).await?;
            Ok(())
        })?;
        send.send(cycle).await?;
        Ok(())
    });
    let report = system.run().unwrap();
    let mut cycles = [receive.try_recv().unwrap(), receive.try_recv().unwrap()];
    cycles.sort_by_key(|cycle| cycle.number);
    let [early, late] = cycles;
    assert!(late.number > early.number);
    assert_eq!(
        nanos(early.deadline, late.deadline),
        i128::from(late.number - early.number) * PERIOD.as_nanos() as i128
    );
    let one = &report.loops["late"];
    assert_eq!(
        (one.cycles, one.missed, one.slots_elapsed),
        (1, late.missed, 1 + late.missed)
    );
}

#[test]
fn phases_and_guards_that_do_not_fit_are_refused() {
    let _watch = watchdog();
    luna::run(async {
        let mut number = 0;
        let mut make = |period| {
            number += 1;
            luna::periodic(format!("loop {number}"), period)
        };
        for phase in [PERIOD, PERIOD * 2, Duration::MAX] {
            let error = setup_error(
                make(PERIOD)?.phase(phase),
                &["phase", "2ms", "below the period"],
            );
            assert!(matches!(
                error,
                SetupError::PhaseTooLong { period: PERIOD, .. }
            ));
        }
        drop(make(PERIOD)?.phase(PERIOD - Duration::from_nanos(1))?);
        for guard in [Duration::from_nanos(125_001), PERIOD, Duration::MAX] {
            let error = setup_error(
                make(PERIOD)?.guard_spin(guard),
                &["guard", "125µs", "sixteenth"],
            );
            assert!(matches!(error, SetupError::GuardTooLong { .. }));
        }
        drop(make(PERIOD)?.guard_spin(PERIOD / 16)?);
        drop(make(PERIOD)?.guard_spin(Duration::ZERO)?);
        let short = make(Duration::from_nanos(15))?;
        setup_error(short.guard_spin(Duration::from_nanos(1)), &["at most 0ns"]);
        Ok(())
    })
    .unwrap();
}

#[test]
fn a_guarded_loop_has_the_slots_that_it_would_have_without() {
    let _watch = watchdog();
    for place in PLACEMENTS {
        for overrun in [Overrun::SkipToGrid, Overrun::CatchUp] {
            let mut system = super::system("guard");
            place
                .process(&mut system, "one", "one")
                .spawn_ok(async move {
                    let mut random = Random::seeded();
                    let mut tick = luna::periodic("one", PERIOD)?
                        .overrun(overrun)
                        .guard_spin(PERIOD / 16)?;
                    let mut before = None;
                    for _ in 0..30 {
                        let cycle = tick.next().await;
                        // Never before its slot, however early the loop was awake.
                        assert!(luna::now() >= cycle.deadline);
                        let (slot, number) = before.unwrap_or((cycle.deadline, cycle.number));
                        let periods = i128::from(cycle.number - number);
                        assert_eq!(
                            nanos(slot, cycle.deadline),
                            periods * PERIOD.as_nanos() as i128
                        );
                        before = Some((cycle.deadline, cycle.number));
                        burn_until(luna::now() + PERIOD * random.below(15) as u32 / 10);
                    }
                    Ok(())
                });
            let report = system.run().unwrap();
            let one = &report.loops["one"];
            assert_eq!(one.cycles, 30);
            assert_eq!(one.cycles + one.missed, one.slots_elapsed);
        }
    }
}

#[test]
fn a_trim_moves_the_following_slots_by_what_it_says_and_loses_none() {
    let _watch = watchdog();
    for overrun in [Overrun::SkipToGrid, Overrun::CatchUp] {
        let mut system = super::system("trim");
        let executor = system.executor("one").build().unwrap();
        executor.process("one").spawn_ok(async move {
            let mut random = Random::seeded();
            let most = PERIOD.as_nanos() as i128 / 100;
            let mut tick = luna::periodic("one", PERIOD)?
                .overrun(overrun)
                .phase(PERIOD / 2)?;
            // Before the first slot, too.
            let mut moved = i128::from(tick.correct(777));
            assert_eq!(moved, 777);
            let first = tick.next().await;
            let mut before = first;
            let mut phase = moved;
            for _ in 0..60 {
                moved = 0;
                for _ in 0..random.below(3) {
                    let asked = random.below(60_000) as i64 - 30_000;
                    moved += i128::from(tick.correct(asked));
                    assert!(moved.abs() <= most);
                }
                phase += moved;
                burn_until(luna::now() + PERIOD * random.below(25) as u32 / 10);
                let cycle = tick.next().await;
                let periods = i128::from(cycle.number - before.number);
                assert_eq!(
                    nanos(before.deadline, cycle.deadline),
                    periods * PERIOD.as_nanos() as i128 + moved
                );
                assert_eq!(cycle.number, before.number + cycle.missed + 1);
                before = cycle;
            }
            // One that was moved after the last cycle changes nothing of what has been.
            tick.correct(i64::MIN);
            let all = i128::from(before.number - first.number) * PERIOD.as_nanos() as i128;
            assert_eq!(nanos(first.deadline, before.deadline), all + phase - 777);
            Ok(())
        });
        let report = system.run().unwrap();
        let one = &report.loops["one"];
        assert_eq!(one.cycles, 61);
        assert_eq!(one.cycles + one.missed, one.slots_elapsed);
    }
}

#[test]
fn a_phase_given_in_mid_run_begins_with_the_next_wait() {
    let _watch = watchdog();
    let mut system = super::system("changes");
    let executor = system.executor("one").build().unwrap();
    executor.process("one").spawn_ok(async {
        let mut tick = luna::periodic("one", PERIOD)?;
        for _ in 0..3 {
            tick.next().await;
        }
        let mut other = luna::periodic("other", PERIOD)?.phase(Duration::ZERO)?;
        let other = other.next().await;
        let mut tick = tick.phase(PERIOD / 2)?;
        for _ in 0..3 {
            let cycle = tick.next().await;
            let apart = i128::from(cycle.number) - i128::from(other.number);
            assert_eq!(
                2 * nanos(other.deadline, cycle.deadline),
                (2 * apart + 1) * PERIOD.as_nanos() as i128
            );
        }
        Ok(())
    });
    let report = system.run().unwrap();
    let one = &report.loops["one"];
    assert_eq!(one.cycles, 6);
    assert_eq!(one.cycles + one.missed, one.slots_elapsed);
}

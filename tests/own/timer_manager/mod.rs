//! The timer manager: which loops share a tick, callbacks, and the report of both sides.

mod callbacks;
use crate::common;
mod machine;

use common::{COMPLETE, PLACEMENTS, Program, SpawnOk, burn_until, setup_error, skip};
use luna::error::SetupError;
use luna::prelude::*;
use luna::report::{CallbackReport, TimersReport};
use luna::time::Timers;
use luna::{End, Error, Instant, Report};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);

fn managed(name: &str) -> System {
    let mut system = System::new(name);
    system.timers(Timers::Manager);
    system
}

fn timers(report: &Report) -> &TimersReport {
    report.timers.as_ref().expect("there is a manager")
}

fn callback<'a>(report: &'a Report, name: &str) -> &'a CallbackReport {
    let mut callbacks = timers(report).callbacks.iter();
    callbacks.find(|one| one.name == name).unwrap()
}

/// Keeps the system running until `done`.
fn runs_until(system: &mut System, done: impl Fn() -> bool + Send + 'static) {
    let main = system.executor("until").build().unwrap();
    main.process("until").spawn_ok(async move {
        while !done() {
            luna::after(Duration::from_micros(500)).await;
        }
        Ok(())
    });
}

#[test]
fn a_system_without_a_manager_says_so() {
    own_process!();
    let mut system = System::new("plain");
    setup_error(system.timer_manager(), &["`plain`", "Timers::Manager"]);
    system.timers(Timers::Manager).timers(Timers::Executor);
    assert!(system.timer_manager().is_err());
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(async { Ok(()) });
    assert!(system.run().unwrap().timers.is_none());
}

#[test]
fn periods_that_divide_are_in_phase_wherever_they_run() {
    own_process!();
    let slots: Arc<Mutex<BTreeMap<String, Vec<Instant>>>> = Arc::default();
    let mut system = managed("in phase");
    for place in PLACEMENTS {
        for millis in [10, 1, 2] {
            let name = format!("{place:?} {millis}");
            let slots = slots.clone();
            let process = place.process(&mut system, &name.clone(), &name.clone());
            process.spawn_ok(async move {
                let mut tick = luna::periodic(&name, PERIOD * millis)?;
                for _ in 0..60 / millis {
                    let slot = tick.next().await.deadline;
                    slots
                        .lock()
                        .unwrap()
                        .entry(name.clone())
                        .or_default()
                        .push(slot);
                }
                Ok(())
            });
        }
    }
    let report = system.run().unwrap();
    let slots = slots.lock().unwrap();
    let first = slots["Executor 1"][0].as_nanos();
    for (name, slots) in slots.iter() {
        for slot in slots {
            let apart = first.abs_diff(slot.as_nanos());
            assert!(apart.is_multiple_of(1_000_000), "{name}: {apart} ns");
        }
    }
    let timers = timers(&report);
    // A cycle that is late does not wait for its slot.
    assert!(
        timers.woken > 0 && timers.latest > Duration::ZERO,
        "{timers}"
    );
    for one in report.loops.values() {
        assert_eq!(one.cycles + one.missed, one.slots_elapsed);
    }
}

#[test]
fn any_number_of_periods_is_served() {
    own_process!();
    let mut system = managed("many periods");
    let main = system.executor("main").build().unwrap();
    const LOOPS: u64 = 20;
    system.max_loops(LOOPS as usize);
    // No loop goes on before all wait.
    let everybody = Barrier::new(LOOPS as usize);
    for number in 0..LOOPS {
        let everybody = everybody.clone();
        let name = format!("{number}");
        main.process(name.clone()).spawn_ok(async move {
            // None is a multiple of another.
            let period = Duration::from_nanos(2_000_003 + number);
            let mut tick = luna::periodic(&name, period)?;
            let mut before = tick.next().await;
            for round in 0..5 {
                if round == 2 {
                    everybody.sync().await;
                }
                let cycle = tick.next().await;
                assert!(luna::now() >= cycle.deadline);
                assert_eq!(cycle.number, before.number + cycle.missed + 1);
                before = cycle;
            }
            Ok(())
        });
    }
    let report = system.run().unwrap();
    let timers = timers(&report);
    assert!(timers.woken >= LOOPS, "{timers}");
    for number in 0..LOOPS {
        assert_eq!(report.loops[&*number.to_string()].cycles, 6, "{report}");
    }
}

#[test]
fn periods_that_are_none_and_room_that_is_full() {
    own_process!();
    let mut system = managed("refused");
    system.max_timers(2);
    let manager = system.timer_manager().unwrap();
    let one = manager.callback("one", |_| ()).unwrap();
    setup_error(one.every(Duration::ZERO, Duration::ZERO), &["period of 0"]);
    setup_error(one.every(Duration::MAX, Duration::ZERO), &["292 years"]);
    setup_error(one.every(PERIOD, PERIOD), &["below the period"]);
    assert!(!one.is_set());
    // The longest is far off, and nothing else.
    one.every(Duration::from_nanos(i64::MAX as u64), Duration::ZERO)
        .unwrap();
    one.at(Instant::NEVER);
    let main = system.executor("main").build().unwrap();
    main.process("adds").spawn_ok(async move {
        let _one = one;
        luna::realtime::off_path(|| {
            let second = manager.callback("second", |_| ())?;
            let third = setup_error(
                manager.callback("third", |_| ()),
                &["`third`", "max_timers"],
            );
            assert!(matches!(third, SetupError::TooManyTimers { most: 2, .. }));
            drop(second);
            let third = manager.callback("third", |_| ())?;
            third.after(Duration::ZERO);
            Ok(())
        })
    });
    let report = system.run().unwrap();
    let names: Vec<&str> = timers(&report)
        .callbacks
        .iter()
        .map(|one| &*one.name)
        .collect();
    assert_eq!(names, ["one", "third"]);
    assert_eq!(timers(&report).earlier_callbacks, 1);
}

#[test]
fn one_that_waits_for_a_tick_or_for_another_is_not_deadlocked() {
    own_process!();
    let (_kept, input) = luna::channel::<()>();
    let mut system = managed("races");
    system.strict();
    for place in PLACEMENTS {
        let input = input.clone();
        let name = format!("{place:?}");
        place
            .process(&mut system, &name.clone(), &name.clone())
            .spawn_ok(async move {
                // Long enough for a check that finds all loops asleep.
                let mut tick = luna::periodic(&name, PERIOD * 50)?;
                for _ in 0..5 {
                    let ticked = async {
                        tick.next().await;
                    };
                    futures_lite::future::or(ticked, async {
                        let _ = input.recv().await;
                    })
                    .await;
                }
                Ok(())
            });
    }
    let report = system.run().unwrap();
    assert!(report.deadlock.is_none());
}

#[test]
fn a_deadlock_beside_the_manager_is_found() {
    own_process!();
    let (_kept, input) = luna::channel::<()>();
    let mut system = managed("stuck");
    system.strict();
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(async move {
        let mut tick = luna::periodic("one", PERIOD)?;
        tick.next().await;
        let _kept = _kept;
        Ok(input.recv().await?)
    });
    let outcome = system.run();
    assert!(matches!(outcome, Err(Error::Deadlock(_))), "{outcome:?}");
}

/// The child's parts.
#[test]
fn part() {
    let Some(part) = common::part() else { return };
    let mut system = System::new("suspended");
    if part == "manager" {
        system.timers(Timers::Manager);
        let callback = system
            .timer_manager()
            .unwrap()
            .callback("beside", |_| ())
            .unwrap();
        callback.every(PERIOD, Duration::ZERO).unwrap();
        // Its handle lives as long as the program.
        std::mem::forget(callback);
    }
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn_ok(async {
        let mut tick = luna::periodic("one", PERIOD)?;
        let mut before = tick.next().await;
        luna::realtime::off_path(|| println!("ready"));
        let mut after = 0;
        while after < 20 {
            let cycle = tick.next().await;
            let slots = (cycle.deadline - before.deadline).as_nanos() / PERIOD.as_nanos();
            assert_eq!(u128::from(cycle.missed) + 1, slots);
            after += u32::from(after > 0 || cycle.missed > 500);
            before = cycle;
        }
        Ok(())
    });
    let report = system.run().unwrap();
    let one = &report.loops["one"];
    assert_eq!(one.cycles + one.missed, one.slots_elapsed);
    assert!(one.missed > 500);
    if part == "manager" {
        let timers = timers(&report);
        // One wake-up for all of them.
        assert!(timers.latest > PERIOD * 500, "{timers}");
        assert!(
            timers.woken <= one.cycles,
            "{timers}, {} cycles",
            one.cycles
        );
        let beside = callback(&report, "beside");
        assert!(beside.missed > 500, "{beside:?}");
    }
    println!("missed: {}", one.missed);
}

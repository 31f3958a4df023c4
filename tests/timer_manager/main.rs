//! The timer manager: who shares a tick, callbacks, and what the report says of both sides.

mod common;

use common::{COMPLETE, PLACES, Program, burn_until, setup_error, skip, watchdog};
use luna::prelude::*;
use luna::{CallbackReport, End, Error, Instant, Report, SetupError, Timers, TimersReport};
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
    main.process("until")
        .spawn(async move {
            while !done() {
                luna::after(Duration::from_micros(500)).await;
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn a_system_without_a_manager_says_so() {
    let _watch = watchdog();
    let mut system = System::new("plain");
    setup_error(system.timer_manager(), &["`plain`", "Timers::Manager"]);
    system.timers(Timers::Manager).timers(Timers::Executor);
    assert!(system.timer_manager().is_err());
    let main = system.executor("main").build().unwrap();
    main.process("one").spawn(async { Ok(()) }).unwrap();
    assert!(system.run().unwrap().timers.is_none());
}

#[test]
fn periods_that_divide_are_in_phase_on_one_timer_wherever_they_run() {
    let _watch = watchdog();
    let slots: Arc<Mutex<BTreeMap<String, Vec<Instant>>>> = Arc::default();
    let mut system = managed("in phase");
    for place in PLACES {
        for millis in [10, 1, 2] {
            let name = format!("{place:?} {millis}");
            let slots = slots.clone();
            let process = place.process(&mut system, &name.clone(), &name.clone());
            process
                .spawn(async move {
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
                })
                .unwrap();
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
    assert_eq!(timers.loops_without_timer, 0);
    assert!(timers.woken > 0);
    let fine = timers
        .ticks
        .iter()
        .find(|one| one.period == PERIOD)
        .unwrap();
    assert!(fine.ticks >= 60 && fine.missed < fine.ticks, "{fine:?}");
    assert!(
        timers.ticks.iter().all(|one| one.period <= PERIOD * 10),
        "{timers}"
    );
    for one in report.loops.values() {
        assert_eq!(one.cycles + one.missed, one.slots_elapsed);
    }
}

#[test]
fn loops_that_find_no_timer_run_all_the_same() {
    let _watch = watchdog();
    let mut system = managed("many periods");
    let main = system.executor("main").build().unwrap();
    const LOOPS: u64 = 20;
    // Nobody goes before all have a place, or none.
    let everybody = Barrier::new(LOOPS as usize);
    for number in 0..LOOPS {
        let everybody = everybody.clone();
        let name = format!("{number}");
        main.process(&name.clone())
            .spawn(async move {
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
            })
            .unwrap();
    }
    let report = system.run().unwrap();
    let timers = timers(&report);
    assert_eq!(timers.ticks.len(), 16);
    assert!(timers.loops_without_timer >= LOOPS - 16, "{timers}");
}

#[test]
fn a_callback_is_called_once_a_slot_and_never_before() {
    let _watch = watchdog();
    let mut system = managed("callback");
    let seen = Arc::new(Mutex::new(Vec::with_capacity(1_000)));
    let (calls, noted) = (Arc::new(AtomicU64::new(0)), seen.clone());
    let counted = calls.clone();
    let phase = PERIOD / 4;
    let manager = system.timer_manager().unwrap();
    let one = manager
        .callback("one", move |firing| {
            assert!(luna::now() >= firing.deadline);
            noted.lock().unwrap().push(firing);
            counted.fetch_add(1, Ordering::Release);
        })
        .unwrap();
    one.every(PERIOD, phase).unwrap();
    runs_until(&mut system, move || calls.load(Ordering::Acquire) >= 20);
    let report = system.run().unwrap();
    let seen = seen.lock().unwrap();
    assert!(seen[0].number >= 1);
    for pair in seen.windows(2) {
        assert_eq!(pair[1].number, pair[0].number + 1 + pair[1].missed);
        let slots = (pair[1].number - pair[0].number) as u32;
        assert_eq!(pair[1].deadline - pair[0].deadline, PERIOD * slots);
        assert!(pair[1].lateness < PERIOD);
    }
    let counted = callback(&report, "one");
    assert_eq!(counted.calls, seen.len() as u64);
    assert_eq!(
        counted.missed,
        seen.iter().map(|one| one.missed).sum::<u64>()
    );
    assert!(
        !one.is_set() && !one.cancel(),
        "it has ended with its system"
    );
    one.every(PERIOD, phase).unwrap();
    assert!(!one.is_set());
}

#[test]
fn one_shots_fire_once_each_and_one_can_set_itself_anew() {
    let _watch = watchdog();
    let mut system = managed("once");
    let manager = system.timer_manager().unwrap();
    let order = Arc::new(Mutex::new(Vec::with_capacity(16)));
    let once = |name: &'static str| {
        let order = order.clone();
        let called = move |_| order.lock().unwrap().push(name);
        manager.callback(name, called).unwrap()
    };
    let [first, second, third, never] = ["first", "second", "third", "never"].map(once);
    let now = luna::now();
    third.at(now + PERIOD * 3);
    first.at(now); // has passed when the system starts
    second.at(now + PERIOD * 2);
    never.at(now + PERIOD * 2);
    assert!(never.cancel());
    let again: Arc<Mutex<Option<luna::TimerCallback>>> = Arc::default();
    let (own, left) = (again.clone(), Arc::new(AtomicU64::new(3)));
    let done = left.clone();
    let chain = manager
        .callback("chain", move |_| {
            if left.fetch_sub(1, Ordering::Release) > 1 {
                own.lock().unwrap().as_ref().unwrap().after(Duration::ZERO);
            }
        })
        .unwrap();
    chain.at(now + PERIOD * 4);
    *again.lock().unwrap() = Some(chain);
    runs_until(&mut system, move || done.load(Ordering::Acquire) == 0);
    let report = system.run().unwrap();
    assert_eq!(*order.lock().unwrap(), ["first", "second", "third"]);
    assert_eq!(callback(&report, "never").calls, 0);
    assert_eq!(callback(&report, "chain").calls, 3);
    assert!(!first.is_set());
}

/// Callbacks that set themselves, or each other, to an instant long ago in every call.
#[test]
fn who_is_always_late_starves_nobody() {
    let _watch = watchdog();
    const PAST: Instant = Instant::from_nanos(1);
    // Of each: whom it sets.
    for partners in [&[0][..], &[1, 0]] {
        let mut system = managed("late");
        let manager = system.timer_manager().unwrap();
        let handles: Arc<Mutex<Vec<luna::TimerCallback>>> = Arc::default();
        for (number, &partner) in partners.iter().enumerate() {
            let sets = handles.clone();
            let late = manager
                .callback(&format!("late {number}"), move |firing| {
                    assert_eq!(firing.deadline, PAST);
                    sets.lock().unwrap()[partner].at(PAST);
                })
                .unwrap();
            handles.lock().unwrap().push(late);
        }
        handles.lock().unwrap()[0].at(PAST);
        let (calls, counted) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
        let (slots, once) = (calls.clone(), counted.clone());
        let patient = manager
            .callback("patient", move |_| {
                calls.fetch_add(1, Ordering::Relaxed);
            })
            .unwrap();
        patient.every(PERIOD, Duration::ZERO).unwrap();
        let single = manager
            .callback("single", move |_| {
                counted.fetch_add(1, Ordering::Relaxed);
            })
            .unwrap();
        single.at(Instant::now() + PERIOD * 2);
        runs_until(&mut system, move || {
            slots.load(Ordering::Relaxed) >= 5 && once.load(Ordering::Relaxed) == 1
        });
        let began = Instant::now();
        let report = system.run().unwrap();
        // Each rests for at least 100 µs between two calls.
        let most = (Instant::now() - began).as_micros() / 100 + 1;
        for number in 0..partners.len() {
            let late = callback(&report, &format!("late {number}"));
            assert!(late.calls > 1 && u128::from(late.calls) <= most, "{late:?}");
        }
    }
}

#[test]
fn removal_while_it_is_called() {
    let _watch = watchdog();
    for drops in [false, true] {
        let mut system = managed("removal");
        let manager = system.timer_manager().unwrap();
        let (called, removed) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicBool::new(false)),
        );
        let (is_called, is_removed) = (called.clone(), removed.clone());
        let gone = Arc::new(());
        let kept = gone.clone();
        let one = manager
            .callback("one", move |_| {
                let _kept = &kept;
                is_called.store(true, Ordering::Release);
                // In the middle of the call it is taken back.
                while !is_removed.load(Ordering::Acquire) {
                    std::hint::spin_loop();
                }
            })
            .unwrap();
        let process = system.thread("remover").process("remover");
        process
            .spawn(async move {
                one.every(PERIOD, Duration::ZERO)?;
                while !called.load(Ordering::Acquire) {
                    luna::after(Duration::from_micros(100)).await;
                }
                let kept = if drops {
                    luna::off_path(|| drop(one));
                    None
                } else {
                    assert!(one.cancel());
                    assert!(!one.cancel());
                    Some(one)
                };
                removed.store(true, Ordering::Release);
                // Other ticks come, and are none of its own.
                let mut tick = luna::periodic("beside", PERIOD)?;
                for _ in 0..5 {
                    tick.next().await;
                }
                assert!(kept.is_none_or(|one| !one.is_set()));
                Ok(())
            })
            .unwrap();
        let report = system.run().unwrap();
        assert_eq!(callback(&report, "one").calls, 1);
        assert_eq!(Arc::strong_count(&gone), 1, "its function is dropped");
    }
}

#[test]
fn a_panic_in_a_callback_is_an_emergency() {
    let _watch = watchdog();
    let mut system = managed("panics");
    let (brought, safe) = (
        Arc::new(AtomicBool::new(false)),
        Arc::new(AtomicU64::new(0)),
    );
    let (calls, after) = (safe.clone(), brought.clone());
    system.on_emergency("stop", move || after.store(true, Ordering::SeqCst));
    let manager = system.timer_manager().unwrap();
    let other = manager.callback("other", |_| ()).unwrap();
    let bad = manager
        .callback("bad", move |_| {
            calls.fetch_add(1, Ordering::SeqCst);
            panic!("on purpose");
        })
        .unwrap();
    bad.every(PERIOD, Duration::ZERO).unwrap();
    other.every(PERIOD, Duration::ZERO).unwrap();
    let main = system.executor("main").build().unwrap();
    main.process("patient")
        .spawn(async { std::future::pending().await })
        .unwrap();
    let error = system.run().unwrap_err();
    let expected = Error::Callback {
        name: "bad".to_owned(),
        message: "on purpose".to_owned(),
    };
    assert_eq!(error, expected);
    assert!(
        error
            .to_string()
            .contains("timer callback `bad` panicked: on purpose")
    );
    assert!(brought.load(Ordering::SeqCst));
    let report = system.report().unwrap();
    assert_eq!(report.end, End::Panic);
    assert!(callback(&report, "bad").panicked);
    assert_eq!(
        (safe.load(Ordering::SeqCst), callback(&report, "bad").calls),
        (1, 1)
    );
}

#[test]
fn periods_that_are_none_and_room_that_is_full() {
    let _watch = watchdog();
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
    main.process("adds")
        .spawn(async move {
            let _one = one;
            luna::off_path(|| {
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
        })
        .unwrap();
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
fn a_callback_that_takes_too_long_is_counted() {
    let _watch = watchdog();
    let mut system = managed("long");
    let manager = system.timer_manager().unwrap();
    let slow = manager
        .callback("slow", |_| {
            burn_until(luna::now() + Duration::from_micros(300))
        })
        .unwrap();
    slow.after(Duration::ZERO);
    let own = Arc::new(slow);
    let seen = own.clone();
    runs_until(&mut system, move || !seen.is_set());
    let report = system.run().unwrap();
    let slow = callback(&report, "slow");
    assert_eq!((slow.calls, slow.too_long), (1, 1));
    assert!(slow.longest >= Duration::from_micros(300));
    assert!(
        report.to_string().contains("callback `slow`: 1 calls"),
        "{report}"
    );
}

#[test]
fn who_waits_for_a_tick_or_for_another_is_not_deadlocked() {
    let _watch = watchdog();
    let (_kept, input) = luna::channel::<()>();
    let mut system = managed("races");
    system.strict();
    for place in PLACES {
        let input = input.clone();
        let name = format!("{place:?}");
        place
            .process(&mut system, &name.clone(), &name.clone())
            .spawn(async move {
                // Long enough for a look that finds everybody asleep.
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
            })
            .unwrap();
    }
    let report = system.run().unwrap();
    assert!(report.deadlock.is_none());
}

#[test]
fn a_deadlock_beside_the_manager_is_found() {
    let _watch = watchdog();
    let (_kept, input) = luna::channel::<()>();
    let mut system = managed("stuck");
    system.strict();
    let main = system.executor("main").build().unwrap();
    main.process("one")
        .spawn(async move {
            let mut tick = luna::periodic("one", PERIOD)?;
            tick.next().await;
            let _kept = _kept;
            Ok(input.recv().await?)
        })
        .unwrap();
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
    main.process("one")
        .spawn(async {
            let mut tick = luna::periodic("one", PERIOD)?;
            let mut before = tick.next().await;
            luna::off_path(|| println!("ready"));
            let mut after = 0;
            while after < 20 {
                let cycle = tick.next().await;
                let slots = (cycle.deadline - before.deadline).as_nanos() / PERIOD.as_nanos();
                assert_eq!(u128::from(cycle.missed) + 1, slots);
                after += u32::from(after > 0 || cycle.missed > 500);
                before = cycle;
            }
            Ok(())
        })
        .unwrap();
    let report = system.run().unwrap();
    let one = &report.loops["one"];
    assert_eq!(one.cycles + one.missed, one.slots_elapsed);
    assert!(one.missed > 500);
    if part == "manager" {
        let timers = timers(&report);
        let tick = timers
            .ticks
            .iter()
            .find(|one| one.period == PERIOD)
            .unwrap();
        // One read, and one wake-up, for all of them.
        assert!(tick.missed > 500 && tick.latest > PERIOD * 500, "{timers}");
        assert!(
            timers.woken <= one.cycles,
            "{timers}, {} cycles",
            one.cycles
        );
        let beside = callback(&report, "beside");
        assert!(beside.missed > 500, "{beside:?}");
        assert!(beside.calls + beside.missed <= tick.ticks + 1, "{timers}");
    }
    println!("missed: {}", one.missed);
}

#[test]
#[cfg(unix)]
fn a_suspended_program_misses_slots_counts_them_and_goes_on() {
    use nix::sys::signal::Signal;
    let _watch = watchdog();
    if common::has_no_signals() {
        return;
    }
    for part in ["executor", "manager"] {
        let mut program = Program::start(part);
        program.wait_for("ready");
        program.signal(Signal::SIGSTOP as i32);
        // What is tested: how long it is suspended, no point at which it is.
        std::thread::sleep(Duration::from_secs(1));
        program.signal(Signal::SIGCONT as i32);
        let ended = program.end();
        assert!(ended.status.success(), "{part}: {ended:?}");
    }
}

/// A jump of the clock on the wall moves no timer: all are on the monotonic one, as the kernel says.
#[test]
#[cfg(target_os = "linux")]
fn the_timers_are_on_the_monotonic_clock() {
    let _watch = watchdog();
    if !COMPLETE {
        skip("the portable layer has no timers that are files");
        return;
    }
    let mut system = managed("clocks");
    let main = system.executor("main").build().unwrap();
    main.process("one")
        .spawn(async {
            let mut tick = luna::periodic("one", PERIOD)?;
            tick.next().await;
            let timers = luna::off_path(|| {
                let mut clocks = Vec::new();
                for file in std::fs::read_dir("/proc/self/fdinfo").unwrap().flatten() {
                    let text = std::fs::read_to_string(file.path()).unwrap_or_default();
                    clocks.extend(
                        text.lines()
                            .filter(|line| line.starts_with("clockid:"))
                            .map(str::to_owned),
                    );
                }
                clocks
            });
            assert!(timers.len() >= 17, "{timers:?}");
            assert!(
                timers.iter().all(|clock| clock.trim_end().ends_with('1')),
                "{timers:?}"
            );
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

#[test]
fn its_thread_has_a_priority_of_its_own_where_the_system_has_any() {
    let _watch = watchdog();
    let has_real_time = common::has_real_time();
    for asks in [false, true] {
        let mut system = managed("ranks");
        let mut main = system.executor("main");
        if asks {
            main = main.policy(Policy::fifo(10));
        }
        let main = main.build().unwrap();
        main.process("one")
            .spawn(async {
                let mut tick = luna::periodic("one", PERIOD)?;
                for _ in 0..3 {
                    tick.next().await;
                }
                Ok(())
            })
            .unwrap();
        let report = system.run().unwrap();
        let expected = match asks && has_real_time {
            true => Policy::fifo(98),
            false => Policy::Other,
        };
        assert_eq!(timers(&report).policy, expected);
        let is_missing = report
            .shortfalls
            .iter()
            .any(|one| one.to_string().contains("fifo:98"));
        assert_eq!(is_missing, asks && !has_real_time);
    }
}

/// Threads of one priority on one core run in the order in which they are woken: so that is seen.
#[test]
fn the_loops_of_a_tick_are_woken_in_order_of_priority() {
    let _watch = watchdog();
    if !COMPLETE || !common::has_real_time() {
        skip("no real-time policies here");
        return;
    }
    const CYCLES: u64 = 100;
    let mut system = managed("order");
    system.timer_core(0);
    let begun: Arc<Mutex<BTreeMap<u64, Vec<u8>>>> = Arc::default();
    // Who comes first at first is the least urgent.
    for level in [3, 10, 20, 30] {
        let begun = begun.clone();
        let name: &'static str = format!("level {level}").leak();
        let thread = system.thread(name).core(0).policy(Policy::fifo(10));
        thread
            .process(name)
            .priority(level)
            .spawn(async move {
                let mut tick = luna::periodic(name, PERIOD)?.phase(Duration::ZERO)?;
                for _ in 0..CYCLES {
                    let number = tick.next().await.number;
                    begun.lock().unwrap().entry(number).or_default().push(level);
                }
                Ok(())
            })
            .unwrap();
    }
    system.run().unwrap();
    let begun = begun.lock().unwrap();
    let whole = || begun.values().filter(|levels| levels.len() == 4);
    let in_order = whole().filter(|levels| **levels == [30, 20, 10, 3]).count();
    // Where the machine stood still for more than a period, loops go on by themselves.
    assert!(2 * in_order > whole().count(), "{begun:?}");
    assert!(whole().count() > 0, "{begun:?}");
}

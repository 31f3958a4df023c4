//! Which process runs next, and that it is the same as on the real clock.

use super::{HOUR, MS, Notes, simulated, watchdog};
use crate::common::SpawnOk;
use luna::prelude::*;
use luna::system::ClockKind;
use luna::{End, Error, Instant};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

#[test]
fn an_hour_takes_moments_and_is_exact() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let body = async {
        let start = luna::now();
        let mut tick = luna::periodic("hourly", MS * 10)?;
        for number in 1..=360_000 {
            let cycle = tick.next().await;
            assert_eq!((cycle.number, cycle.missed), (number, 0));
            assert_eq!(
                (cycle.lateness, cycle.deadline),
                (Duration::ZERO, luna::now())
            );
        }
        assert_eq!(luna::now() - start, HOUR);
        Ok(())
    };
    main.process("loop").spawn_ok(body);
    let report = system.run().unwrap();
    assert_eq!(
        (report.end, report.clock),
        (End::Completed, ClockKind::Virtual)
    );
    assert_eq!(report.elapsed, HOUR);
    let one = &report.loops["hourly"];
    assert_eq!((one.cycles, one.missed, one.late), (360_000, 0, 0));
    assert_eq!(one.wake_latency.max(), Duration::ZERO);
    let text = report.to_string();
    assert!(text.contains("on a virtual clock, which took"), "{text}");
    assert!(
        text.contains("on the thread of the virtual clock"),
        "{text}"
    );
}

/// A small network with times, on whichever clock: what it gives must be the same.
fn network(is_virtual: bool) -> Vec<u64> {
    let mut system = System::new("network");
    if is_virtual {
        system.virtual_clock();
    }
    let one = system.executor("one").build().unwrap();
    let two = system.executor("two").build().unwrap();
    let (samples, sampled) = luna::channel::<u64>();
    let (squares, squared) = luna::buffered::<u64>(luna::Buffer::fifo(3));
    let results = Arc::new(Mutex::new(Vec::new()));
    let sample = async move {
        let mut tick = luna::periodic("sample", MS * 5)?;
        for _ in 0..10 {
            let cycle = tick.next().await;
            samples.send(cycle.number + cycle.missed).await?;
        }
        Ok(())
    };
    one.process("sample").spawn_ok(sample);
    let square = async move {
        while let Ok(value) = sampled.recv().await {
            squares.send(value * value).await?;
        }
        Ok(())
    };
    two.process("square").spawn_ok(square);
    let kept = results.clone();
    let collect = async move {
        let mut timeouts = 0;
        loop {
            luna::alt! {
                value = squared.recv() => match value {
                    Ok(value) => kept.lock().unwrap().push(value),
                    Err(_) => break,
                },
                _ = luna::after(HOUR) => timeouts += 1,
            }
        }
        assert_eq!(timeouts, 0);
        Ok(())
    };
    system.thread("three").process("collect").spawn_ok(collect);
    system.run().unwrap();
    std::mem::take(&mut results.lock().unwrap())
}

#[test]
fn a_network_gives_what_it_gives_on_the_real_clock() {
    let _alive = watchdog();
    let squares: Vec<u64> = (1..=10).map(|value| value * value).collect();
    assert_eq!(network(true), squares);
    // On a slow machine slots are missed; the sums of the two are the slots that have passed.
    let real = network(false);
    assert_eq!(real.len(), squares.len());
}

#[test]
fn loops_of_one_instant_run_by_priority_then_as_they_came() {
    let _alive = watchdog();
    let (system, main) = simulated();
    let notes = Notes::default();
    for (name, priority, period) in [
        ("low", 3, 6),
        ("first", 9, 3),
        ("second", 9, 2),
        ("high", 30, 6),
    ] {
        let notes = notes.clone();
        let body = async move {
            let mut tick = luna::periodic(name, MS * period)?.phase(Duration::ZERO)?;
            for _ in 0..12 / period {
                tick.next().await;
                notes.note(name);
            }
            Ok(())
        };
        main.process(name).priority(priority).spawn_ok(body);
    }
    system.run().unwrap();
    let at_6 = ["high", "first", "second", "low"];
    let seen: Vec<String> = notes
        .take()
        .into_iter()
        .filter(|(micros, _)| *micros == 6000)
        .map(|(_, name)| name)
        .collect();
    assert_eq!(seen, at_6);
}

#[test]
fn executors_take_their_turns_by_policy_then_as_described() {
    let _alive = watchdog();
    let mut system = System::new("many");
    system.virtual_clock();
    let notes = Notes::default();
    let policies = [("b", 0), ("c", 0), ("low", 5), ("a", 90)];
    let executors = policies.map(|(name, priority)| {
        let policy = if priority == 0 {
            Policy::Other
        } else {
            Policy::fifo(priority)
        };
        (name, system.executor(name).policy(policy).build().unwrap())
    });
    for (name, executor) in &executors {
        let (name, notes) = (*name, notes.clone());
        let body = async move {
            for _ in 0..3 {
                luna::after(MS).await;
                notes.note(name);
            }
            Ok(())
        };
        executor.process(name).spawn_ok(body);
    }
    let own = notes.clone();
    let on_thread = async move {
        luna::after(MS).await;
        own.note("thread");
        Ok(())
    };
    let thread = system.thread("thread").policy(Policy::fifo(20));
    thread.process("thread").spawn_ok(on_thread);
    let report = system.run().unwrap();
    let later = ["a", "low", "b", "c"];
    let expected = [&["a", "thread", "low", "b", "c"][..], &later, &later].concat();
    assert_eq!(notes.names(), expected);
    assert_eq!(report.threads.len(), 5);
    assert_eq!(report.all_shortfalls().count(), 0);
}

#[test]
fn a_higher_executor_runs_as_soon_as_it_is_woken() {
    let _alive = watchdog();
    let mut system = System::new("preempting");
    system.virtual_clock();
    let low = system.executor("low").build().unwrap();
    let high = system
        .executor("high")
        .policy(Policy::fifo(50))
        .build()
        .unwrap();
    let notes = Notes::default();
    let (sender, receiver) = luna::buffered::<u32>(luna::Buffer::fifo(10));
    let own = notes.clone();
    let wakes = async move {
        for value in 0..3 {
            sender.send(value).await?;
            own.note(format!("sent {value}"));
            luna::yield_now().await;
        }
        Ok(())
    };
    low.process("low").spawn_ok(wakes);
    let own = notes.clone();
    let woken = async move {
        while let Ok(value) = receiver.recv().await {
            own.note(format!("received {value}"));
        }
        Ok(())
    };
    high.process("high").spawn_ok(woken);
    system.run().unwrap();
    let order = [
        "sent 0",
        "received 0",
        "sent 1",
        "received 1",
        "sent 2",
        "received 2",
    ];
    assert_eq!(notes.names(), order);
}

#[test]
fn one_that_yields_for_ever_keeps_no_other_executor_from_running() {
    let _alive = watchdog();
    let mut system = System::new("restless");
    system.virtual_clock();
    let high = system
        .executor("high")
        .policy(Policy::fifo(50))
        .build()
        .unwrap();
    let low = system.executor("low").build().unwrap();
    let done = Arc::new(AtomicBool::new(false));
    let seen = done.clone();
    let restless = async move {
        while !seen.load(Relaxed) {
            luna::yield_now().await;
        }
        Ok(())
    };
    high.process("restless").spawn_ok(restless);
    let patient = async move {
        for _ in 0..1000 {
            luna::yield_now().await;
        }
        done.store(true, Relaxed);
        Ok(())
    };
    low.process("patient").spawn_ok(patient);
    assert_eq!(system.run().unwrap().elapsed, Duration::ZERO);
}

#[test]
fn a_livelock_ends_with_an_error_and_all_are_dropped() {
    let _alive = watchdog();
    let (mut system, main) = simulated();
    system.most_turns_at_an_instant(5000);
    let kept = Arc::new(());
    let held = kept.clone();
    let waits = async move {
        let _held = held;
        luna::after(HOUR).await;
        Ok(())
    };
    main.process("waits").spawn_ok(waits);
    let spins = async {
        luna::after(MS).await;
        loop {
            luna::yield_now().await;
        }
    };
    main.process("spins").spawn_ok(spins);
    let error = system.run().unwrap_err();
    let at = Instant::from_nanos(1_001_000_000);
    assert_eq!(
        error,
        Error::Livelock {
            process: "spins".into(),
            turns: 5000,
            at
        }
    );
    assert_eq!(system.report().unwrap().end, End::Livelock);
    assert_eq!(Arc::strong_count(&kept), 1);
}

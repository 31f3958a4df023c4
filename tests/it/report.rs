//! The report: threads as obtained, processes with their exits, a row for each loop.

use crate::common;
use common::{COMPLETE, PLACEMENTS, SpawnOk, has_real_time, in_process, skip, watchdog};
use luna::prelude::*;
use luna::{End, Error, Exit, Report};
use std::time::Duration;

/// Two executors, a thread, and some loops.
fn run_some() -> Report {
    let mut system = System::new("reported");
    let control = system
        .executor("control")
        .core(0)
        .policy(Policy::fifo(40))
        .build()
        .unwrap();
    let logging = system.executor("logging").build().unwrap();
    for (process, name, period, cycles) in [
        ("fast process", "fast", Duration::from_millis(1), 20),
        ("slow process", "slow", Duration::from_micros(2500), 5),
    ] {
        let on = if name == "fast" { &control } else { &logging };
        on.process(process).timed().spawn_ok(async move {
            let mut tick = luna::periodic(name, period)?;
            for _ in 0..cycles {
                tick.next().await;
            }
            Ok(())
        });
    }
    let console = system.thread("console").policy(Policy::round_robin(30));
    console.process("operator").spawn_ok(async { Ok(()) });
    system.run().unwrap()
}

#[test]
fn who_was_there() {
    let _watch = watchdog();
    let report = run_some();
    assert_eq!(
        (report.system.as_str(), report.end),
        ("reported", End::Completed)
    );
    // The last slot of the longer loop was waited for.
    assert!(
        report.elapsed >= Duration::from_millis(12),
        "{:?}",
        report.elapsed
    );
    let processes: Vec<_> = report
        .processes
        .iter()
        .map(|process| process.name.as_str())
        .collect();
    assert_eq!(processes, ["fast process", "slow process", "operator"]);
    // A thread is called as it was, not as its process.
    let threads: Vec<_> = report
        .threads
        .iter()
        .map(|thread| (thread.name.as_str(), thread.abandoned))
        .collect();
    assert_eq!(
        threads,
        [("control", false), ("logging", false), ("console", false)]
    );
    let loops: Vec<_> = report
        .loops
        .iter()
        .map(|(name, one)| (name.as_str(), one.cycles))
        .collect();
    assert_eq!(loops, [("fast", 20), ("slow", 5)]);
}

#[test]
fn the_table_has_a_row_for_each() {
    let _watch = watchdog();
    let report = run_some();
    let text = report.to_string();
    let rows: Vec<Vec<&str>> = text
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert_eq!(
        rows[0][..4],
        ["system", "`reported`:", "completed", "after"]
    );
    for (name, policy) in [
        ("control", report.threads[0].policy),
        ("console", report.threads[2].policy),
    ] {
        let row = rows.iter().find(|row| row.first() == Some(&name)).unwrap();
        assert_eq!(row[1], format!("{policy},"), "{text}");
    }
    for (name, period, one) in [
        ("fast", "1000.0", &report.loops["fast"]),
        ("slow", "2500.0", &report.loops["slow"]),
    ] {
        let of_it: Vec<_> = rows
            .iter()
            .filter(|row| row.first() == Some(&name))
            .collect();
        assert_eq!(of_it.len(), 1, "{text}");
        let numbers = [
            period.to_owned(),
            one.cycles.to_string(),
            one.missed.to_string(),
            "|".to_owned(),
        ];
        assert_eq!(of_it[0][1..5], numbers, "{text}");
        let maximum = format!("{:.1}", one.wake_latency.max().as_nanos() as f64 / 1e3);
        assert_eq!(of_it[0][8], maximum, "{text}");
        assert_eq!(of_it[0].len(), 13, "{text}");
    }
    // The report also lists what was not given.
    let missing = text
        .lines()
        .filter(|line| line.trim_start().starts_with("best effort:"))
        .count();
    assert_eq!(missing, report.all_shortfalls().count(), "{text}");
}

#[test]
fn a_report_without_loops_has_no_table() {
    let _watch = watchdog();
    let mut system = System::new("plain");
    let executor = system.executor("main").build().unwrap();
    executor.process("one").spawn_ok(async { Ok(()) });
    let text = system.run().unwrap().to_string();
    assert_eq!(text.lines().count(), 2, "{text}");
    assert!(!text.contains('|') && !text.contains("latency"), "{text}");
}

#[test]
fn policies_and_cores_as_obtained() {
    let _watch = watchdog();
    let report = run_some();
    let real_time = has_real_time();
    let expected = |policy| if real_time { policy } else { Policy::Other };
    let policies: Vec<_> = report.threads.iter().map(|thread| thread.policy).collect();
    assert_eq!(
        policies,
        [
            expected(Policy::fifo(40)),
            Policy::Other,
            expected(Policy::round_robin(30))
        ]
    );
    // Whatever was asked for was obtained or is missing, never both.
    for (thread, asked_core) in report.threads.iter().zip([Some(0), None, None]) {
        let missing: Vec<_> = thread
            .shortfalls
            .iter()
            .map(|shortfall| shortfall.what())
            .collect();
        assert_eq!(
            missing.iter().any(|what| what == "core 0"),
            thread.core != asked_core,
            "{thread:?}"
        );
        let asks_for_policy = thread.name != "logging";
        let lacks_policy = missing.iter().any(|what| what.starts_with("policy "));
        assert_eq!(lacks_policy, asks_for_policy && !real_time, "{thread:?}");
    }
    // With the name of the requester.
    for (who, shortfall) in report.all_shortfalls() {
        assert!(
            ["system", "control", "console"].contains(&who),
            "{who}: {shortfall}"
        );
        assert!(!shortfall.why().is_empty() && !shortfall.remedy().is_empty());
    }
    if !COMPLETE {
        assert!(
            report.all_shortfalls().any(|(who, _)| who == "control"),
            "the portable layer has no policies"
        );
    } else if !real_time {
        skip("real-time policies: no privilege");
    }
}

#[test]
fn exits_and_polls() {
    let _watch = watchdog();
    let mut system = System::new("polls");
    let main = system.executor("main").build().unwrap();
    let yields = |times| async move {
        for _ in 0..times {
            luna::yield_now().await;
        }
        let start = luna::now();
        while luna::now() - start < Duration::from_millis(2) {}
        Ok(())
    };
    main.process("timed").timed().spawn_ok(yields(4));
    main.process("not timed").spawn_ok(yields(2));
    let report = system.run().unwrap();
    let [timed, not_timed] = &report.processes[..] else {
        panic!("{report:?}")
    };
    assert_eq!(
        (timed.exit.clone(), timed.polls),
        (Some(Exit::Completed), 5)
    );
    assert!(timed.longest_poll.unwrap() >= Duration::from_millis(2));
    assert_eq!(
        (
            not_timed.exit.clone(),
            not_timed.polls,
            not_timed.longest_poll
        ),
        (Some(Exit::Completed), 3, None)
    );
}

#[test]
fn a_process_that_fails_is_the_outcome_when_all_have_ended() {
    let _watch = watchdog();
    let (failing, went_on) = luna::channel();
    let mut system = System::new("failing");
    let main = system.executor("main").build().unwrap();
    // Ends after the other has failed.
    main.process("good")
        .spawn_ok(async move { Ok(went_on.recv().await?) });
    let deeper = in_process("within", Error::Poisoned);
    let own = deeper.clone();
    main.process("spawned first")
        .priority(1)
        .spawn_ok(async move { Err(own) });
    let fails = async move {
        failing.send(()).await?;
        Err(Error::other("spawned later"))
    };
    main.process("fails first").priority(31).spawn_ok(fails);
    let error = system.run().unwrap_err();
    assert_eq!(error, in_process("spawned first", deeper));
    assert!(error.is_poisoned() && !error.is_closed());
}

#[test]
fn a_threads_processor_time_is_told_where_there_is_one() {
    use luna_platform::clock::processor_time;
    const BUSY: Duration = Duration::from_millis(5);

    for is_virtual in [false, true] {
        let mut system = System::new("busy");
        if is_virtual {
            system.virtual_clock();
        }
        let main = system.executor("main").build().unwrap();
        let busy = || async {
            let begin = processor_time();
            while processor_time()
                .zip(begin)
                .is_some_and(|(now, begin)| now - begin < BUSY)
            {}
            Ok(())
        };
        main.process("on an executor").spawn_ok(busy());
        let alone = system.thread("alone").process("on a thread");
        alone.spawn_ok(busy());
        let report = system.run().unwrap();
        assert_eq!(report.threads.len(), 2);
        for thread in &report.threads {
            match thread.processor_time {
                Some(time) => assert!(!is_virtual && time >= BUSY, "{}: {time:?}", thread.name),
                None => assert!(is_virtual || processor_time().is_none(), "{}", thread.name),
            }
        }
    }
}

#[test]
fn a_process_that_returned_an_error_has_failed() {
    let _watch = watchdog();
    let mut system = System::new("failing");
    let main = system.executor("main").build().unwrap();
    main.process("good").spawn_ok(async { Ok(()) });
    main.process("bad")
        .spawn_ok(async { Err(Error::other("broken")) });
    system.run().unwrap_err();
    let report = system.report().unwrap();
    let ends = report.processes.iter().map(|one| (&*one.name, one.failed));
    assert_eq!(
        ends.collect::<Vec<_>>(),
        [("good", false), ("bad", true)],
        "{report}"
    );
    assert_eq!(report.processes[1].exit, Some(Exit::Completed));
}

/// The same on executor and thread, sending and receiving; of several, each is named.
#[test]
fn an_end_at_a_channel_is_in_order_and_names_it() {
    for place in PLACEMENTS {
        let mut system = System::new("ends");
        let (level, levels) = luna::channel::<u32>();
        let (level, made) = (level.named("level"), line!() - 1);
        let (report_to, reports) = luna::channel::<u32>();
        place
            .process(&mut system, "tank", "pump")
            .spawn_ok(async move {
                let _held = report_to;
                loop {
                    level.send(7).await?;
                }
            });
        place
            .process(&mut system, "hall", "display")
            .spawn_ok(async move {
                levels.recv().await?;
                Ok(())
            });
        place
            .process(&mut system, "office", "reader")
            .spawn_ok(async move {
                loop {
                    reports.recv().await?;
                }
            });
        let report = system.run().unwrap();
        assert!(report.processes.iter().all(|process| !process.failed));
        let pump = &report.ended_at[0];
        assert_eq!(
            (pump.process.as_str(), pump.sends, pump.poisoned),
            ("pump", true, false)
        );
        assert_eq!(
            (pump.channel.as_deref(), pump.partner.as_deref()),
            (Some("level"), Some("display"))
        );
        let place = format!("{}:{made}", file!());
        let place = pump
            .made_at
            .strip_prefix(&place)
            .map(|nth| place.clone() + nth);
        let place = place.expect("it was made there");
        let line = format!(
            "process `pump` ended: the receivers of channel `level`, made at {place}, are gone; the last \
             of its receivers was process `display`"
        );
        assert_eq!(pump.to_string(), line);
        assert!(report.to_string().contains(&line), "{report}");
        let reader = &report.ended_at[1];
        assert_eq!(
            (
                reader.process.as_str(),
                reader.sends,
                reader.channel.as_deref()
            ),
            ("reader", false, None)
        );
    }
}

#[test]
fn poison_is_an_error_and_names_its_channel() {
    let mut system = System::new("poisoned");
    let main = system.executor("main").build().unwrap();
    let (level, _levels) = luna::channel::<u32>();
    main.process("pump").spawn_ok(async move {
        level.poison();
        level.send(7).await?;
        Ok(())
    });
    assert!(system.run().unwrap_err().is_poisoned());
    let report = system.report().unwrap();
    assert!(report.ended_at[0].poisoned, "{:?}", report.ended_at);
    assert!(report.to_string().contains("is poisoned, or a sibling"));
}

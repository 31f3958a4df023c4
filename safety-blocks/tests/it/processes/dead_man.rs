//! A dead man.

use super::*;
use crate::common::SpawnOk;

#[test]
fn a_dead_man_lets_go_at_its_instant_without_a_value_that_comes() {
    let (system, main) = system();
    let (put, input) = luna::channel();
    let (key, keys) = luna::channel();
    let (output, values) = luna::channel();
    let grip = DeadMan::new(20 * MS)
        .unwrap()
        .held_at_most(100 * MS)
        .unwrap();
    let response = Response::new(Reaction::Neutral).recovery(Recovery::After(Duration::ZERO));
    let (reports, causes) = luna::buffered(Buffer::overwrite_oldest(16));
    let process = DeadManProcess::new("grip", grip, 0.0, response, input, keys, output)
        .unwrap()
        .report_to(reports);
    let monitor = process.monitor();
    main.process("dead-man").spawn_ok(process);
    let (seen, alarms) = (note(&main, values), note(&main, causes));
    main.process("operator").spawn_ok(async move {
        put.send(0.1).await?; // not held
        key.send(1).await?;
        put.send(0.2).await?;
        luna::after(10 * MS).await;
        key.send(0).await?; // released
        luna::after(10 * MS).await;
        key.send(2).await?;
        put.send(0.3).await?;
        luna::after(30 * MS).await; // silent since 40
        key.send(3).await?;
        put.send(0.4).await?;
        key.send(0).await?;
        for _ in 0..20 {
            key.send(4).await?; // tied down at 50: until 150
            put.send(0.5).await?;
            luna::after(10 * MS).await;
        }
        drop(key);
        luna::after(MS).await;
        put.send(0.6).await?;
        Ok(())
    });
    system.run().unwrap();
    let mut expected = vec![
        (0, 0.0),
        (0, 0.2),
        (10, 0.0),
        (20, 0.3),
        (40, 0.0),
        (50, 0.0),
    ];
    expected.extend((5..15).map(|n| (n * 10, 0.5)));
    expected.push((150, 0.0));
    expected.extend((15..25).map(|n| (n * 10, 0.0)));
    expected.extend([(251, 0.0), (251, 0.0)]);
    assert_eq!(taken(&seen), expected);
    let alarms = taken(&alarms);
    let faults: Vec<_> = alarms
        .iter()
        .map(|(at, cause)| (*at, cause.fault))
        .collect();
    let (time, limit) = (20 * MS, 20 * MS);
    assert_eq!(faults[0], (40, Fault::Silent { time, limit }));
    let (time, limit) = (100 * MS, 100 * MS);
    assert_eq!(faults[1..], [(150, Fault::HeldTooLong { time, limit })]);
    assert!(!monitor.is_held());
}

#[test]
fn a_dead_man_recovers_by_the_time_of_values_whatever_keys_come_between() {
    let (system, main) = system();
    let (put, input) = luna::channel();
    let (key, keys) = luna::channel();
    let (output, values) = luna::channel();
    let grip = DeadMan::new(20 * MS).unwrap();
    let response = Response::new(Reaction::Neutral).recovery(Recovery::After(3 * MS));
    let process = DeadManProcess::new("grip", grip, 0.0, response, input, keys, output);
    main.process("dead-man").spawn_ok(process.unwrap());
    let seen = note(&main, values);
    main.process("operator").spawn_ok(async move {
        for value in [0.1, f64::NAN, 0.3, 0.4, 0.5, 0.6, 0.7] {
            key.send(1).await?;
            put.send(value).await?;
            luna::after(MS).await;
        }
        Ok(())
    });
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    // At the end the key is released, and nothing comes any more.
    assert_eq!(passed, [0.1, 0.0, 0.0, 0.0, 0.0, 0.6, 0.7, 0.0, 0.0]);
}

//! Sets while the system runs: when each process takes them.

use super::*;
use crate::common::SpawnOk;

/// Loops of 1 ms and of 10 ms, and sets between their slots: each loop takes, at the begin of its
/// cycle, all sets that came before.
#[test]
fn each_process_takes_a_set_at_its_own_boundary() {
    let _watch = watchdog();
    for _ in 0..2 {
        let mut system = System::new("boundaries");
        system.virtual_clock();
        let left = system.executor("left").build().unwrap();
        let right = system.executor("right").build().unwrap();
        let seen = Arc::new(Mutex::new(String::new()));
        for (executor, name, period) in [(&left, "fast", 1), (&right, "slow", 10)] {
            let seen = seen.clone();
            let declare = |process: &ProcessBuilder| {
                let own = process.parameter(&format!("{name}/own"), 0).register()?;
                let common = process.parameter("common", 0).shared().register()?;
                Ok((own, common))
            };
            let body = async move |(own, common): &(Parameter<i32>, Parameter<i32>)| {
                let begin = luna::now();
                let mut tick = luna::periodic(name, MS * period)?;
                let mut last = (0, 0);
                while luna::now() < begin + 25 * MS {
                    tick.next().await;
                    let now = (own.get(), common.get());
                    if now != last {
                        let at = (luna::now() - begin).as_millis();
                        write!(seen.lock().unwrap(), "{name} at {at}: {now:?}. ").unwrap();
                    }
                    last = now;
                    // Whatever comes in the middle of a cycle.
                    luna::after(MS * period * 2 / 3).await;
                    assert_eq!((own.get(), common.get()), now);
                }
                Ok(())
            };
            spawn_with(executor.process(name), declare, body).unwrap();
        }
        let parameters = system.parameters();
        left.process("operator").spawn_ok(async move {
            let begin = luna::now();
            luna::at(begin + 4 * MS + MS / 2).await;
            assert_eq!(
                parameters.set([("fast/own", 1), ("slow/own", 1), ("common", 1)])?,
                1
            );
            luna::at(begin + 6 * MS + MS / 2).await;
            assert_eq!(parameters.set([("common", 2)])?, 2);
            // No process sees the third.
            luna::at(begin + 12 * MS + MS / 4).await;
            parameters.set([("fast/own", 3)])?;
            assert!(!parameters.is_taken(3));
            parameters.set([("fast/own", 4)])?;
            luna::at(begin + 13 * MS + MS / 2).await;
            assert!(parameters.is_taken(4) && !parameters.is_taken(5));
            Ok(())
        });
        drop((left, right));
        system.run().unwrap();
        assert_eq!(
            *seen.lock().unwrap(),
            "fast at 5: (1, 1). fast at 7: (1, 2). slow at 10: (1, 2). fast at 13: (4, 2). "
        );
    }
}

/// Threads set as fast as they can, with sets that are consistent over two processes' parameters.
/// Each process reads correct sums, and the same ones until it takes another set.
#[test]
fn a_storm_of_sets_is_never_seen_by_halves() {
    let _watch = watchdog();
    const LATCHES: u64 = 20_000;
    let mut system = System::new("storm");
    let over = Arc::new(AtomicU64::new(0));
    let last = Arc::new(Mutex::new(Vec::new()));
    for name in ["one", "two"] {
        let executor = system.executor(name).build().unwrap();
        let declare = |process: &ProcessBuilder| {
            let number = |part: &str| {
                process
                    .parameter(&format!("{name}/{part}"), 0_u64)
                    .register()
            };
            let list = process
                .parameter(&format!("{name}/list"), [0_u64, 1, 2, 3, 4, 5, 6, 7])
                .register()?;
            Ok((number("a")?, number("b")?, list))
        };
        let (over, last) = (over.clone(), last.clone());
        let body =
            async move |(a, b, list): &(Parameter<u64>, Parameter<u64>, Parameter<[u64; 8]>)| {
                let read = || {
                    let value = a.get();
                    assert_eq!(b.get(), value.wrapping_mul(3));
                    assert_eq!(list.get(), std::array::from_fn(|n| value + n as u64));
                    value
                };
                // A reader elsewhere sees no parts of two sets either.
                let elsewhere = list.clone();
                let over_there = over.clone();
                let looks = std::thread::spawn(move || {
                    while over_there.load(Ordering::Relaxed) < 2 {
                        let list = elsewhere.get();
                        assert_eq!(list, std::array::from_fn(|n| list[0] + n as u64));
                    }
                });
                // It has come to a value, and to another.
                let (mut latches, mut values, mut before) = (0, 0, 0);
                while latches < LATCHES || values < 10 {
                    a.latch();
                    latches += 1;
                    let value = read();
                    values += u64::from(value != before);
                    before = value;
                    luna::yield_now().await;
                    assert_eq!(read(), value);
                }
                over.fetch_add(1, Ordering::Relaxed);
                // Both processes must come this far before one of them ends.
                while over.load(Ordering::Relaxed) < 2 {
                    luna::yield_now().await;
                }
                looks
                    .join()
                    .map_err(|_| Error::other("the reader elsewhere saw parts of two sets"))?;
                last.lock().unwrap().push(before);
                Ok(())
            };
        spawn_with(executor.process(name), declare, body).unwrap();
    }
    let setters: Vec<_> = (0..2)
        .map(|who| {
            let (parameters, over) = (system.parameters(), over.clone());
            std::thread::spawn(move || {
                let mut value = who;
                while over.load(Ordering::Relaxed) < 2 {
                    value += 2;
                    let of = |name: &str| {
                        let list: [u64; 8] = std::array::from_fn(|n| value + n as u64);
                        [
                            ("a", value.into()),
                            ("b", (value.wrapping_mul(3)).into()),
                            ("list", list.into()),
                        ]
                        .map(|(part, value): (&str, Value)| (format!("{name}/{part}"), value))
                    };
                    match parameters.set(of("one").into_iter().chain(of("two"))) {
                        Ok(_) => {}
                        // Before the start, or after the end.
                        Err(SetError::NotRunning { .. }) => std::thread::yield_now(),
                        Err(error) => panic!("{error}"),
                    }
                }
                value
            })
        })
        .collect();
    let outcome = system.run();
    over.store(2, Ordering::Relaxed);
    let most = setters
        .into_iter()
        .map(|setter| setter.join().unwrap())
        .max();
    outcome.unwrap();
    for last in last.lock().unwrap().iter() {
        assert!((1..=most.unwrap()).contains(last));
    }
}

/// Two processes that take sets when the test asks them to. A process takes a set that does not
/// concern it, whatever comes after. A process that has ended is not waited for.
#[test]
fn a_set_that_is_taken_stays_so_and_nobody_waits_for_the_one_that_has_ended() {
    let _watch = watchdog();
    let mut system = System::new("taken");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let parameters = system.parameters();
    let mut turns = Vec::new();
    for name in ["a", "b"] {
        let (turn, turned) = luna::channel::<bool>();
        turns.push(turn);
        let declare = |process: &ProcessBuilder| Ok(process.parameter(name, 0).register()?);
        let body = async move |own: &Parameter<i32>| {
            while turned.recv().await? {
                own.latch();
            }
            Ok(())
        };
        spawn_with(main.process(name), declare, body).unwrap();
    }
    main.process("operator").spawn_ok(async move {
        // Which have taken the sets 1, 2, ..., so far.
        let taken = || -> Vec<bool> { (1..=4).map(|set| parameters.is_taken(set)).collect() };
        parameters.set([("a", 1)])?;
        assert_eq!(taken(), [false; 4]);
        turns[0].send(true).await?;
        luna::after(MS).await; // it has done so before time goes on
        assert_eq!(taken(), [true, false, false, false]);
        // `b` was not concerned by 1, and is offered 2: that does not undo 1.
        parameters.set([("b", 1)])?;
        assert_eq!(taken(), [true, false, false, false]);
        parameters.set([("a", 2)])?;
        turns[0].send(true).await?;
        luna::after(MS).await; // it has done so before time goes on
        assert_eq!(taken(), [true, false, false, false]);
        let has_taken: Vec<bool> = parameters.list().iter().map(|one| one.taken).collect();
        assert_eq!(has_taken, [true, false]);
        turns[1].send(true).await?;
        luna::after(MS).await; // it has done so before time goes on
        assert_eq!(taken(), [true, true, true, false]);
        // `b` ends without the fourth, on a thread that reaps it.
        parameters.set([("b", 2)])?;
        turns[1].send(false).await?;
        while !parameters.list()[1].processes.is_empty() {
            luna::after(MS).await;
        }
        assert_eq!(taken(), [true; 4]);
        assert_eq!(parameters.set([("b", 3)])?, 5);
        assert!(parameters.is_taken(5));
        turns[0].send(false).await?;
        Ok(())
    });
    drop(main);
    system.run().unwrap();
}

#[test]
fn the_list_says_all_there_is_to_say() {
    let _watch = watchdog();
    let parameters = Arc::new(Mutex::new(None::<Parameters>));
    let mine = parameters.clone();
    run_with_all(
        |system| {
            let handle = system.parameters();
            assert!(handle.list().is_empty());
            assert!(matches!(handle.set([("pan/kp", 1.0)]), Err(SetError::NotRunning { .. })));
            *mine.lock().unwrap() = Some(handle);
        },
        async move |all: &All| {
            let parameters = parameters.lock().unwrap().take().unwrap();
            parameters.set_text("pan/kp = 4, mode=speed, gains=[3, 2, 1]")?;
            let reported: Vec<String> = parameters.list().iter().map(ToString::to_string).collect();
            assert_eq!(
                reported,
                [
                    "count = 3 (u8, default 3)",
                    "gains = [3.0, 2.0, 1.0] ([f64; 3], default [1.0, 2.0, 3.0], 0.0 to 9.0)",
                    "is on = false (bool, default false)",
                    "mode = speed (choice, default position, one of position, speed)",
                    "offset = -7 (i64, default -7, -10 to 10)",
                    "pan/kp = 4.0 1/rad (f64, default 2.0, 0.0 to 50.0)",
                    "pan/limit = 0.5 (f32, default 0.5, 0.1 to 0.9)",
                ]
            );
            let kp = &parameters.list()[5];
            assert_eq!((kp.set, kp.taken, kp.processes.as_slice()), (1, false, &["all".to_owned()][..]));
            assert_eq!((kp.description.as_str(), &kp.most), ("of the controller", &Some(Value::Float(50.0))));
            assert_eq!(all.get(), DEFAULTS);
            all.mode.latch();
            assert!(parameters.list().iter().all(|one| one.taken));
            assert_eq!((all.kp.get(), all.mode.get(), all.gains.get()), (4.0, Mode::Speed, [3.0, 2.0, 1.0]));
            // The same value twice in a set, a syntax that is none.
            let twice = parameters.set([("count", 1), ("count", 1)]).unwrap_err();
            assert!(matches!(&twice, SetError::Refused(refused) if refused[0].reason == Reason::Twice && refused[0].source == Source::Program));
            assert!(matches!(parameters.set_text("count"), Err(SetError::Syntax { .. })));
            assert_eq!(parameters.set(Vec::<(String, f64)>::new()), Ok(1));
            Ok(())
        },
    )
    .unwrap();
}

/// By a process that is not theirs, and by a loop that another has made: nothing is taken.
#[test]
fn only_its_own_process_takes_a_set() {
    let _watch = watchdog();
    let mut system = System::new("others");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    let (handle, handles) = luna::channel::<(Parameter<f64>, luna::Periodic)>();
    let parameters = system.parameters();
    let owner = main.process("owner");
    let x = owner.parameter("x", 0.0).register().unwrap();
    owner.spawn_ok(async move {
        let tick = luna::periodic("handed on", MS)?;
        parameters.set([("x", 1.0)])?;
        handle.send((x.clone(), tick)).await?;
        luna::after(MS * 20).await;
        assert_eq!(x.get(), 0.0);
        x.latch();
        assert_eq!(x.get(), 1.0);
        Ok(())
    });
    main.process("other").spawn_ok(async move {
        let (x, mut tick) = handles.recv().await?;
        for _ in 0..3 {
            tick.next().await;
            x.latch();
            assert_eq!(x.get(), 0.0);
        }
        luna::after(MS * 40).await;
        assert_eq!(x.get(), 1.0);
        Ok(())
    });
    drop(main);
    system.run().unwrap();
}

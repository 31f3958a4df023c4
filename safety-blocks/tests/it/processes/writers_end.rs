//! Writers that end do not switch off the safe state or the emergency that was asked for.

use super::*;
use luna::End;
use luna::safety::Degree;

/// How a controller ends after its last set-point, and how the system does.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ends {
    Well,
    WithAnError,
    ByPoison,
}

const WAYS: [Ends; 3] = [Ends::Well, Ends::WithAnError, Ends::ByPoison];

impl Ends {
    fn end(self, set_points: &Sender<f64>) -> luna::Result<()> {
        match self {
            Ends::Well => Ok(()),
            Ends::WithAnError => Err(luna::Error::System("no sensor".to_owned())),
            Ends::ByPoison => {
                set_points.poison();
                Ok(())
            }
        }
    }
}

/// A chain with a timeout of 5 ms, whose controller ends at 1 ms. Returns the report, and what was
/// put out. `retires` has the controller announce its end.
fn after_a_controller(
    ends: Ends,
    reaction: Reaction,
    retires: bool,
) -> (luna::Report, Vec<(u128, f64)>) {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    let timeout = Timeout::new(5 * MS, 0.0).unwrap();
    let (process, monitor) = limited()
        .process(input, output)
        .timeout("silence", timeout, reaction)
        .unwrap();
    main.process("chain").spawn_ok(process);
    let seen = note(&main, values);
    main.process("controller").spawn_ok(async move {
        put.send(0.5).await?;
        luna::after(MS).await;
        if retires {
            monitor.retire();
        }
        ends.end(&put)
    });
    // The rest of the machine goes on.
    main.process("machine").spawn_ok(async move {
        luna::after(100 * MS).await;
        Ok(())
    });
    let _ = system.run();
    (system.report().unwrap(), taken(&seen))
}

#[test]
fn a_controller_that_ends_is_silent() {
    for ends in WAYS {
        let (report, seen) = after_a_controller(ends, Reaction::Emergency, false);
        assert_eq!(report.end, End::Emergency, "{ends:?}");
        let cause = report.safety.state.to_string();
        assert!(
            cause.contains("nothing has come for 5ms"),
            "{ends:?}: {cause}"
        );
        // Neutral at once, and not only at the emergency.
        assert_eq!(seen, [(0, 0.5), (1, 0.0)], "{ends:?}");

        let (report, _) = after_a_controller(ends, Reaction::SafeState, false);
        assert_eq!(report.safety.state.degree, Degree::SafeState, "{ends:?}");
        assert_eq!(report.end, End::Completed, "{ends:?}");
    }
}

#[test]
fn an_end_that_was_announced_is_no_silence_and_neutral_needs_no_reaction() {
    for ends in WAYS {
        for (reaction, retires) in [
            (Reaction::Emergency, true),
            (Reaction::SafeState, true),
            (Reaction::Neutral, false),
        ] {
            let (report, seen) = after_a_controller(ends, reaction, retires);
            assert_eq!(report.end, End::Completed, "{ends:?}, {reaction:?}");
            assert_eq!(report.safety.state.degree, Degree::Normal);
            assert_eq!(seen, [(0, 0.5), (1, 0.0)], "{ends:?}, {reaction:?}");
        }
    }
}

#[test]
fn a_reader_that_takes_nothing_does_not_hold_the_emergency_up() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel::<f64>();
    let timeout = Timeout::new(5 * MS, 0.0).unwrap();
    let (process, _) = limited()
        .process(input, output)
        .timeout("silence", timeout, Reaction::Emergency)
        .unwrap();
    main.process("chain").spawn_ok(process);
    main.process("controller").spawn_ok(async move {
        put.send(0.5).await?;
        Ok(())
    });
    main.process("motor").spawn_ok(async move {
        values.recv().await?;
        luna::after(100 * MS).await;
        drop(values);
        Ok(())
    });
    system.run().unwrap_err();
    assert_eq!(system.report().unwrap().end, End::Emergency);
}

/// On one executor, at a higher level than the safety process: the timeout's instant comes while the
/// controller computes, and its set-point is there when the safety process is polled.
#[test]
fn a_controller_that_keeps_the_processor_does_not_hide_its_silence() {
    let mut system = System::new("hog");
    let main = system.executor("main").build().unwrap();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    let timeout = Timeout::new(20 * MS, 0.0).unwrap();
    let (process, _) = limited()
        .process(input, output)
        .timeout("silence", timeout, Reaction::Emergency)
        .unwrap();
    main.process("safety").spawn_ok(process);
    let _seen = note(&main, values);
    main.process("controller")
        .priority(20)
        .spawn_ok(async move {
            put.send(0.5).await?;
            luna::after(MS).await;
            let end = luna::now() + 40 * MS;
            while luna::now() < end {
                std::hint::spin_loop();
            }
            put.send(0.6).await?;
            luna::after(Duration::from_secs(1000)).await;
            Ok(())
        });
    let error = system.run().unwrap_err().to_string();
    assert!(error.contains("nothing has come for"), "{error}");
}

#[test]
fn two_channels_that_end_at_once_are_silent() {
    for (reaction, retires, expected) in [
        (Reaction::Emergency, false, End::Emergency),
        (Reaction::Emergency, true, End::Completed),
        (Reaction::Neutral, false, End::Completed),
    ] {
        let (system, main) = system();
        let ((a, from_a), (b, from_b)) = (luna::channel::<f64>(), luna::channel());
        let (safe, values) = luna::channel();
        let both = Agreement::new(Vote::OneOutOfTwo, 0.0, 0.1, Duration::ZERO).unwrap();
        let process =
            AgreementProcess::new("vote", both, reaction, [from_a, from_b], safe, MS, 5 * MS);
        let process = process.unwrap();
        let monitor = process.monitor();
        main.process("vote").spawn_ok(process);
        let seen = note(&main, values);
        main.process("controllers").spawn_ok(async move {
            a.send(0.3).await?;
            b.send(0.3).await?;
            luna::after(MS).await;
            if retires {
                monitor.retire();
            }
            Ok(())
        });
        let _ = system.run();
        assert_eq!(system.report().unwrap().end, expected, "{reaction:?}");
        assert_eq!(taken(&seen), [(0, 0.3), (1, 0.0)], "{reaction:?}");
    }
}

/// A console that ends with the key held: nothing can release it. One that lets go before may end.
#[test]
fn a_console_that_ends_with_the_key_held_is_a_fault() {
    for (ends, lets_go, expected) in [
        (Ends::Well, false, End::Emergency),
        (Ends::WithAnError, false, End::Emergency),
        (Ends::Well, true, End::Completed),
    ] {
        let (system, main) = system();
        let (put, input) = luna::channel();
        let (key, keys) = luna::channel();
        let (output, values) = luna::channel();
        let grip = DeadMan::new(20 * MS).unwrap();
        let process =
            DeadManProcess::new("grip", grip, 0.0, Reaction::Emergency, input, keys, output);
        main.process("dead-man").spawn_ok(process.unwrap());
        let seen = note(&main, values);
        main.process("controller").spawn_ok(async move {
            for _ in 0..10 {
                luna::after(MS).await;
                put.send(0.5).await?;
            }
            Ok(())
        });
        main.process("console").spawn_ok(async move {
            key.send(1).await?;
            luna::after(5 * MS + MS / 2).await;
            if lets_go {
                key.send(0).await?;
            }
            match ends {
                Ends::Well => Ok(()),
                _ => Err(luna::Error::System("unplugged".to_owned())),
            }
        });
        let _ = system.run();
        let report = system.report().unwrap();
        assert_eq!(report.end, expected, "{ends:?}, {lets_go}");
        let seen = taken(&seen);
        assert_eq!(seen[..5], [1, 2, 3, 4, 5].map(|at| (at, 0.5)));
        let after = seen[5..].iter();
        assert!(
            after.map(|(_, value)| *value).all(|value| value == 0.0),
            "{seen:?}"
        );
    }
}

#[test]
fn a_release_that_is_late_does_not_hide_the_silence_before_it() {
    let mut grip = DeadMan::new(20 * MS).unwrap();
    assert!(grip.step(Some(1), MS).is_ok());
    let (time, limit) = (21 * MS, 20 * MS);
    assert_eq!(
        grip.step(Some(0), 21 * MS),
        Err(Fault::Silent { time, limit })
    );
    assert_eq!(grip.step(Some(0), MS), Err(Fault::Released));
    assert!(grip.step(Some(1), MS).is_ok());
}

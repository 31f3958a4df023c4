//! What blocks put out in a safe state.

use super::*;
use crate::common::SpawnOk;

#[test]
fn in_a_safe_state_all_outputs_are_neutral_until_it_is_reset_and_a_fault_that_stays_leads_to_it_again()
 {
    let (system, main) = system();
    let safety = system.safety();
    let ((bad, from_bad), (good, from_good)) = (luna::channel::<f64>(), luna::channel::<f64>());
    let ((first, firsts), (second, seconds)) = (luna::channel(), luna::channel());
    let limit = Limit::new(-1.0, 1.0).unwrap();
    let stops = Chain::new(0.0)
        .unwrap()
        .then("first", limit, Reaction::SafeState)
        .unwrap();
    main.process("first")
        .spawn_ok(stops.process(from_bad, first));
    main.process("second")
        .spawn_ok(limited().process(from_good, second));
    main.process("writer").spawn_ok(async move {
        let round = async |value, expected: [f64; 2]| {
            bad.send(value).await?;
            let put_out = firsts.recv().await?;
            good.send(0.5).await?;
            assert_eq!([put_out, seconds.recv().await?], expected);
            Ok::<(), luna::Error>(())
        };
        let reset =
            || luna::realtime::off_path(|| safety.reset(luna::Error::other("looked at"))).unwrap();
        round(0.1, [0.1, 0.5]).await?;
        round(f64::NAN, [0.0, 0.0]).await?;
        round(0.1, [0.0, 0.0]).await?;
        reset();
        round(0.2, [0.2, 0.5]).await?;
        for _ in 0..2 {
            round(f64::NAN, [0.0, 0.0]).await?;
            assert!(safety.is_safe_state());
            // It is still there.
            reset();
        }
        round(f64::NAN, [0.0, 0.0]).await?;
        let state = luna::realtime::off_path(|| safety.state().to_string());
        assert!(
            state.contains("safety block `first`: the value is NaN"),
            "{state}"
        );
        luna::realtime::off_path(|| drop(state));
        drop((bad, good));
        // Its end.
        assert_eq!((firsts.recv().await?, seconds.recv().await?), (0.0, 0.0));
        Ok(())
    });
    let report = system.run().unwrap();
    assert_eq!(report.safety.state.degree, luna::safety::Degree::SafeState);
}

/// Another process enters the safe state at 5 ms and 15 ms, and leaves it at 10 ms.
fn enters_from_elsewhere(main: &luna::Executor, safety: luna::safety::Safety) {
    main.process("elsewhere").spawn_ok(async move {
        let says = |text| luna::realtime::off_path(|| luna::Error::other(text));
        luna::after(5 * MS).await;
        safety.enter_safe_state(says("too hot"));
        luna::after(5 * MS).await;
        luna::realtime::off_path(|| safety.reset(says("cool"))).unwrap();
        luna::after(5 * MS).await;
        safety.enter_safe_state(says("too hot again"));
        luna::after(15 * MS).await;
        Ok(())
    });
}

/// Values at 0, 7, 12 and 20 ms.
async fn write(put: Sender<f64>) -> luna::Result<()> {
    for (pause, value) in [(0, 0.1), (7, 0.2), (5, 0.3), (8, 0.4)] {
        luna::after(pause * MS).await;
        put.send(value).await?;
    }
    luna::after(10 * MS).await;
    Ok(())
}

/// At 5 and 15 neutral comes at once, at 7 and 20 for a value, and at 30 for the end.
const AT_ONCE: [(u128, f64); 7] = [
    (0, 0.1),
    (5, 0.0),
    (7, 0.0),
    (12, 0.3),
    (15, 0.0),
    (20, 0.0),
    (30, 0.0),
];

#[test]
fn a_safe_state_that_is_entered_elsewhere_reaches_the_output_of_a_chain_at_once() {
    for has_timeout in [false, true] {
        let (system, main) = system();
        let (put, input) = luna::channel::<f64>();
        let (output, values) = luna::channel();
        let chain = limited().process(input, output);
        let chain = match has_timeout {
            true => {
                let timeout = Timeout::new(100 * MS, 0.7).unwrap();
                chain
                    .timeout("silence", timeout, Reaction::Neutral)
                    .unwrap()
                    .0
            }
            false => chain,
        };
        main.process("chain").spawn_ok(chain);
        let seen = note(&main, values);
        enters_from_elsewhere(&main, system.safety());
        main.process("writer").spawn_ok(write(put));
        system.run().unwrap();
        assert_eq!(taken(&seen), AT_ONCE, "{has_timeout}");
    }
}

#[test]
fn a_safe_state_reaches_a_dead_mans_output_at_once() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (key, keys) = luna::channel();
    let (output, values) = luna::channel();
    let grip = DeadMan::new(100 * MS).unwrap();
    let response = Response::new(Reaction::Neutral).recovery(Recovery::After(Duration::ZERO));
    main.process("dead-man")
        .spawn_ok(DeadManProcess::new("grip", grip, 0.0, response, input, keys, output).unwrap());
    let seen = note(&main, values);
    enters_from_elsewhere(&main, system.safety());
    main.process("operator").spawn_ok(async move {
        key.send(1).await?;
        write(put).await?;
        drop(key);
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(taken(&seen), AT_ONCE);
}

#[test]
fn a_safe_state_reaches_the_output_of_two_channels_at_once() {
    let (system, main) = system();
    let ((a, from_a), (b, from_b)) = (luna::channel(), luna::channel());
    let (output, values) = luna::channel();
    let both = Agreement::new(Vote::OneOutOfTwo, 0.0, 0.1, Duration::ZERO).unwrap();
    let channels = [from_a, from_b];
    let process = AgreementProcess::new(
        "vote",
        both,
        Reaction::Neutral,
        channels,
        output,
        MS,
        90 * MS,
    );
    main.process("vote").spawn_ok(process.unwrap());
    let seen = note(&main, values);
    enters_from_elsewhere(&main, system.safety());
    main.process("a").spawn_ok(write(a));
    main.process("b").spawn_ok(write(b));
    system.run().unwrap();
    let seen = taken(&seen);
    assert_eq!(seen[..AT_ONCE.len() - 1], AT_ONCE[..AT_ONCE.len() - 1]);
    assert_eq!(seen.last(), AT_ONCE.last());
}

/// An offer that was not taken is withdrawn for the next value: a process that sends and reads in
/// turn gets one for each.
#[test]
fn a_safe_state_keeps_the_step_of_a_process_that_sends_and_reads_in_turn() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("chain")
        .spawn_ok(limited().process(input, output));
    enters_from_elsewhere(&main, system.safety());
    main.process("both").spawn_ok(async move {
        for (pause, expected) in [(0, 0.5), (7, 0.0), (5, 0.5), (8, 0.0)] {
            luna::after(pause * MS).await;
            put.send(0.5).await?;
            assert_eq!(values.recv().await?, expected);
        }
        Ok(())
    });
    system.run().unwrap();
}

/// These put nothing out in a safe state: a sensor's chain, and a chain that has put out nothing
/// yet.
#[test]
fn a_safe_state_makes_up_nothing() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("sensor")
        .spawn_ok(limited().process(input, output).of_sensor());
    let seen = note(&main, values);
    enters_from_elsewhere(&main, system.safety());
    main.process("writer").spawn_ok(write(put));
    let (late, none_yet) = luna::channel::<f64>();
    let (silent, nothing) = luna::channel();
    main.process("silent")
        .spawn_ok(limited().process(none_yet, silent));
    main.process("late").spawn_ok(async move {
        assert!(
            nothing
                .recv_timeout(29 * MS)
                .await
                .unwrap_err()
                .is_timeout()
        );
        drop(late);
        Ok(())
    });
    system.run().unwrap();
    assert_eq!(taken(&seen), [(0, 0.1), (7, 0.2), (12, 0.3), (20, 0.4)]);
}

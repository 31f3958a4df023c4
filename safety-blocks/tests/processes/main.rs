//! Blocks between channels: pace, ends, silence, alarms, on virtual time.

use luna::prelude::*;
use luna::{Instant, RecvError};
use luna_plants::{Motor, PAN, PlantLink};
use luna_safety_blocks::{
    Agreement, AgreementProcess, Chain, DeadMan, DeadManProcess, EndStop, Fault, Finding, Limit,
    RateLimit, Reaction, Recovery, Response, Signal, Timeout, Vote,
};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

type Seen<T> = Arc<Mutex<Vec<(u128, T)>>>;

fn system() -> (System, luna::Executor) {
    let mut system = System::new("blocks");
    system.virtual_clock();
    let main = system.executor("main").build().unwrap();
    (system, main)
}

/// Notes what comes, and at which millisecond.
fn note<T: Send + 'static>(main: &luna::Executor, values: Receiver<T>) -> Seen<T> {
    let seen = Seen::default();
    let notes = seen.clone();
    main.process(&format!("notes of {}", std::any::type_name::<T>()))
        .priority(31)
        .spawn(async move {
            let start = luna::now();
            while let Ok(value) = values.recv().await {
                let at = (luna::now() - start).as_millis();
                luna::off_path(|| notes.lock().unwrap().push((at, value)));
            }
            Ok(())
        })
        .unwrap();
    seen
}

fn taken<T>(seen: &Seen<T>) -> Vec<(u128, T)> {
    std::mem::take(&mut seen.lock().unwrap())
}

fn limited() -> Chain {
    let limit = Limit::new(-1.0, 1.0).unwrap();
    Chain::new(0.0)
        .unwrap()
        .then("limit", limit, Reaction::Warn)
        .unwrap()
}

#[test]
fn a_chain_adds_no_queue_and_keeps_the_pace_of_its_reader() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("chain")
        .spawn(limited().process(input, output))
        .unwrap();
    let sent = Seen::default();
    let notes = sent.clone();
    main.process("writer")
        .spawn(async move {
            let start = luna::now();
            for n in 0..5 {
                put.send(f64::from(n)).await?;
                let at = (luna::now() - start).as_millis();
                luna::off_path(|| notes.lock().unwrap().push((at, n)));
            }
            Ok(())
        })
        .unwrap();
    main.process("reader")
        .spawn(async move {
            for expected in [0.0, 1.0, 1.0, 1.0, 1.0, 0.0] {
                luna::after(10 * MS).await;
                assert_eq!(values.recv().await?, expected);
            }
            assert_eq!(values.recv().await, Err(RecvError::Closed));
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    // It holds one: the second one is taken when the first has gone.
    assert_eq!(taken(&sent), [(0, 0), (10, 1), (20, 2), (30, 3), (40, 4)]);
}

#[test]
fn poison_passes_behind_a_last_neutral_and_a_sensor_ends_silently() {
    for is_silent in [false, true] {
        let (system, main) = system();
        let (put, input) = luna::channel::<f64>();
        let (output, values) = luna::channel();
        let chain = limited().process(input, output);
        let chain = match is_silent {
            true => chain.of_sensor(),
            false => chain,
        };
        main.process("chain").spawn(chain).unwrap();
        let seen = note(&main, values);
        main.process("writer")
            .spawn(async move {
                put.send(0.5).await?;
                put.poison();
                Ok(())
            })
            .unwrap();
        let error = system.run().unwrap_err();
        assert!(error.is_poisoned(), "{error}");
        let expected: &[_] = if is_silent {
            &[(0, 0.5)]
        } else {
            &[(0, 0.5), (0, 0.0)]
        };
        assert_eq!(taken(&seen), expected);
    }
}

#[test]
fn a_fall_back_is_come_to_in_steps_and_left_when_set_points_come_again() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    let chain = Chain::new(0.0)
        .unwrap()
        .then("rate", RateLimit::new(100.0).unwrap(), Reaction::Warn)
        .unwrap();
    let timeout = Timeout::new(5 * MS, 0.0).unwrap().repeat(MS).unwrap();
    let response = Response::new(Reaction::Neutral).recovery(Recovery::After(2 * MS));
    let (process, monitor) = chain
        .process(input, output)
        .timeout("silence", timeout, response)
        .unwrap();
    main.process("chain").spawn(process).unwrap();
    let seen = note(&main, values);
    main.process("writer")
        .spawn(async move {
            luna::after(10 * MS).await;
            for n in 0..13 {
                // Nothing from 12 to 22.
                if !(3..13 - 1).contains(&n) {
                    put.send(0.3).await?;
                }
                luna::after(MS).await;
            }
            for _ in 0..4 {
                put.send(0.3).await?;
                luna::after(MS).await;
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    let rounded: Vec<_> = taken(&seen)
        .into_iter()
        .map(|(at, value)| (at, (value * 10.0).round() as i32))
        .collect();
    let expected = [
        // From the beginning on nothing has come: the fall-back at 5, and each millisecond.
        (5, 0),
        (6, 0),
        (7, 0),
        (8, 0),
        (9, 0),
        // Good from 10 on: let pass from 12 on, at the rate.
        (10, 0),
        (11, 0),
        (12, 1),
        // Silent since 12; at 22 the fall-back is a moment before the next one.
        (17, 0),
        (18, 0),
        (19, 0),
        (20, 0),
        (21, 0),
        (22, 0),
        (22, 0),
        (23, 0),
        (24, 1),
        (25, 2),
        (26, 3),
        // The end.
        (27, 0),
    ];
    assert_eq!(rounded, expected);
    assert_eq!(monitor.refused(), 5 + 6);
}

#[test]
fn without_a_fresh_position_an_end_stop_lets_nothing_pass() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    let (position, positions) = luna::buffered(Buffer::overwrite_oldest(1));
    let stop = EndStop::new(-1.0, 1.0).unwrap();
    let chain = Chain::new(0.0)
        .unwrap()
        .then("stop", stop, Reaction::Warn)
        .unwrap();
    main.process("chain")
        .spawn(
            chain
                .process(input, output)
                .feedback(positions, 3 * MS)
                .unwrap(),
        )
        .unwrap();
    let seen = note(&main, values);
    main.process("writer")
        .spawn(async move {
            for n in 0..8 {
                // Until 2 ms there is one, and it is far from the stops.
                if n < 3 {
                    position.send(0.0).await?;
                }
                put.send(0.5).await?;
                luna::after(MS).await;
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    assert_eq!(passed, [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0]);
}

#[test]
fn who_is_told_hears_of_each_fault_once_and_resets_it() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    let (told, causes) = luna::buffered::<Finding>(Buffer::overwrite_oldest(4));
    let limit = Limit::new(-1.0, 1.0).unwrap();
    let chain = Chain::new(0.0)
        .unwrap()
        .then("limit", limit, Reaction::Neutral)
        .unwrap();
    let monitor = chain.monitor("limit").unwrap();
    main.process("chain")
        .spawn(chain.process(input, output).tell(told))
        .unwrap();
    let (seen, alarms) = (note(&main, values), note(&main, causes));
    main.process("writer")
        .spawn(async move {
            for value in [0.1, f64::NAN, 0.2, f64::INFINITY, 0.3] {
                put.send(value).await?;
                luna::after(MS).await;
            }
            assert!(monitor.is_held());
            monitor.reset();
            put.send(0.4).await?;
            luna::after(MS).await;
            assert!(!monitor.is_held());
            assert_eq!((monitor.passed(), monitor.refused()), (4, 2));
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    assert_eq!(passed, [0.1, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0]);
    let alarms = taken(&alarms);
    assert_eq!(alarms.len(), 1);
    assert_eq!(
        alarms[0].1.to_string(),
        "safety block `limit`: the value is NaN"
    );
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Command {
    duty: f64,
    angle: f64,
    number: u32,
}

impl Signal for Command {
    fn value(&self) -> f64 {
        self.duty
    }

    fn with_value(self, duty: f64) -> Self {
        Self { duty, ..self }
    }

    fn feedback(&self) -> Option<f64> {
        Some(self.angle)
    }

    fn elapsed(&self) -> Option<Duration> {
        Some(10 * MS)
    }
}

#[test]
fn a_signal_brings_its_feedback_and_its_time_and_keeps_the_rest() {
    let (system, main) = system();
    let (put, input) = luna::channel::<Command>();
    let (output, values) = luna::channel();
    let chain = Chain::new(0.0)
        .unwrap()
        .then("rate", RateLimit::new(10.0).unwrap(), Reaction::Warn)
        .unwrap()
        .then("stop", EndStop::new(-1.0, 1.0).unwrap(), Reaction::Warn)
        .unwrap();
    main.process("chain")
        .spawn(chain.process(input, output))
        .unwrap();
    let seen = note(&main, values);
    let command = |duty, angle, number| Command {
        duty,
        angle,
        number,
    };
    main.process("writer")
        .spawn(async move {
            put.send(command(0.5, 0.0, 1)).await?;
            put.send(command(0.5, 1.5, 2)).await?;
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    let expected = [
        command(0.1, 0.0, 1),
        command(0.0, 1.5, 2),
        command(0.0, 1.5, 2),
    ];
    assert_eq!(passed, expected);
}

/// A motor that two controllers drive through a vote, of which B fails after 300 ms: what came of it, and when.
fn voted(vote: Vote, b_after: fn(f64) -> Option<f64>) -> (Vec<(u128, Finding)>, Instant, f64) {
    let (system, main) = system();
    let ((a, from_a), (b, from_b)) = (luna::channel::<f64>(), luna::channel());
    let (safe, duties) = luna::buffered(Buffer::overwrite_oldest(1));
    let (angle, angles) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (again, angles_again) = luna::buffered::<f64>(Buffer::overwrite_oldest(1));
    let (told, causes) = luna::buffered(Buffer::overwrite_oldest(16));
    let agreement = Agreement::new(vote, 0.0, 0.05, 10 * MS).unwrap();
    let process = AgreementProcess::new(
        "vote",
        agreement,
        Response::new(Reaction::Neutral).limited_for(Duration::from_millis(100)),
        [from_a, from_b],
        safe,
        MS / 2,
        20 * MS,
    );
    main.process("vote")
        .priority(15)
        .spawn(process.unwrap().tell(told))
        .unwrap();
    let controllers = [("a", a, angles, true), ("b", b, angles_again, false)];
    for (name, output, angles, is_a) in controllers {
        main.process(name)
            .spawn(async move {
                let mut tick = luna::periodic(name, MS)?;
                for n in 1..=1000 {
                    tick.next().await;
                    let angle = angles.try_recv().unwrap_or_default();
                    let duty = 4.0 * (0.5 * (f64::from(n) * 5e-3).sin() - angle);
                    let said = match is_a || n < 300 {
                        true => Some(duty),
                        false => b_after(duty),
                    };
                    if let Some(duty) = said {
                        output.send(duty).await?;
                    }
                }
                Ok(())
            })
            .unwrap();
    }
    let alarms = note(&main, causes);
    let mut motor = PlantLink::new("motor", Motor::new(PAN));
    motor.actuator("duty", duties).unwrap();
    motor.sensor("angle", angle).unwrap();
    motor.sensor("angle", again).unwrap();
    let end = Arc::new(Mutex::new(None));
    let at_end = end.clone();
    motor.at_end(move |motor| *at_end.lock().unwrap() = Some((luna::now(), motor.state())));
    main.process("motor")
        .priority(20)
        .spawn(motor.periodic(MS).unwrap())
        .unwrap();
    system.run().unwrap();
    let (at, state) = end.lock().unwrap().take().unwrap();
    (taken(&alarms), at, state.speed)
}

#[test]
fn one_out_of_two_stops_for_a_channel_that_is_silent_or_wrong() {
    let (alarms, ..) = voted(Vote::OneOutOfTwo, |_| None);
    // Half a millisecond after the other's value.
    assert_eq!(alarms[0].0, 300);
    assert!(matches!(alarms[0].1.fault, Fault::Missing { .. }));
    let (alarms, ..) = voted(Vote::OneOutOfTwo, |_| Some(f64::NAN));
    assert_eq!(alarms[0].0, 300);
    assert!(matches!(alarms[0].1.fault, Fault::NotFinite { .. }));
    let (alarms, _, speed) = voted(Vote::OneOutOfTwo, |duty| Some(duty + 0.06));
    assert_eq!((alarms.len(), alarms[0].0, speed), (1, 310, 0.0));
    assert!(matches!(alarms[0].1.fault, Fault::Disagree { .. }));
    assert!(
        voted(Vote::OneOutOfTwo, |duty| Some(duty + 0.04))
            .0
            .is_empty()
    );
}

#[test]
fn two_out_of_two_goes_on_with_one_channel_for_as_long_as_it_may() {
    let (alarms, ..) = voted(Vote::TwoOutOfTwo, |_| None);
    // Its response gives it 100 ms from the first round on, that it lacked.
    assert_eq!((alarms.len(), alarms[0].0), (1, 400));
    let (alarms, ..) = voted(Vote::TwoOutOfTwo, |duty| Some(-duty + 1.0));
    assert!((310..320).contains(&alarms[0].0), "{alarms:?}");
}

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
    let (told, causes) = luna::buffered(Buffer::overwrite_oldest(16));
    let process = DeadManProcess::new("grip", grip, 0.0, response, input, keys, output)
        .unwrap()
        .tell(told);
    let monitor = process.monitor();
    main.process("dead-man").spawn(process).unwrap();
    let (seen, alarms) = (note(&main, values), note(&main, causes));
    main.process("operator")
        .spawn(async move {
            put.send(0.1).await?; // nobody holds it
            key.send(1).await?;
            put.send(0.2).await?;
            luna::after(10 * MS).await;
            key.send(0).await?; // lets go
            luna::after(10 * MS).await;
            key.send(2).await?;
            put.send(0.3).await?;
            luna::after(30 * MS).await; // is away since 40
            key.send(3).await?;
            put.send(0.4).await?;
            key.send(0).await?;
            for _ in 0..20 {
                key.send(4).await?; // ties it down at 50: until 150
                put.send(0.5).await?;
                luna::after(10 * MS).await;
            }
            drop(key);
            luna::after(MS).await;
            put.send(0.6).await?;
            Ok(())
        })
        .unwrap();
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
    main.process("dead-man").spawn(process.unwrap()).unwrap();
    let seen = note(&main, values);
    main.process("operator")
        .spawn(async move {
            for value in [0.1, f64::NAN, 0.3, 0.4, 0.5, 0.6, 0.7] {
                key.send(1).await?;
                put.send(value).await?;
                luna::after(MS).await;
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    // At the end the key is released, and nothing comes any more.
    assert_eq!(passed, [0.1, 0.0, 0.0, 0.0, 0.0, 0.6, 0.7, 0.0, 0.0]);
}

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
        .spawn(stops.process(from_bad, first))
        .unwrap();
    main.process("second")
        .spawn(limited().process(from_good, second))
        .unwrap();
    main.process("writer")
        .spawn(async move {
            let round = async |value, expected: [f64; 2]| {
                bad.send(value).await?;
                let put_out = firsts.recv().await?;
                good.send(0.5).await?;
                assert_eq!([put_out, seconds.recv().await?], expected);
                Ok::<(), luna::Error>(())
            };
            let reset =
                || luna::off_path(|| safety.reset(luna::Error::other("looked at"))).unwrap();
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
            let state = luna::off_path(|| safety.state().to_string());
            assert!(
                state.contains("safety block `first`: the value is NaN"),
                "{state}"
            );
            luna::off_path(|| drop(state));
            drop((bad, good));
            // Its end.
            assert_eq!((firsts.recv().await?, seconds.recv().await?), (0.0, 0.0));
            Ok(())
        })
        .unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.safety.state.degree, luna::Degree::SafeState);
}

/// Somebody else enters the safe state at 5 ms and 15 ms, and leaves it at 10 ms.
fn enters_from_elsewhere(main: &luna::Executor, safety: luna::Safety) {
    main.process("elsewhere")
        .spawn(async move {
            let says = |text| luna::off_path(|| luna::Error::other(text));
            luna::after(5 * MS).await;
            safety.enter_safe_state(says("too hot"));
            luna::after(5 * MS).await;
            luna::off_path(|| safety.reset(says("cool"))).unwrap();
            luna::after(5 * MS).await;
            safety.enter_safe_state(says("too hot again"));
            luna::after(15 * MS).await;
            Ok(())
        })
        .unwrap();
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

/// At 5 and 15 it is neutral at once, at 7 and 20 for what comes, and at 30 since it is the end.
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
        main.process("chain").spawn(chain).unwrap();
        let seen = note(&main, values);
        enters_from_elsewhere(&main, system.safety());
        main.process("writer").spawn(write(put)).unwrap();
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
        .spawn(DeadManProcess::new("grip", grip, 0.0, response, input, keys, output).unwrap())
        .unwrap();
    let seen = note(&main, values);
    enters_from_elsewhere(&main, system.safety());
    main.process("operator")
        .spawn(async move {
            key.send(1).await?;
            write(put).await?;
            drop(key);
            Ok(())
        })
        .unwrap();
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
    main.process("vote").spawn(process.unwrap()).unwrap();
    let seen = note(&main, values);
    enters_from_elsewhere(&main, system.safety());
    main.process("a").spawn(write(a)).unwrap();
    main.process("b").spawn(write(b)).unwrap();
    system.run().unwrap();
    let seen = taken(&seen);
    assert_eq!(seen[..AT_ONCE.len() - 1], AT_ONCE[..AT_ONCE.len() - 1]);
    assert_eq!(seen.last(), AT_ONCE.last());
}

/// An offer that nobody takes is withdrawn for the next value: who sends and reads in turn gets one for each.
#[test]
fn a_safe_state_keeps_the_step_of_who_sends_and_reads_in_turn() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("chain")
        .spawn(limited().process(input, output))
        .unwrap();
    enters_from_elsewhere(&main, system.safety());
    main.process("both")
        .spawn(async move {
            for (pause, expected) in [(0, 0.5), (7, 0.0), (5, 0.5), (8, 0.0)] {
                luna::after(pause * MS).await;
                put.send(0.5).await?;
                assert_eq!(values.recv().await?, expected);
            }
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
}

/// What puts nothing out in a safe state: a sensor's chain, and one that has put out nothing yet.
#[test]
fn a_safe_state_makes_up_nothing() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("sensor")
        .spawn(limited().process(input, output).of_sensor())
        .unwrap();
    let seen = note(&main, values);
    enters_from_elsewhere(&main, system.safety());
    main.process("writer").spawn(write(put)).unwrap();
    let (late, none_yet) = luna::channel::<f64>();
    let (silent, nothing) = luna::channel();
    main.process("silent")
        .spawn(limited().process(none_yet, silent))
        .unwrap();
    main.process("late")
        .spawn(async move {
            assert!(
                nothing
                    .recv_timeout(29 * MS)
                    .await
                    .unwrap_err()
                    .is_timeout()
            );
            drop(late);
            Ok(())
        })
        .unwrap();
    system.run().unwrap();
    assert_eq!(taken(&seen), [(0, 0.1), (7, 0.2), (12, 0.3), (20, 0.4)]);
}

#[test]
fn the_first_warning_of_a_block_is_one_of_the_system() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("chain")
        .spawn(limited().process(input, output))
        .unwrap();
    let _seen = note(&main, values);
    main.process("writer")
        .spawn(async move {
            for value in [f64::NAN, 0.1, f64::NAN, 0.1] {
                put.send(value).await?;
            }
            Ok(())
        })
        .unwrap();
    let report = system.run().unwrap();
    assert_eq!(report.safety.state.degree, luna::Degree::Warning);
    assert_eq!(report.safety.state.events.len(), 1);
}

/// A slow reader's: at 10 it is to find what belongs there, and one for each value that came.
fn of_a_slow_reader(
    add: impl FnOnce(&luna::Executor, Sender<f64>),
    enters_at: u32,
    is_left: bool,
) -> Vec<(u128, f64)> {
    let (system, main) = system();
    let safety = system.safety();
    let (output, values) = luna::channel();
    add(&main, output);
    main.process("elsewhere")
        .spawn(async move {
            luna::after(enters_at * MS).await;
            luna::off_path(|| safety.enter_safe_state(luna::Error::other("too hot")));
            if is_left {
                luna::after(MS).await;
                luna::off_path(|| safety.reset(luna::Error::other("cool"))).unwrap();
            }
            Ok(())
        })
        .unwrap();
    let seen = Seen::default();
    let notes = seen.clone();
    main.process("slow")
        .spawn(async move {
            let start = luna::now();
            loop {
                luna::after(10 * MS).await;
                let Ok(value) = values.recv().await else {
                    return Ok(());
                };
                let at = (luna::now() - start).as_millis();
                luna::off_path(|| notes.lock().unwrap().push((at, value)));
            }
        })
        .unwrap();
    system.run().unwrap();
    taken(&seen)
}

/// Values at 0 and 12 ms, and the end at 45.
async fn write_two(put: Sender<f64>) -> luna::Result<()> {
    put.send(0.5).await?;
    luna::after(12 * MS).await;
    put.send(0.6).await?;
    luna::after(33 * MS).await;
    Ok(())
}

fn spawn_chain(main: &luna::Executor, output: Sender<f64>, is_of_sensor: bool) {
    let (put, input) = luna::channel();
    let chain = limited().process(input, output);
    let chain = match is_of_sensor {
        true => chain.of_sensor(),
        false => chain,
    };
    main.process("chain").spawn(chain).unwrap();
    main.process("writer").spawn(write_two(put)).unwrap();
}

fn spawn_dead_man(main: &luna::Executor, output: Sender<f64>) {
    let (put, input) = luna::channel();
    let (key, keys) = luna::channel();
    let grip = DeadMan::new(100 * MS).unwrap();
    let process = DeadManProcess::new("grip", grip, 0.0, Reaction::Neutral, input, keys, output);
    main.process("dead-man").spawn(process.unwrap()).unwrap();
    main.process("operator")
        .spawn(async move {
            key.send(1).await?;
            write_two(put).await?;
            drop(key);
            Ok(())
        })
        .unwrap();
}

fn spawn_vote(main: &luna::Executor, output: Sender<f64>) {
    let ((a, from_a), (b, from_b)) = (luna::channel(), luna::channel());
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
    main.process("vote").spawn(process.unwrap()).unwrap();
    main.process("a").spawn(write_two(a)).unwrap();
    main.process("b").spawn(write_two(b)).unwrap();
}

#[test]
fn a_safe_state_withdraws_what_a_slow_reader_has_not_taken() {
    let neutral = [(10, 0.0), (20, 0.0), (45, 0.0)];
    let chain = |main: &luna::Executor, output| spawn_chain(main, output, false);
    assert_eq!(of_a_slow_reader(chain, 5, false), neutral);
    assert_eq!(of_a_slow_reader(spawn_dead_man, 5, false), neutral);
    assert_eq!(of_a_slow_reader(spawn_vote, 5, false), neutral);
    // Left before anybody reads: what was withdrawn does not come again.
    let afterwards = [(10, 0.0), (20, 0.6), (45, 0.0)];
    assert_eq!(of_a_slow_reader(chain, 5, true), afterwards);
    assert_eq!(of_a_slow_reader(spawn_dead_man, 5, true), afterwards);
    assert_eq!(of_a_slow_reader(spawn_vote, 5, true), afterwards);
    // What is measured stays, and is not made up.
    let sensor = |main: &luna::Executor, output| spawn_chain(main, output, true);
    assert_eq!(of_a_slow_reader(sensor, 5, false), [(10, 0.5), (20, 0.6)]);
}

#[test]
fn a_safe_state_that_comes_behind_the_reader_withdraws_nothing_twice() {
    // The first one was taken at 10, so the second one is on offer from 12 on, and neutral from 15 on.
    let chain = |main: &luna::Executor, output| spawn_chain(main, output, false);
    let expected = [(10, 0.5), (20, 0.0), (45, 0.0)];
    assert_eq!(of_a_slow_reader(chain, 15, false), expected);
    assert_eq!(of_a_slow_reader(spawn_dead_man, 15, false), expected);
    assert_eq!(of_a_slow_reader(spawn_vote, 15, false), expected);
}

//! Blocks between channels: pace, ends, silence, alarms, on virtual time.

mod channels;
mod dead_man;
mod safe_state;
mod slow_reader;
mod writers_end;

use crate::common::SpawnOk;
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
    main.process(format!("notes of {}", std::any::type_name::<T>()))
        .priority(31)
        .spawn_ok(async move {
            let start = luna::now();
            while let Ok(value) = values.recv().await {
                let at = (luna::now() - start).as_millis();
                luna::realtime::off_path(|| notes.lock().unwrap().push((at, value)));
            }
            Ok(())
        });
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
        .spawn_ok(limited().process(input, output));
    let sent = Seen::default();
    let notes = sent.clone();
    main.process("writer").spawn_ok(async move {
        let start = luna::now();
        for n in 0..5 {
            put.send(f64::from(n)).await?;
            let at = (luna::now() - start).as_millis();
            luna::realtime::off_path(|| notes.lock().unwrap().push((at, n)));
        }
        Ok(())
    });
    main.process("reader").spawn_ok(async move {
        for expected in [0.0, 1.0, 1.0, 1.0, 1.0, 0.0] {
            luna::after(10 * MS).await;
            assert_eq!(values.recv().await?, expected);
        }
        assert_eq!(values.recv().await, Err(RecvError::Closed));
        Ok(())
    });
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
        main.process("chain").spawn_ok(chain);
        let seen = note(&main, values);
        main.process("writer").spawn_ok(async move {
            put.send(0.5).await?;
            put.poison();
            Ok(())
        });
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
    main.process("chain").spawn_ok(process);
    let seen = note(&main, values);
    main.process("writer").spawn_ok(async move {
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
    });
    system.run().unwrap();
    let rounded: Vec<_> = taken(&seen)
        .into_iter()
        .map(|(at, value)| (at, (value * 10.0).round() as i32))
        .collect();
    let expected = [
        // From the beginning nothing has come: the fall-back at 5, and each millisecond.
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
    main.process("chain").spawn_ok(
        chain
            .process(input, output)
            .feedback(positions, 3 * MS)
            .unwrap(),
    );
    let seen = note(&main, values);
    main.process("writer").spawn_ok(async move {
        for n in 0..8 {
            // Until 2 ms there is one, and it is far from the stops.
            if n < 3 {
                position.send(0.0).await?;
            }
            put.send(0.5).await?;
            luna::after(MS).await;
        }
        Ok(())
    });
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    assert_eq!(passed, [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0]);
}

#[test]
fn each_fault_is_reported_once_and_can_be_reset() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    let (reports, causes) = luna::buffered::<Finding>(Buffer::overwrite_oldest(4));
    let limit = Limit::new(-1.0, 1.0).unwrap();
    let chain = Chain::new(0.0)
        .unwrap()
        .then("limit", limit, Reaction::Neutral)
        .unwrap();
    let monitor = chain.monitor("limit").unwrap();
    main.process("chain")
        .spawn_ok(chain.process(input, output).report_to(reports));
    let (seen, alarms) = (note(&main, values), note(&main, causes));
    main.process("writer").spawn_ok(async move {
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
    });
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
    main.process("chain").spawn_ok(chain.process(input, output));
    let seen = note(&main, values);
    let command = |duty, angle, number| Command {
        duty,
        angle,
        number,
    };
    main.process("writer").spawn_ok(async move {
        put.send(command(0.5, 0.0, 1)).await?;
        put.send(command(0.5, 1.5, 2)).await?;
        Ok(())
    });
    system.run().unwrap();
    let passed: Vec<_> = taken(&seen).into_iter().map(|(_, value)| value).collect();
    let expected = [
        command(0.1, 0.0, 1),
        command(0.0, 1.5, 2),
        command(0.0, 1.5, 2),
    ];
    assert_eq!(passed, expected);
}

#[test]
fn the_first_warning_of_a_block_is_one_of_the_system() {
    let (system, main) = system();
    let (put, input) = luna::channel::<f64>();
    let (output, values) = luna::channel();
    main.process("chain")
        .spawn_ok(limited().process(input, output));
    let _seen = note(&main, values);
    main.process("writer").spawn_ok(async move {
        for value in [f64::NAN, 0.1, f64::NAN, 0.1] {
            put.send(value).await?;
        }
        Ok(())
    });
    let report = system.run().unwrap();
    assert_eq!(report.safety.state.degree, luna::safety::Degree::Warning);
    assert_eq!(report.safety.state.events.len(), 1);
}

//! What a slow reader finds after a safe state.

use super::*;
use crate::common::SpawnOk;

/// A slow reader: at 10 it must find the right value, and one for each value that came.
fn of_a_slow_reader(
    add: impl FnOnce(&luna::Executor, Sender<f64>),
    enters_at: u32,
    is_left: bool,
) -> Vec<(u128, f64)> {
    let (system, main) = system();
    let safety = system.safety();
    let (output, values) = luna::channel();
    add(&main, output);
    main.process("elsewhere").spawn_ok(async move {
        luna::after(enters_at * MS).await;
        luna::realtime::off_path(|| safety.enter_safe_state(luna::Error::other("too hot")));
        if is_left {
            luna::after(MS).await;
            luna::realtime::off_path(|| safety.reset(luna::Error::other("cool"))).unwrap();
        }
        Ok(())
    });
    let seen = Seen::default();
    let notes = seen.clone();
    main.process("slow").spawn_ok(async move {
        let start = luna::now();
        loop {
            luna::after(10 * MS).await;
            let Ok(value) = values.recv().await else {
                return Ok(());
            };
            let at = (luna::now() - start).as_millis();
            luna::realtime::off_path(|| notes.lock().unwrap().push((at, value)));
        }
    });
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
    main.process("chain").spawn_ok(chain);
    main.process("writer").spawn_ok(write_two(put));
}

fn spawn_dead_man(main: &luna::Executor, output: Sender<f64>) {
    let (put, input) = luna::channel();
    let (key, keys) = luna::channel();
    let grip = DeadMan::new(100 * MS).unwrap();
    let process = DeadManProcess::new("grip", grip, 0.0, Reaction::Neutral, input, keys, output);
    main.process("dead-man").spawn_ok(process.unwrap());
    main.process("operator").spawn_ok(async move {
        key.send(1).await?;
        write_two(put).await?;
        drop(key);
        Ok(())
    });
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
    main.process("vote").spawn_ok(process.unwrap());
    main.process("a").spawn_ok(write_two(a));
    main.process("b").spawn_ok(write_two(b));
}

#[test]
fn a_safe_state_withdraws_what_a_slow_reader_has_not_taken() {
    let neutral = [(10, 0.0), (20, 0.0), (45, 0.0)];
    let chain = |main: &luna::Executor, output| spawn_chain(main, output, false);
    assert_eq!(of_a_slow_reader(chain, 5, false), neutral);
    assert_eq!(of_a_slow_reader(spawn_dead_man, 5, false), neutral);
    assert_eq!(of_a_slow_reader(spawn_vote, 5, false), neutral);
    // Left before the reader reads: the withdrawn value does not come again.
    let afterwards = [(10, 0.0), (20, 0.6), (45, 0.0)];
    assert_eq!(of_a_slow_reader(chain, 5, true), afterwards);
    assert_eq!(of_a_slow_reader(spawn_dead_man, 5, true), afterwards);
    assert_eq!(of_a_slow_reader(spawn_vote, 5, true), afterwards);
    // A measurement stays, and is not replaced.
    let sensor = |main: &luna::Executor, output| spawn_chain(main, output, true);
    assert_eq!(of_a_slow_reader(sensor, 5, false), [(10, 0.5), (20, 0.6)]);
}

#[test]
fn a_safe_state_that_comes_behind_the_reader_withdraws_nothing_twice() {
    // The first value was taken at 10, so the second one is on offer from 12 on, and neutral from
    // 15 on.
    let chain = |main: &luna::Executor, output| spawn_chain(main, output, false);
    let expected = [(10, 0.5), (20, 0.0), (45, 0.0)];
    assert_eq!(of_a_slow_reader(chain, 15, false), expected);
    assert_eq!(of_a_slow_reader(spawn_dead_man, 15, false), expected);
    assert_eq!(of_a_slow_reader(spawn_vote, 15, false), expected);
}

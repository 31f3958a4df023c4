//! Two runs of one system on a virtual clock are the same, byte for byte, whatever the machine does
//! meanwhile.

use crate::common;
use common::{Random, SpawnOk, watchdog};
use luna::{Buffer, Policy, System};
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const US: Duration = Duration::from_micros(1);

/// What happened, a line each: time, process, action.
#[derive(Clone, Default)]
struct Trace(Arc<Mutex<String>>);

impl Trace {
    fn note(&self, who: &str, what: u64) {
        let now = luna::now().as_nanos();
        writeln!(self.0.lock().unwrap(), "{now} {who} {what}").unwrap();
    }
}

/// Runs a network in which all sorts of things race, and gives what happened.
fn run(seed: u64) -> String {
    let trace = Trace::default();
    let mut system = System::new("raced");
    system.virtual_clock();
    let executors: Vec<luna::Executor> = (0..4)
        .map(|number| {
            let policy = [
                Policy::Other,
                Policy::fifo(10),
                Policy::Other,
                Policy::fifo(30),
            ];
            let builder = system.executor(format!("executor {number}"));
            builder.policy(policy[number]).build().unwrap()
        })
        .collect();
    let (requests, requested) = luna::channel::<u64>();
    let (answers, answered) = luna::buffered::<u64>(Buffer::overwrite_oldest(2));
    let (urgent, urged) = luna::buffered::<u64>(Buffer::fifo(4));
    for number in 0..12_u64 {
        let name = format!("client {number}");
        let (own, of, trace) = (name.clone(), requests.clone(), trace.clone());
        let urgent = urgent.clone();
        let body = async move {
            let mut random = Random::new(seed + number + 1);
            let mut tick = luna::periodic(&own, US * (50 + 7 * (number as u32 % 4)))?;
            for turn in 0..60 {
                let cycle = tick.next().await;
                trace.note(&own, cycle.number);
                match random.below(5) {
                    0 => luna::after(US * random.below(200) as u32).await,
                    1 => drop(of.send_timeout(number, US * 30).await),
                    2 => drop(urgent.try_send(number)),
                    3 if turn % 10 == 0 => {
                        let slow = random.below(2) == 0;
                        let number = luna::blocking(move || {
                            if slow {
                                std::thread::yield_now();
                            }
                            number
                        });
                        trace.note(&own, number.await);
                    }
                    _ => of.send(number).await?,
                }
            }
            Ok(())
        };
        let place = number as usize % 5;
        let level = (number * 7 % 32) as u8;
        if let Some(executor) = executors.get(place) {
            executor.process(&name).priority(level).spawn_ok(body);
        } else {
            system
                .thread(format!("thread {number}"))
                .process(&name)
                .spawn_ok(body);
        }
    }
    drop((requests, urgent));
    let noted = trace.clone();
    let late = executors[1].clone();
    let server = async move {
        let mut served = 0;
        let mut idle = 0;
        loop {
            luna::alt! {
                request = requested.recv() => match request {
                    Ok(client) => {
                        noted.note("request", client);
                        served += 1;
                        answers.send(client * served).await?;
                    }
                    Err(_) => break,
                },
                request = urged.recv() => match request {
                    Ok(client) => noted.note("urgent", client),
                    Err(_) => break,
                },
                _ = luna::after(US * 15) => {
                    idle += 1;
                    noted.note("idle", idle);
                }
            }
            if served == 20 {
                served += 1;
                let noted = noted.clone();
                late.process("late").spawn(async move {
                    luna::after(US * 33).await;
                    noted.note("late", 0);
                    Ok(())
                })?;
            }
        }
        Ok(())
    };
    executors[0].process("server").spawn_ok(server);
    let noted = trace.clone();
    let log = async move {
        while let Ok(answer) = answered.recv().await {
            noted.note("answer", answer);
            luna::after(US * 5).await;
        }
        Ok(())
    };
    executors[2].process("log").spawn_ok(log);
    system.run().unwrap();
    std::mem::take(&mut trace.0.lock().unwrap())
}

#[test]
fn runs_are_the_same_also_on_a_machine_that_is_busy() {
    let _alive = watchdog();
    let quiet = run(1);
    assert!(quiet.lines().count() > 1000, "{quiet}");
    assert!(quiet.contains(" idle ") && quiet.contains(" late ") && quiet.contains(" urgent "));
    let ends = Arc::new(AtomicBool::new(false));
    let busy: Vec<_> = (0..3)
        .map(|_| {
            let ends = ends.clone();
            std::thread::spawn(move || while !ends.load(Relaxed) {})
        })
        .collect();
    for round in 0..8 {
        // Other addresses than before.
        let _moved: Vec<Vec<u8>> = (0..round * 10).map(|size| vec![0; size * 37]).collect();
        assert!(run(1) == quiet, "run {round} differs");
    }
    ends.store(true, Relaxed);
    busy.into_iter().for_each(|thread| thread.join().unwrap());
    assert!(run(2) != quiet, "the trace shows what happens");
}

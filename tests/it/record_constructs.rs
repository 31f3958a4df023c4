//! Each construct with an unforeseeable outcome, recorded on several threads and replayed; and the
//! constructs that are refused by name.

use crate::common;
use common::{SpawnOk, TempFile, watchdog};
use luna::prelude::*;
use luna::replay::{self, RecordError, Recording};
use luna::sync::{Condvar, Mutex, Semaphore};
use luna::{Alternative, Buffer, Error, Executor};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

type Outputs = Arc<std::sync::Mutex<Vec<(&'static str, u64)>>>;

fn give(outputs: &Outputs, who: &'static str, value: u64) {
    replay::output(who, &value);
    outputs.lock().unwrap().push((who, value));
}

/// Works for an unforeseeable time.
fn work() {
    static SEED: AtomicU64 = AtomicU64::new(1);
    let turns = replay::input("work", || {
        let seed = SEED.fetch_add(0x9e37_79b9_7f4a_7c15, Ordering::Relaxed);
        (seed ^ luna::Instant::now().as_nanos()).wrapping_mul(0x2545_f491_4f6c_dd1d) >> 52
    });
    for _ in 0..turns {
        std::hint::spin_loop();
    }
}

/// What each process gave, in its own order.
fn by_process(outputs: &Outputs) -> Vec<(&'static str, Vec<u64>)> {
    let taken = std::mem::take(&mut *outputs.lock().unwrap());
    let mut by_process: Vec<(&'static str, Vec<u64>)> = Vec::new();
    for (who, value) in taken {
        match by_process.iter_mut().find(|(other, _)| *other == who) {
            Some((_, values)) => values.push(value),
            None => by_process.push((who, vec![value])),
        }
    }
    by_process.sort_unstable();
    by_process
}

/// Records some runs of a network, and replays each twice.
#[track_caller]
fn check(name: &str, network: impl Fn(&mut System, &Outputs) -> luna::Result<()>) {
    let _watch = watchdog();
    let file = TempFile::new(name);
    let made = |outputs: &Outputs| {
        let mut system = System::new(name);
        network(&mut system, outputs).unwrap();
        system
    };
    for _ in 0..8 {
        let outputs = Outputs::default();
        let report = made(&outputs)
            .record(&file.0)
            .replace_recordings()
            .run()
            .unwrap();
        let recorded = report.record.unwrap();
        assert_eq!((recorded.lost, recorded.outside), (0, 0));
        let first = by_process(&outputs);
        assert!(!first.is_empty());
        let recording = Recording::open(&file.0).unwrap();
        for _ in 0..2 {
            let outputs = Outputs::default();
            let report = made(&outputs).replay(&recording).run();
            let report = report.unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(report.record.unwrap().events, recorded.events);
            assert_eq!(by_process(&outputs), first);
        }
    }
}

const ROUNDS: u64 = 40;

#[test]
fn permits() {
    check("permits", |system, outputs| {
        let semaphore = Semaphore::new(2);
        let order = Mutex::new(0_u64);
        for name in ["one", "two", "three"] {
            let executor = system.executor(name).build()?;
            let (semaphore, order, outputs) = (semaphore.clone(), order.clone(), outputs.clone());
            executor.process(name).spawn(async move {
                for round in 0..ROUNDS {
                    work();
                    let permit = match round % 3 {
                        0 => semaphore.acquire().await.ok(),
                        1 => semaphore.try_acquire(),
                        _ => semaphore
                            .acquire_timeout(Duration::from_micros(5))
                            .await
                            .ok(),
                    };
                    give(&outputs, name, u64::from(permit.is_some()));
                    give(&outputs, name, semaphore.available_permits());
                    luna::yield_now().await;
                    if permit.is_some() {
                        let mut order = order.lock().await?;
                        *order += 1;
                        give(&outputs, name, *order);
                    }
                }
                Ok(())
            })?;
        }
        Ok(())
    });
}

#[test]
fn conditions() {
    check("conditions", |system, outputs| {
        let queue = Mutex::new(Vec::<u64>::new());
        let filled = Condvar::new();
        for (number, name) in ["maker", "other maker"].into_iter().enumerate() {
            let executor = system.executor(name).build()?;
            let (queue, filled) = (queue.clone(), filled.clone());
            executor.process(name).spawn(async move {
                for round in 0..ROUNDS {
                    work();
                    queue.lock().await?.push(number as u64 * 1000 + round);
                    match round % 4 {
                        0 => filled.notify_all(),
                        _ => filled.notify_one(),
                    }
                }
                Ok(())
            })?;
        }
        for name in ["taker", "other taker"] {
            let executor = system.executor(name).build()?;
            let (queue, filled) = (queue.clone(), filled.clone());
            let outputs = outputs.clone();
            executor.process(name).spawn(async move {
                for _ in 0..ROUNDS {
                    work();
                    let mut queue = queue.lock().await?;
                    while queue.is_empty() {
                        let timeout = Duration::from_micros(50);
                        let (guard, result) = filled.wait_timeout(queue, timeout).await?;
                        queue = guard;
                        give(&outputs, name, 9000 + u64::from(result.timed_out()));
                    }
                    let value = queue.remove(0);
                    give(&outputs, name, value);
                }
                Ok(())
            })?;
        }
        Ok(())
    });
}

#[test]
fn alternatives_that_stay_registered() {
    check("registered", |system, outputs| {
        let (mut senders, mut receivers) = (Vec::new(), Vec::new());
        for number in 0..6 {
            let (sender, receiver) = match number % 2 {
                0 => luna::channel::<u64>(),
                _ => luna::buffered::<u64>(Buffer::fifo(2)),
            };
            senders.push(sender);
            receivers.push(receiver);
        }
        let executors = [
            system.executor("left").build()?,
            system.executor("right").build()?,
        ];
        for (number, sender) in senders.into_iter().enumerate() {
            let executor = &executors[number % 2];
            executor
                .process(format!("sender {number}"))
                .spawn(async move {
                    for round in 0..ROUNDS / 2 {
                        work();
                        sender.send(number as u64 * 1000 + round).await?;
                    }
                    Ok(())
                })?;
        }
        let outputs = outputs.clone();
        system
            .executor("server")
            .build()?
            .process("server")
            .spawn(async move {
                let mut all = Alternative::fair(&receivers);
                let mut open = receivers.len();
                while open > 0 {
                    match all.recv().await {
                        (_, Ok(value)) => give(&outputs, "server", value),
                        (index, Err(_)) => {
                            give(&outputs, "server", 7000 + index as u64);
                            all.remove(index);
                            open -= 1;
                        }
                    }
                }
                Ok(())
            })
            .map(drop)
    });
}

#[test]
fn ticks_timers_and_ends() {
    check("times", |system, outputs| {
        let (values, received) = luna::channel::<u64>();
        let left = system.executor("left").build()?;
        let right = system.executor("right").build()?;
        let out = outputs.clone();
        left.process("source").spawn(async move {
            let mut ticks = luna::ticks(Duration::from_micros(70))?;
            for round in 0..ROUNDS {
                work();
                let tick = ticks.tick().await;
                give(&out, "source", tick.number);
                give(&out, "source", tick.slot.as_nanos());
                if values.send(round).await.is_err() {
                    break;
                }
            }
            let (kept, gone) = luna::channel::<()>();
            drop(gone);
            let end = kept.ended().await;
            give(
                &out,
                "source",
                u64::from(end == luna::channel::ChannelEnd::Closed),
            );
            Ok(())
        })?;
        let out = outputs.clone();
        right.process("sink").spawn(async move {
            let mut silence = luna::Timer::new();
            silence.set(Duration::from_micros(100));
            loop {
                luna::alt! {
                    value = received.recv() => match value {
                        Ok(value) => {
                            give(&out, "sink", value);
                            silence.set(Duration::from_micros(100));
                        }
                        Err(_) => return Ok(()),
                    },
                    deadline = silence.expired() => {
                        give(&out, "sink", deadline.as_nanos());
                        silence.set(Duration::from_micros(100));
                    }
                }
            }
        })?;
        Ok(())
    });
}

/// Executors beside a process that enters the safe state again and again.
fn beside_safe_states(system: &mut System) -> luna::Result<[Executor; 2]> {
    let safety = system.safety();
    let enters = system.executor("enters").build()?;
    enters.process("enters").spawn(async move {
        for _ in 0..ROUNDS {
            work();
            safety.enter_safe_state(Error::Timeout);
            work();
            safety.reset(Error::Timeout).unwrap();
            luna::yield_now().await;
        }
        Ok(())
    })?;
    Ok([
        system.executor("writes").build()?,
        system.executor("reads").build()?,
    ])
}

#[test]
fn receives_that_the_safe_state_ends() {
    check("receives_that_the_safe_state_ends", |system, outputs| {
        let (sender, receiver) = luna::channel();
        let [writes, reads] = beside_safe_states(system)?;
        writes.process("writes").spawn(async move {
            for value in 0..ROUNDS {
                work();
                sender.send(value).await?;
            }
            Ok(())
        })?;
        let outputs = outputs.clone();
        reads.process("reads").spawn(async move {
            let safety = luna::safety::current().unwrap();
            let mut entered = std::pin::pin!(safety.safe_state_entered());
            loop {
                let received = match receiver.recv_unless(entered.as_mut()).await {
                    Err(luna::RecvTimeoutError::Timeout) => {
                        give(&outputs, "reads", ROUNDS);
                        receiver.recv().await.map_err(Into::into)
                    }
                    received => received,
                };
                match received {
                    Ok(value) => give(&outputs, "reads", value),
                    Err(error) => {
                        assert_eq!(error, luna::RecvTimeoutError::Closed);
                        return Ok(());
                    }
                }
            }
        })?;
        Ok(())
    });
}

#[test]
fn sends_that_the_safe_state_ends() {
    check("sends_that_the_safe_state_ends", |system, outputs| {
        let (sender, receiver) = luna::channel();
        let [writes, reads] = beside_safe_states(system)?;
        let given = outputs.clone();
        writes.process("writes").spawn(async move {
            let safety = luna::safety::current().unwrap();
            let mut entered = std::pin::pin!(safety.safe_state_edge());
            for value in 0..ROUNDS {
                work();
                match sender.send_unless(value, entered.as_mut()).await {
                    Err(luna::SendTimeoutError::Timeout(value)) => {
                        give(&given, "writes", value);
                        sender.send(ROUNDS + value).await?;
                    }
                    sent => sent?,
                }
            }
            Ok(())
        })?;
        let outputs = outputs.clone();
        reads.process("reads").spawn(async move {
            while let Ok(value) = receiver.recv().await {
                work();
                give(&outputs, "reads", value);
            }
            Ok(())
        })?;
        Ok(())
    });
}

#[test]
fn buffers_that_are_drained_at_once() {
    check("drained", |system, outputs| {
        let (small, drained) = luna::buffered::<u64>(Buffer::fifo(2));
        let (newest, looked_at) = luna::buffered::<u64>(Buffer::overwrite_oldest(3));
        let left = system.executor("left").build()?;
        let right = system.executor("right").build()?;
        left.process("source").spawn(async move {
            for round in 0..10 * ROUNDS {
                work();
                if small.send(round).await.is_err() || newest.send(round).await.is_err() {
                    break;
                }
            }
            Ok(())
        })?;
        let outputs = outputs.clone();
        right.process("poller").spawn(async move {
            // Until the source is gone, however late it comes to run.
            loop {
                luna::after(Duration::from_micros(20)).await;
                // More than fits: the source goes on in between.
                let empty = loop {
                    match drained.try_recv() {
                        Ok(value) => {
                            work();
                            give(&outputs, "poller", value);
                        }
                        Err(why) => break why,
                    }
                };
                while let Ok(value) = looked_at.try_recv() {
                    work();
                    give(&outputs, "poller", value);
                }
                if !empty.is_empty() {
                    return Ok(());
                }
            }
        })?;
        Ok(())
    });
}

#[test]
fn processes_that_others_spawn() {
    check("spawned", |system, outputs| {
        for name in ["left", "right"] {
            let executor = system.executor(name).build()?;
            let (place, outputs) = (executor.clone(), outputs.clone());
            executor.process(name).spawn(async move {
                for round in 0..5 {
                    work();
                    let outputs = outputs.clone();
                    let child =
                        place
                            .process(format!("{name}'s child {round}"))
                            .spawn(async move {
                                let number = replay::input("number", || round * 10);
                                give(&outputs, name, number);
                                Ok(())
                            })?;
                    let child = place.process_handle(child).expect("it was spawned");
                    child.join().await;
                }
                Ok(())
            })?;
        }
        Ok(())
    });
}

#[test]
fn blocking_calls_whose_result_has_a_byte_form() {
    let _watch = watchdog();
    let file = TempFile::new("blocking");
    let calls = Arc::new(AtomicU64::new(0));
    let network = || {
        let mut system = System::new("blocking");
        let calls = calls.clone();
        let main = system.executor("main").build()?;
        main.process("main").spawn(async move {
            for _ in 0..3 {
                let calls = calls.clone();
                let call = move || calls.fetch_add(1, Ordering::Relaxed) + 40;
                let value = replay::blocking("outside", call).await;
                replay::output("value", &value);
            }
            Ok(())
        })?;
        Ok::<_, Error>(system)
    };
    network().unwrap().record(&file.0).run().unwrap();
    let recording = Recording::open(&file.0).unwrap();
    network().unwrap().replay(&recording).run().unwrap();
    assert_eq!(calls.load(Ordering::Relaxed), 3, "a replay calls nobody");
    assert_eq!(recording.outputs(), 3);
}

/// Records a system with one process, which is to be refused, and returns the error.
#[track_caller]
fn refused<F: Future<Output = luna::Result<()>> + Send + 'static>(name: &str, body: F) -> String {
    let _watch = watchdog();
    let file = TempFile::new(name);
    let mut system = System::new(name);
    let thread = system.thread("main");
    thread.process("main").spawn_ok(body);
    let error = system.record(&file.0).run().unwrap_err();
    let Error::Record(error) = error else {
        panic!("{name}: {error}")
    };
    let RecordError::Outside { process, construct } = &error else {
        panic!("{name}: {error}")
    };
    assert_eq!(process, "main");
    // The file cannot be replayed by mistake.
    assert_eq!(Recording::open(&file.0).unwrap_err(), error);
    let (recording, wrong) = Recording::salvage(&file.0).unwrap();
    assert_eq!((wrong, recording.is_whole()), (Some(error.clone()), true));
    construct.clone()
}

#[test]
fn what_is_not_recorded_is_refused_by_name() {
    let called = refused("call", async {
        luna::blocking(|| 1).await;
        Ok(())
    });
    assert_eq!(called, "`blocking`");
    let (sender, receiver) = luna::buffered::<u64>(Buffer::fifo(1));
    let blocked = refused("blocking", async move {
        sender.send(1).await?;
        receiver.blocking_recv()?;
        Ok(())
    });
    assert_eq!(blocked, "a blocking operation");
    let (sender, receiver) = luna::channel::<u64>();
    let (ready, is_ready) = std::sync::mpsc::channel();
    let outside = std::thread::spawn(move || {
        is_ready.recv().unwrap();
        sender.blocking_send(1).unwrap();
    });
    let talked = refused("thread", async move {
        // From here on it is a recorded channel.
        let _ = receiver.try_recv();
        ready.send(()).unwrap();
        receiver.external().recv().await?;
        Ok(())
    });
    outside.join().unwrap();
    assert_eq!(
        talked,
        "a communication with a thread or a process that is not recorded"
    );
}

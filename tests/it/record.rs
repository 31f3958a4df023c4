//! Runs with real parallelism, recorded and replayed: what each process gives outside is the same.

use crate::common::TempFile;
use luna::prelude::*;
use luna::replay::{self, Recording};
use luna::sync::Mutex;
use luna::{Buffer, End};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// What each process gave outside, in its order.
type Outputs = BTreeMap<&'static str, Vec<u64>>;

/// Where outputs go, and what comes from outside.
#[derive(Clone, Default)]
struct World {
    outputs: Arc<std::sync::Mutex<Outputs>>,
    inputs: Arc<AtomicU64>,
}

impl World {
    fn give(&self, who: &'static str, value: u64) {
        replay::output(who, &value);
        self.outputs
            .lock()
            .unwrap()
            .entry(who)
            .or_default()
            .push(value);
    }

    /// An unforeseeable number.
    fn take(&self) -> u64 {
        replay::input("world", || {
            let count = self.inputs.fetch_add(1, Ordering::Relaxed);
            let now = luna::Instant::now().as_nanos();
            (now ^ count).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32
        })
    }

    /// Works for an unforeseeable time.
    fn work(&self) {
        for _ in 0..self.take() % 2000 {
            std::hint::spin_loop();
        }
    }

    fn taken(&self) -> Outputs {
        std::mem::take(&mut self.outputs.lock().unwrap())
    }
}

const ROUNDS: u64 = 40;

/// A network with all that is recorded.
fn network(world: &World) -> luna::Result<System> {
    let mut system = System::new("everything");
    let left = system.executor("left").build()?;
    let right = system.executor("right").build()?;
    let (many, each) = luna::channel::<u64>();

    // Several senders on one channel, from three threads.
    let sender = |who: u64, output: Sender<u64>| {
        let world = world.clone();
        async move {
            for round in 0..ROUNDS {
                world.work();
                output.send(who * 1000 + round).await?;
            }
            Ok(())
        }
    };
    left.process("one").spawn(sender(1, many.clone()))?;
    right.process("two").spawn(sender(2, many.clone()))?;
    system
        .thread("alone")
        .process("three")
        .spawn(sender(3, many))?;
    let out = world.clone();
    right.process("collector").spawn(async move {
        while let Ok(value) = each.recv().await {
            out.give("collector", value);
        }
        Ok(())
    })?;

    // A buffer that overwrites, polled by a loop.
    let (newest, watched) = luna::buffered::<u64>(Buffer::overwrite_oldest(2));
    let out = world.clone();
    left.process("sensor").spawn(async move {
        for value in 0..ROUNDS {
            out.work();
            // The poller may have gone.
            if newest.send(value).await.is_err() {
                out.give("sensor", value);
                break;
            }
        }
        Ok(())
    })?;
    let out = world.clone();
    right.process("poller").spawn(async move {
        let mut tick = luna::periodic("poll", Duration::from_micros(100))?;
        for _ in 0..ROUNDS {
            let cycle = tick.next().await;
            out.give("poller", cycle.number);
            out.give("poller", cycle.lateness.as_nanos() as u64);
            if let Ok(value) = watched.try_recv() {
                out.give("poller", value);
            }
            out.give("poller", luna::now().as_nanos());
        }
        Ok(())
    })?;

    // Input and output guards against each other, and timeouts.
    let (ping, pinged) = luna::channel::<u64>();
    let (pong, ponged) = luna::channel::<u64>();
    let out = world.clone();
    left.process("player").spawn(async move {
        for round in 0..ROUNDS {
            out.work();
            let came = alt! {
                sent = ping.send(round) => { sent?; 0 },
                value = ponged.recv() => value? + 1,
            };
            out.give("player", came);
        }
        Ok(())
    })?;
    let out = world.clone();
    right.process("other").spawn(async move {
        for round in 0.. {
            out.work();
            let came = pri_alt! {
                value = pinged.recv() => match value { Ok(value) => value, Err(_) => break },
                sent = pong.send(round) => match sent { Ok(()) => 7777, Err(_) => break },
                _ = luna::after(Duration::from_micros(20)) => 8888,
            };
            out.give("other", came);
        }
        Ok(())
    })?;

    // A mutex, and the branches of a parallel construct.
    let shared = Mutex::new(0_u64);
    for (name, executor) in [("locker", &left), ("rival", &right)] {
        let (shared, out) = (shared.clone(), world.clone());
        executor.process(name).spawn(async move {
            let turn = async |times: u64| {
                for _ in 0..ROUNDS {
                    out.work();
                    let mut value = shared.lock().await?;
                    *value = value.wrapping_mul(3) + times;
                    out.give(name, *value);
                    drop(value);
                    luna::yield_now().await;
                }
                Ok::<(), luna::Error>(())
            };
            par!(turn(1), turn(2)).await?;
            Ok(())
        })?;
    }

    // Receives that give up.
    let (slow, hasty) = luna::channel::<u64>();
    let out = world.clone();
    left.process("slow").spawn(async move {
        for value in 0..ROUNDS / 4 {
            luna::after(Duration::from_micros(out.take() % 60)).await;
            slow.send(value).await?;
        }
        Ok(())
    })?;
    let out = world.clone();
    right.process("hasty").spawn(async move {
        loop {
            match hasty.recv_timeout(Duration::from_micros(30)).await {
                Ok(value) => out.give("hasty", value),
                Err(error) if error.is_timeout() => out.give("hasty", 9999),
                Err(_) => return Ok(()),
            }
        }
    })?;
    Ok(system)
}

fn recorded(world: &World, file: &TempFile) -> (Outputs, u64) {
    let mut system = network(world).unwrap();
    system.record(&file.0).replace_recordings();
    let report = system.run().unwrap();
    let recorded = report.record.unwrap();
    assert_eq!(recorded.lost, 0);
    assert_eq!(recorded.bytes, std::fs::metadata(&file.0).unwrap().len());
    (world.taken(), recorded.events)
}

#[test]
fn a_replay_gives_the_same_outputs() {
    let file = TempFile::new("same");
    let mut runs = Vec::new();
    for _ in 0..20 {
        let world = World::default();
        let (outputs, events) = recorded(&world, &file);
        let recording = Recording::open(&file.0).unwrap();
        assert!(recording.is_whole() && recording.has_ended());
        assert_eq!(recording.events(), events);
        // As often as one likes.
        for _ in 0..2 {
            let asked = world.inputs.load(Ordering::Relaxed);
            let mut system = network(&world).unwrap();
            system.replay(&recording);
            let report = system.run().unwrap();
            assert_eq!(report.end, End::Completed);
            assert_eq!(report.record.unwrap().events, events);
            assert_eq!(world.taken(), outputs);
            assert_eq!(
                world.inputs.load(Ordering::Relaxed),
                asked,
                "the outside was touched"
            );
        }
        runs.push(outputs);
    }
    runs.dedup();
    assert!(
        runs.len() > 1,
        "no two runs differ, so that nothing was shown"
    );
}

//! Bands: executors of different SCHED_FIFO priorities on one core. The kernel lets a higher one
//! run in the middle of a long poll of a lower one. No mapping of the same processes to one
//! executor, or to executors that do not follow their priorities, does so. The tests see it in what
//! processes observe of each other's steps, not in time.

#![cfg(target_os = "linux")]

use crate::common;
use crate::kernel;
use common::{SpawnOk, real_time_core};
use kernel::{own_processor_time, spoilt};
use luna::prelude::*;
use luna::{Executor, after, channel};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// An executor at `priority`.
fn band(system: &mut System, core: usize, name: &str, priority: u8) -> Executor {
    let executor = system.executor(name).core(core);
    executor.policy(Policy::fifo(priority)).build().unwrap()
}

/// Steps without an await, which end when another process has seen them, or after a time.
#[derive(Debug, Default)]
struct LongPoll {
    steps: AtomicU64,
    has_ended: AtomicBool,
    is_seen: AtomicBool,
}

/// What another process finds of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Found {
    Before,
    Within,
    After,
}

impl LongPoll {
    /// Keeps the processor until it is seen, for at most so much of its time.
    fn run(&self, most: Duration) {
        let end = own_processor_time() + most;
        while !self.is_seen.load(Ordering::SeqCst) && own_processor_time() < end {
            self.steps.fetch_add(1, Ordering::SeqCst);
        }
        self.has_ended.store(true, Ordering::SeqCst);
    }

    fn found(&self) -> Found {
        if self.has_ended.load(Ordering::SeqCst) {
            Found::After
        } else if self.steps.load(Ordering::SeqCst) > 0 {
            Found::Within
        } else {
            Found::Before
        }
    }

    /// Sleeps until it has begun, and says how far it is then.
    async fn look(&self) -> Found {
        loop {
            match self.found() {
                Found::Before => after(Duration::from_micros(300)).await,
                found => return found,
            }
        }
    }

    fn see(&self) {
        self.is_seen.store(true, Ordering::SeqCst);
    }
}

/// For a poll that another process sees. No machine takes so long to fire a timer.
const SEEN: Duration = Duration::from_secs(5);
/// For a poll that no process can see.
const UNSEEN: Duration = Duration::from_millis(20);

/// A process that polls long between two rendezvous, and one that is to see it. Returns what the
/// second one found.
fn long_polls(
    high: Executor,
    low: Executor,
    system: &System,
    rounds: u32,
    most: Duration,
) -> Vec<Found> {
    let (begin, begun) = channel::<Arc<LongPoll>>();
    let (notify, notified) = channel::<Found>();
    let all = Arc::new(Mutex::new(Vec::new()));
    let found = all.clone();
    low.process("low").priority(0).spawn_ok(async move {
        for _ in 0..rounds {
            let poll = Arc::new(LongPoll::default());
            begin.send(poll.clone()).await?;
            poll.run(most);
            let round = notified.recv().await?;
            found.lock().unwrap().push(round);
        }
        Ok(())
    });
    high.process("high").priority(31).spawn_ok(async move {
        while let Ok(poll) = begun.recv().await {
            let found = poll.look().await;
            poll.see();
            notify.send(found).await?;
        }
        Ok(())
    });
    system.run().unwrap();
    let all = all.lock().unwrap();
    all.clone()
}

#[test]
fn a_higher_band_runs_within_a_long_poll_of_a_lower_one() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let mut system = System::new("bands");
    let high = band(&mut system, core, "high", 80);
    let low = band(&mut system, core, "low", 20);
    let found = long_polls(high, low, &system, 50, SEEN);
    assert_eq!(found, [Found::Within; 50]);
}

#[test]
fn on_one_executor_it_runs_after() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let mut system = System::new("one executor");
    let one = band(&mut system, core, "one", 80);
    let found = long_polls(one.clone(), one, &system, 5, UNSEEN);
    assert_eq!(found, [Found::After; 5]);
}

#[test]
fn on_executors_of_one_priority_it_runs_after() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let mut system = System::new("equal");
    let high = band(&mut system, core, "high", 50);
    let low = band(&mut system, core, "low", 50);
    let found = long_polls(high, low, &system, 5, UNSEEN);
    assert_eq!(found, [Found::After; 5]);
}

/// A send to a higher band is a point of preemption, in the middle of a poll: the receiver runs
/// before the sender's next step.
#[test]
fn a_receiver_of_a_higher_band_runs_before_the_senders_next_step() {
    own_process!();
    const STEPS: u64 = 2_000;
    let Some(core) = real_time_core() else { return };
    // On one executor the receiver first runs when the poll is over.
    for in_bands in [true, false] {
        let mut system = System::new("next step");
        let low = band(&mut system, core, "low", 20);
        let high = if in_bands {
            band(&mut system, core, "high", 80)
        } else {
            low.clone()
        };
        let (sender, receiver) = channel::<u64>();
        let steps = Arc::new(AtomicU64::new(0));
        let (of_high, received) = (steps.clone(), Arc::new(AtomicU64::new(0)));
        let (count, lates) = (received.clone(), Arc::new(AtomicU64::new(0)));
        let late = lates.clone();
        high.process("high").priority(31).spawn_ok(async move {
            receiver.recv().await?;
            while let Ok(step) = receiver.recv().await {
                let now = of_high.load(Ordering::SeqCst);
                if now == if in_bands { step } else { STEPS } {
                    count.fetch_add(1, Ordering::SeqCst);
                } else {
                    late.fetch_add(1, Ordering::SeqCst);
                }
            }
            Ok(())
        });
        low.process("low").priority(0).spawn_ok(async move {
            // From then on the receiver waits.
            sender.send(0).await?;
            for step in 1..=STEPS {
                steps.store(step, Ordering::SeqCst);
                // Full when the receiver has not run since the one before.
                let _ = sender.try_send(step);
            }
            Ok(())
        });
        system.run().unwrap();
        let received = received.load(Ordering::SeqCst);
        if in_bands {
            let late = lates.load(Ordering::SeqCst);
            assert!(
                late <= spoilt(STEPS) && received > STEPS / 2,
                "{late} late of {received}"
            );
        } else {
            assert_eq!(received, 1);
        }
    }
}

#[test]
fn three_bands_nest() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let mut system = System::new("nested");
    let [of_low, of_middle] = [(); 2].map(|()| Arc::new(LongPoll::default()));
    let (below, above) = (of_low.clone(), of_middle.clone());
    let low = band(&mut system, core, "low", 20);
    low.process("low").spawn_ok(async move {
        of_low.run(SEEN);
        Ok(())
    });
    let middle = band(&mut system, core, "middle", 50);
    middle.process("middle").spawn_ok(async move {
        assert_eq!(below.look().await, Found::Within);
        of_middle.run(SEEN);
        // The higher band has come and gone, and the lower one still not gone on.
        assert_eq!(below.found(), Found::Within);
        below.see();
        Ok(())
    });
    let high = band(&mut system, core, "high", 80);
    high.process("high").spawn_ok(async move {
        assert_eq!(above.look().await, Found::Within);
        above.see();
        Ok(())
    });
    system.run().unwrap();
}

/// How the three processes of figure 5.20 are spread over threads.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mapping {
    /// The figure: the processes of 80 and 20 on a thread of 80, that of 50 on a thread of 50.
    Figure,
    /// The same, on threads of one priority.
    Equal,
    /// All on one thread.
    One,
    /// Each on a thread of its own priority.
    Bands,
}

/// The thesis' problem of figure 5.20: the kernel knows the threads' priorities, not those of the
/// processes in them. The process of priority 50 waits until that of 20 is through, since the
/// thread of the latter is not below its own.
#[test]
fn the_problem_of_figure_5_20() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    for (mapping, expected) in [
        (Mapping::Figure, Found::After),
        (Mapping::Equal, Found::After),
        (Mapping::One, Found::After),
        (Mapping::Bands, Found::Within),
    ] {
        let mut system = System::new("figure 5.20");
        let mut executor = |name, priority| band(&mut system, core, name, priority);
        let [high, middle, low] = match mapping {
            Mapping::Figure => {
                let left = executor("left", 80);
                [left.clone(), executor("right", 50), left]
            }
            Mapping::Equal => {
                let left = executor("left", 50);
                [left.clone(), executor("right", 50), left]
            }
            Mapping::One => {
                let one = executor("one", 80);
                [one.clone(), one.clone(), one]
            }
            Mapping::Bands => [executor("80", 80), executor("50", 50), executor("20", 20)],
        };
        let poll = Arc::new(LongPoll::default());
        let (of_middle, of_high) = (poll.clone(), poll.clone());
        let found = Arc::new(Mutex::new([None; 2]));
        let [by_middle, by_high] = [(); 2].map(|()| found.clone());
        let (go, gone) = channel::<()>();
        high.process("80").priority(31).spawn_ok(async move {
            by_high.lock().unwrap()[0] = Some(of_high.look().await);
            // Both are to find the same poll.
            go.send(()).await?;
            Ok(())
        });
        middle.process("50").priority(16).spawn_ok(async move {
            let found = of_middle.look().await;
            by_middle.lock().unwrap()[1] = Some(found);
            gone.recv().await?;
            of_middle.see();
            Ok(())
        });
        let most = match mapping {
            Mapping::Bands => SEEN,
            _ => UNSEEN,
        };
        low.process("20").priority(0).spawn_ok(async move {
            poll.run(most);
            Ok(())
        });
        system.run().unwrap();
        let found = *found.lock().unwrap();
        assert_eq!(found, [Some(expected); 2], "{mapping:?}");
    }
}

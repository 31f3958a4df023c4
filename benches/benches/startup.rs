//! `startup`: from nothing to a system with all processes running, on one core.
//!
//! For LUNA that is: the system is described, its thread is created, every process' `pre_run` has
//! run, all are released, and each body has begun. The peers have no such phases: all are spawned,
//! and each has begun.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
        mpsc,
    },
    time::{Duration, Instant},
};

use luna::Process;
use luna_benches::{
    cores::{on_core, one_core},
    executors::{Executor, Smol, Threads, Tokio},
    harness::{Case, Goal, is_quick, run},
    ours::Luna,
};

const NAME: &str = "start-up";
const UNIT: &str = "ms";

/// How many processes.
fn sizes() -> &'static [u64] {
    if is_quick() {
        &[100, 10_000]
    } else {
        &[100, 1_000, 10_000]
    }
}

/// A process of LUNA with something to do in each phase.
struct Prepared {
    prepared: Arc<AtomicU64>,
    begun: Arc<AtomicU64>,
    size: u64,
    /// The last process sends the time when it began.
    all: mpsc::Sender<Instant>,
}

impl Process for Prepared {
    fn pre_run(&mut self) -> luna::Result<()> {
        self.prepared.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    async fn run(&mut self) -> luna::Result<()> {
        let prepared = self.prepared.load(Ordering::Relaxed);
        assert_eq!(prepared, self.size, "a process is not prepared");
        if self.begun.fetch_add(1, Ordering::Relaxed) + 1 == self.size {
            self.all.send(Instant::now()).map_err(luna::Error::other)?;
        }
        Ok(())
    }
}

fn luna(size: u64) -> Duration {
    let core = one_core();
    on_core(core, || {
        let (prepared, begun): (Arc<AtomicU64>, Arc<AtomicU64>) = Default::default();
        let (all, ready) = mpsc::channel();
        let start = Instant::now();
        let luna = Luna::new(core);
        for _ in 0..size {
            let spawned = luna.process().spawn(Prepared {
                prepared: prepared.clone(),
                begun: begun.clone(),
                size,
                all: all.clone(),
            });
            spawned.expect("the names differ");
        }
        luna.block_on(async {});
        ready.recv().expect("the last process has begun") - start
    })
}

fn peer<E: Executor>(size: u64) -> Duration {
    let core = one_core();
    on_core(core, || {
        let begun: Arc<AtomicU64> = Arc::default();
        let (all, ready) = mpsc::channel();
        let start = Instant::now();
        let executor = E::new(core);
        let mut last = None;
        for number in 1..=size {
            let (begun, all) = (begun.clone(), all.clone());
            let process = async move {
                if begun.fetch_add(1, Ordering::Relaxed) + 1 == size {
                    all.send(Instant::now()).expect("it is waited for");
                }
            };
            if number < size {
                executor.start(process);
            } else {
                last = Some(executor.spawn(process));
            }
        }
        executor.block_on(last.expect("there is one at least"));
        ready.recv().expect("the last process has begun") - start
    })
}

fn case(peer: &'static str, size: u64, block: fn(u64) -> Duration) -> Case {
    let block = move || block(size).as_secs_f64() * 1e3;
    Case::once(NAME, peer, UNIT, block).size(size)
}

fn main() {
    let mut cases = Vec::new();
    for &size in sizes() {
        let luna = case("LUNA", size, luna);
        cases.extend([
            if size == 10_000 {
                luna.goal(Goal::AtMost(50.0))
            } else {
                luna
            },
            case("tokio, spawn", size, peer::<Tokio>),
            case("smol LocalExecutor", size, peer::<Smol>),
        ]);
        if size <= 1_000 {
            cases.push(case("std threads", size, peer::<Threads>));
        }
    }
    run("startup", cases);
}

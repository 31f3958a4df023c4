//! `barrier`: n processes on one core synchronize repeatedly. The figure is per process and
//! synchronization.

use std::{
    future::Future,
    sync::Arc,
    time::{Duration, Instant},
};

use luna_benches::{
    executors::{Executor, Threads, Tokio, on_one_core},
    harness::{Case, is_quick, run},
    ours::Luna,
    primitives,
    processes::warm_up,
};

const NAME: &str = "barrier";
const UNIT: &str = "ns/process";

/// How many meet.
fn sizes() -> &'static [u64] {
    if is_quick() {
        &[2, 10, 1_000]
    } else {
        &[2, 10, 100, 1_000, 10_000]
    }
}

/// The limit of threads.
const MAX_THREADS: u64 = 100;

/// A peer's barrier.
trait Meeting: Clone + Send + 'static {
    fn new(parties: usize) -> Self;
    fn meet(&self) -> impl Future<Output = ()> + Send;
}

impl Meeting for luna::Barrier {
    fn new(parties: usize) -> Self {
        luna::Barrier::new(parties)
    }

    async fn meet(&self) {
        self.sync().await;
    }
}

impl Meeting for Arc<tokio::sync::Barrier> {
    fn new(parties: usize) -> Self {
        Arc::new(tokio::sync::Barrier::new(parties))
    }

    async fn meet(&self) {
        self.wait().await;
    }
}

impl Meeting for Arc<std::sync::Barrier> {
    fn new(parties: usize) -> Self {
        Arc::new(std::sync::Barrier::new(parties))
    }

    async fn meet(&self) {
        self.wait();
    }
}

/// The number of synchronizations for this many arrivals of one party.
fn meetings(comings: u64, parties: u64) -> u64 {
    comings.div_ceil(parties)
}

fn scale(elapsed: Duration, comings: u64, parties: u64) -> Duration {
    elapsed.mul_f64(comings as f64 / (meetings(comings, parties) * parties) as f64)
}

async fn party(meeting: impl Meeting, meetings: u64) -> Duration {
    for _ in 0..warm_up(meetings) {
        meeting.meet().await;
    }
    let start = Instant::now();
    for _ in 0..meetings {
        meeting.meet().await;
    }
    start.elapsed()
}

fn barrier<E: Executor, M: Meeting>(parties: u64, comings: u64) -> Duration {
    on_one_core(|executor: &E| {
        let meeting = M::new(parties as usize);
        let meetings = meetings(comings, parties);
        for _ in 1..parties {
            let meeting = meeting.clone();
            executor.start(async move {
                party(meeting, meetings).await;
            });
        }
        let timed = executor.spawn(party(meeting, meetings));
        scale(executor.block_on(timed), comings, parties)
    })
}

fn case(peer: &'static str, size: u64, block: fn(u64, u64) -> Duration) -> Case {
    Case::new(NAME, peer, UNIT, move |comings| block(size, comings))
        .size(size)
        .at_least(16 * size)
}

fn main() {
    let mut cases = Vec::new();
    for &size in sizes() {
        cases.extend([
            case("LUNA", size, barrier::<Luna, luna::Barrier>),
            case(
                "tokio Barrier, spawn",
                size,
                barrier::<Tokio, Arc<tokio::sync::Barrier>>,
            ),
        ]);
        if size <= MAX_THREADS {
            let threads = barrier::<Threads, Arc<std::sync::Barrier>>;
            cases.push(case("std Barrier, threads", size, threads));
        }
    }
    cases.extend(primitives::one_core_cases());
    run("barrier", cases);
}

//! `spawn`: a process starts another one, which does nothing, and waits for its end; one after the
//! other, on one core.
//!
//! LUNA has two ways: a process of the system, with a priority and a place in the report, with a
//! shared name or one of its own; and a branch of a parallel construct, as with occam's `PAR`.

use std::time::{Duration, Instant};

use luna_benches::{
    executors::{Executor, Smol, Threads, Tokio, on_one_core},
    external,
    harness::{Case, Goal, run},
    ours::Luna,
    primitives,
    processes::warm_up,
};

const NAME: &str = "spawn and join";
const UNIT: &str = "ns/process";

/// Times this many calls of `operation`, after a warm-up.
async fn timed(operations: u64, mut operation: impl AsyncFnMut(u64)) -> Duration {
    let warm_up = warm_up(operations);
    for number in 0..warm_up {
        operation(number).await;
    }
    let start = Instant::now();
    for number in warm_up..warm_up + operations {
        operation(number).await;
    }
    start.elapsed()
}

/// Spawns by `child`, in a process.
fn luna_by(
    processes: u64,
    child: impl AsyncFn(&luna::Executor, u64) -> luna::Exit + Send + 'static,
) -> Duration {
    on_one_core(|luna: &Luna| {
        let executor = luna.executor().clone();
        let (result, elapsed) = std::sync::mpsc::channel();
        let spawned = luna.process().spawn(move || async move {
            let elapsed = timed(processes, async |number| {
                assert_eq!(child(&executor, number).await, luna::Exit::Completed);
            });
            result.send(elapsed.await).map_err(luna::Error::other)
        });
        spawned.expect("it is the first");
        luna.block_on(async {});
        elapsed.recv().expect("the parent has sent it")
    })
}

fn luna(processes: u64) -> Duration {
    luna_by(processes, async |executor, _| {
        let child = executor.process("child").one_of_many();
        let child = child.start(async { Ok(()) }).expect("the system runs");
        child.join().await
    })
}

/// Its name is generated, and its handle is found by its number.
fn luna_with_name(processes: u64) -> Duration {
    luna_by(processes, async |executor, number| {
        let child = executor.process(format!("child {number}"));
        let child = child.spawn(async { Ok(()) }).expect("the names differ");
        let child = executor.process_handle(child).expect("it was spawned");
        child.join().await
    })
}

/// Two branches in each construct, of which the parent runs none itself.
fn luna_par(branches: u64) -> Duration {
    on_one_core(|luna: &Luna| {
        let process = luna.spawn(async move {
            let start = Instant::now();
            for _ in 0..branches.div_ceil(2) {
                let joined = luna::par!(async { luna::Result::Ok(()) }, async { Ok(()) }).await;
                joined.expect("no branch fails");
            }
            start.elapsed()
        });
        luna.block_on(process)
    })
}

/// A collection of branches in one allocation.
fn luna_par_for(branches: u64) -> Duration {
    const AT_ONCE: u64 = 1_000;
    on_one_core(|luna: &Luna| {
        let process = luna.spawn(async move {
            let rounds = branches.div_ceil(AT_ONCE);
            let start = Instant::now();
            for _ in 0..rounds {
                let joined = luna::par_for(0..AT_ONCE, async |number| Ok(number)).await;
                assert_eq!(joined.expect("no branch fails").len() as u64, AT_ONCE);
            }
            start
                .elapsed()
                .mul_f64(branches as f64 / (rounds * AT_ONCE) as f64)
        });
        luna.block_on(process)
    })
}

fn tokio(processes: u64) -> Duration {
    on_one_core(|executor: &Tokio| {
        let process = executor.spawn(timed(processes, async |_| {
            tokio::spawn(async {}).await.expect("it does not panic");
        }));
        executor.block_on(process)
    })
}

/// Its `LocalExecutor` cannot be reached from a process, so the parent is the future that it blocks
/// on.
fn smol(processes: u64) -> Duration {
    on_one_core(|executor: &Smol| {
        executor.block_on(timed(processes, async |_| executor.spawn(async {}).await))
    })
}

fn threads(processes: u64) -> Duration {
    on_one_core(|executor: &Threads| {
        executor.block_on(timed(processes, async |_| executor.spawn(async {}).await))
    })
}

fn case(peer: &'static str, block: fn(u64) -> Duration) -> Case {
    Case::new(NAME, peer, UNIT, block)
}

fn main() {
    let mut cases = vec![
        // Always as many: the system keeps each for its report.
        case("LUNA", luna).exactly(10_000).goal(Goal::AtMost(60.0)),
        case("LUNA, each with its name", luna_with_name).exactly(10_000),
        case("LUNA, branch of par!", luna_par),
        case("LUNA, branch of par_for", luna_par_for),
        case("tokio, spawn", tokio),
        case("smol LocalExecutor", smol),
        case("std threads", threads),
    ];
    cases.extend(external::cases(NAME, UNIT, "spawn", None));
    cases.extend(primitives::one_core_cases());
    run("spawn", cases);
}

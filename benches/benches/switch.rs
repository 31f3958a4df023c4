//! `switch`: two processes on one core yield to each other, and do nothing else.

use std::{
    future::Future,
    sync::{
        Arc,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use luna_benches::{
    executors::{Executor, Smol, Tokio},
    harness::{Case, on_core, one_core, run},
    ours::Luna,
    processes::yielding,
};

fn switch<E: Executor, Y: Future + Send + 'static>(
    yield_now: impl Fn() -> Y + Copy + Send + Sync + 'static,
    switches: u64,
) -> Duration {
    let core = one_core();
    on_core(core, || {
        let executor = E::new(core);
        let counts: [Arc<AtomicU64>; 2] = Default::default();
        let [one, other] = counts;
        let first = executor.spawn(yielding(yield_now, one.clone(), other.clone(), switches));
        let second = executor.spawn(yielding(yield_now, other, one, switches));
        executor.block_on(async {
            let elapsed = first.await;
            second.await;
            elapsed
        })
    })
}

/// Two threads under the policy of the caller. The kernel may let a thread that yields run on, so a thread yields until
/// it was switched away and back: the figure is per switch obtained.
fn switch_threads(switches: u64) -> Duration {
    /// Returns when `turns` turns were had.
    fn take_turns(whose: &AtomicUsize, me: usize, turns: u64) {
        for _ in 0..turns {
            while whose.load(Ordering::Acquire) != me {
                thread::yield_now();
            }
            whose.store(1 - me, Ordering::Release);
        }
    }

    on_core(one_core(), || {
        let whose = AtomicUsize::new(0);
        let turns = switches / 2 + 1;
        let warm_up = turns / 16 + 1;
        thread::scope(|scope| {
            scope.spawn(|| take_turns(&whose, 1, warm_up + turns));
            take_turns(&whose, 0, warm_up);
            let start = Instant::now();
            take_turns(&whose, 0, turns);
            start.elapsed()
        })
    })
}

fn case(peer: &'static str, block: impl FnMut(u64) -> Duration + 'static) -> Case {
    Case::new("switch", peer, "ns/switch", block)
}

fn main() {
    let luna = |switches| switch::<Luna, _>(luna::yield_now, switches);
    let tokio = |switches| switch::<Tokio, _>(tokio::task::yield_now, switches);
    let smol = |switches| switch::<Smol, _>(futures_lite::future::yield_now, switches);
    run(
        "switch",
        vec![
            case("LUNA", luna),
            case("tokio yield_now, spawn", tokio),
            case("futures-lite yield_now, smol LocalExecutor", smol),
            case("std::thread::yield_now, threads", switch_threads),
        ],
    );
}

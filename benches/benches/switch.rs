//! `switch`: two processes on one core only yield to each other; and one process wakes itself, and
//! runs.

use std::{
    future::{Future, poll_fn},
    sync::{
        Arc,
        atomic::{AtomicU64, AtomicUsize, Ordering},
    },
    task::Poll,
    thread,
    time::{Duration, Instant},
};

use luna_benches::{
    cores::{on_core, one_core},
    executors::{Executor, Smol, Tokio, on_one_core},
    external,
    harness::{Case, Goal, run},
    ours::Luna,
    primitives,
    processes::{warm_up, yielding},
};

fn switch<E: Executor, Y: Future + Send + 'static>(
    yield_now: impl Fn() -> Y + Copy + Send + Sync + 'static,
    switches: u64,
) -> Duration {
    on_one_core(|executor: &E| {
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

/// Two threads under the caller's policy. The kernel may let a thread that yields continue, so a
/// thread yields until it was switched away and back: the figure is per actual switch.
fn switch_threads(switches: u64) -> Duration {
    /// Returns when `turns` turns were had.
    fn take_turns(turn: &AtomicUsize, me: usize, turns: u64) {
        for _ in 0..turns {
            while turn.load(Ordering::Acquire) != me {
                thread::yield_now();
            }
            turn.store(1 - me, Ordering::Release);
        }
    }

    on_core(one_core(), || {
        let turn = AtomicUsize::new(0);
        let turns = switches / 2 + 1;
        let warm_up = turns / 16 + 1;
        thread::scope(|scope| {
            scope.spawn(|| take_turns(&turn, 1, warm_up + turns));
            take_turns(&turn, 0, warm_up);
            let start = Instant::now();
            take_turns(&turn, 0, turns);
            start.elapsed()
        })
    })
}

/// A process alone that yields, in whatever way.
fn alone<E: Executor, Y: Future + Send + 'static>(
    again: impl Fn() -> Y + Copy + Send + Sync + 'static,
    runs: u64,
) -> Duration {
    on_one_core(|executor: &E| {
        let process = executor.spawn(async move {
            for _ in 0..warm_up(runs) {
                again().await;
            }
            let start = Instant::now();
            for _ in 0..runs {
                again().await;
            }
            start.elapsed()
        });
        executor.block_on(process)
    })
}

/// Wakes the process in which it is polled, by its waker; done when it is polled again.
fn self_wake() -> impl Future<Output = ()> + Send {
    let mut woken = false;
    poll_fn(move |context| {
        if woken {
            return Poll::Ready(());
        }
        woken = true;
        context.waker().wake_by_ref();
        Poll::Pending
    })
}

const SWITCH: &str = "switch";
const SELF_WAKE: &str = "self-wake";

fn case(peer: &'static str, block: impl FnMut(u64) -> Duration + 'static) -> Case {
    Case::new(SWITCH, peer, "ns/switch", block)
}

fn woken(peer: &'static str, block: impl FnMut(u64) -> Duration + 'static) -> Case {
    Case::new(SELF_WAKE, peer, "ns/run", block)
}

fn main() {
    let luna = |switches| switch::<Luna, _>(luna::yield_now, switches);
    let tokio = |switches| switch::<Tokio, _>(tokio::task::yield_now, switches);
    let smol = |switches| switch::<Smol, _>(futures_lite::future::yield_now, switches);
    let mut cases = vec![
        case("LUNA", luna).goal(Goal::AtMost(10.0)),
        case("tokio yield_now, spawn", tokio),
        case("futures-lite yield_now, smol LocalExecutor", smol),
        case("std::thread::yield_now, threads", switch_threads),
    ];
    cases.extend(external::cases(SWITCH, "ns/switch", "switch", None));
    cases.extend([
        woken("LUNA, its waker", |runs| alone::<Luna, _>(self_wake, runs)).goal(Goal::AtMost(8.0)),
        woken("LUNA, yield_now", |runs| {
            alone::<Luna, _>(luna::yield_now, runs)
        }),
        woken("tokio, spawn", |runs| alone::<Tokio, _>(self_wake, runs)),
        woken("smol LocalExecutor", |runs| {
            alone::<Smol, _>(self_wake, runs)
        }),
    ]);
    cases.extend(primitives::one_core_cases());
    run("switch", cases);
}

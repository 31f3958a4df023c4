//! `commstime`: four processes on one core pass a number round, and a consumer sees each round.
//!
//! ```text
//!   prefix ──a──▶ delta ──b──▶ successor
//!     ▲             └──d──▶ consumer │
//!     └──────────────c───────────────┘
//! ```
//!
//! A cycle is four communications and little else. Delta is sequential: first to the consumer, then to the successor.

use std::time::Duration;

use luna_benches::{
    channels::{AsyncChannel, Channel, Crossbeam, Flume, Kanal, TokioMpsc},
    executors::{Executor, Smol, Threads, Tokio, TokioLocal},
    harness::{Case, on_core, one_core, run},
    ours::{Luna, LunaChannel},
    processes::{consumer, delta, prefix, successor},
};

fn commstime<E: Executor, C: Channel>(cycles: u64) -> Duration {
    let core = one_core();
    on_core(core, || {
        let executor = E::new(core);
        let (a, from_prefix) = C::new_pair();
        let (b, to_successor) = C::new_pair();
        let (c, from_successor) = C::new_pair();
        let (d, to_consumer) = C::new_pair();
        let prefix = executor.spawn(prefix(from_successor, a));
        let delta = executor.spawn(delta(from_prefix, d, b));
        let successor = executor.spawn(successor(to_successor, c));
        let consumer = executor.spawn(consumer(to_consumer, cycles));
        executor.block_on(async {
            let elapsed = consumer.await;
            prefix.await;
            delta.await;
            successor.await;
            elapsed
        })
    })
}

fn case<E: Executor, C: Channel>(peer: &'static str) -> Case {
    Case::new("commstime", peer, "ns/cycle", commstime::<E, C>)
}

// For flume and kanal tokio's `LocalSet` is as good as plain `spawn`, and better than smol's executor, which takes 1.4
// and 1.9 times as long. async-channel stands for the smol family, though it too is faster (1.3 times) on tokio.
fn main() {
    run(
        "commstime",
        vec![
            case::<Luna, LunaChannel>("LUNA"),
            case::<Tokio, TokioMpsc>("tokio mpsc(1), spawn"),
            case::<TokioLocal, Flume>("flume bounded(0), tokio LocalSet"),
            case::<TokioLocal, Kanal>("kanal bounded_async(0), tokio LocalSet"),
            case::<Smol, AsyncChannel>("async-channel bounded(1), smol LocalExecutor"),
            case::<Threads, Crossbeam>("crossbeam bounded(0), threads"),
        ],
    );
}

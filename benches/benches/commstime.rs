//! `commstime`: four processes on one core pass a number round, and a consumer receives it in each
//! round.
//!
//! ```text
//!   prefix ──a──▶ delta ──b──▶ successor
//!     ▲             └──d──▶ consumer │
//!     └──────────────c───────────────┘
//! ```
//!
//! A cycle is four communications and little else. Delta is sequential (first to the consumer, then
//! to the successor) or parallel, by hand.
//!
//! *As generated* is the network that a code generator makes from a drawing (table 3 of the paper
//! on LUNA, Wilterdink et al., 2011): readers and writers are separate processes, connected by
//! channels. There are ten: reader and writer of prefix; reader and two writers of delta; reader,
//! increment and writer of successor; reader and consumer. A cycle is ten communications.

use std::{future::Future, time::Duration};

use luna_benches::{
    channels::{AsyncChannel, Channel, Crossbeam, Flume, Kanal, TokioMpsc},
    executors::{Executor, Smol, Threads, Tokio, TokioLocal, on_one_core},
    external,
    harness::{Case, Goal, run},
    networks::commstime,
    ours::{self, Luna, LunaChannel, LunaThreads, LunaWithDeadlines},
    primitives,
    processes::{consumer, delta, parallel_delta, pong, prefix, successor},
};

const SEQUENTIAL: &str = "commstime";
const PARALLEL: &str = "commstime, parallel delta";
const GENERATED: &str = "commstime, as generated";
const UNIT: &str = "ns/cycle";

/// The network with a delta of whatever kind.
fn network<E: Executor, C: Channel, D: Future<Output = ()> + Send + 'static>(
    delta: impl FnOnce(C::Receiver, C::Sender, C::Sender) -> D + Send,
    cycles: u64,
) -> Duration {
    on_one_core(|executor: &E| commstime::<E, C, D>(executor, delta, cycles))
}

fn generated<E: Executor, C: Channel>(cycles: u64) -> Duration {
    on_one_core(|executor: &E| {
        // The network's channels, as above, and those between the parts of each of its processes.
        let (a, from_prefix) = C::new_pair();
        let (b, to_successor) = C::new_pair();
        let (c, from_successor) = C::new_pair();
        let (d, to_consumer) = C::new_pair();
        let (prefix_read, prefix_write) = C::new_pair();
        let (first, first_write) = C::new_pair();
        let (second, second_write) = C::new_pair();
        let (successor_read, increment) = C::new_pair();
        let (incremented, successor_write) = C::new_pair();
        let (consumer_read, analysis) = C::new_pair();

        executor.start(pong(from_successor, prefix_read));
        executor.start(prefix(prefix_write, a));
        executor.start(delta(from_prefix, first, second));
        executor.start(pong(first_write, d));
        executor.start(pong(second_write, b));
        executor.start(pong(to_successor, successor_read));
        executor.start(successor(increment, incremented));
        executor.start(pong(successor_write, c));
        executor.start(pong(to_consumer, consumer_read));
        let consumer = executor.spawn(consumer(analysis, cycles));
        executor.block_on(consumer)
    })
}

fn sequential<E: Executor, C: Channel>(peer: &'static str) -> Case {
    let block = network::<E, C, _>;
    Case::new(SEQUENTIAL, peer, UNIT, move |cycles| block(delta, cycles))
}

fn parallel<E: Executor, C: Channel>(peer: &'static str) -> Case {
    let block = network::<E, C, _>;
    Case::new(PARALLEL, peer, UNIT, move |cycles| {
        block(parallel_delta, cycles)
    })
}

fn as_generated<E: Executor, C: Channel>(peer: &'static str) -> Case {
    Case::new(GENERATED, peer, UNIT, generated::<E, C>)
}

const TOKIO: &str = "tokio mpsc(1), spawn";
const FLUME: &str = "flume bounded(0), tokio LocalSet";
const KANAL: &str = "kanal bounded_async(0), tokio LocalSet";
const ASYNC_CHANNEL: &str = "async-channel bounded(1), smol LocalExecutor";
const CROSSBEAM: &str = "crossbeam bounded(0), threads";

// For flume and kanal tokio's `LocalSet` is as fast as plain `spawn`, and faster than smol's
// executor, which takes 1.4 and 1.9 times as long. async-channel represents the smol family,
// although it is faster (1.3 times) on tokio too.
fn main() {
    let mut cases = vec![
        sequential::<Luna, LunaChannel>("LUNA").goal(Goal::AtMost(34.0)),
        sequential::<LunaWithDeadlines, LunaChannel>(
            "LUNA, a 1 kHz loop and 100 timeouts beside it",
        ),
        sequential::<LunaThreads, LunaChannel>("LUNA, OS threads"),
        sequential::<Tokio, TokioMpsc>(TOKIO),
        sequential::<TokioLocal, Flume>(FLUME),
        sequential::<TokioLocal, Kanal>(KANAL),
        sequential::<Smol, AsyncChannel>(ASYNC_CHANNEL),
        sequential::<Threads, Crossbeam>(CROSSBEAM),
    ];
    cases.extend(external::cases(SEQUENTIAL, UNIT, "commstime", None));
    cases.extend([
        Case::new(PARALLEL, "LUNA", UNIT, |cycles| {
            network::<Luna, LunaChannel, _>(ours::parallel_delta, cycles)
        }),
        parallel::<Tokio, TokioMpsc>(TOKIO),
        parallel::<TokioLocal, Flume>(FLUME),
        parallel::<TokioLocal, Kanal>(KANAL),
        parallel::<Smol, AsyncChannel>(ASYNC_CHANNEL),
    ]);
    cases.extend(external::cases(PARALLEL, UNIT, "commstime-parallel", None));
    cases.extend([
        as_generated::<Luna, LunaChannel>("LUNA"),
        as_generated::<LunaThreads, LunaChannel>("LUNA, OS threads"),
        as_generated::<Tokio, TokioMpsc>(TOKIO),
        as_generated::<TokioLocal, Flume>(FLUME),
        as_generated::<TokioLocal, Kanal>(KANAL),
        as_generated::<Smol, AsyncChannel>(ASYNC_CHANNEL),
        as_generated::<Threads, Crossbeam>(CROSSBEAM),
    ]);
    cases.extend(primitives::one_core_cases());
    run("commstime", cases);
}

//! `fan`: many senders share one channel to one receiver (fan-in), and one sender serves many
//! receivers of one channel (fan-out), all on one core.

use std::time::Duration;

use luna_benches::{
    channels::{AsyncChannel, Channel, Crossbeam, Flume, Kanal, TokioMpsc},
    executors::{Executor, Smol, Threads, Tokio, TokioLocal, on_one_core},
    harness::{Case, is_quick, run},
    ours::{Luna, LunaChannel},
    primitives,
    processes::{counter, producer, sink, source},
};

const IN: &str = "fan-in";
const OUT: &str = "fan-out";
const UNIT: &str = "ns/message";

/// How many share the channel; the limit of threads.
fn sizes() -> &'static [u64] {
    if is_quick() {
        &[1, 8, 64]
    } else {
        &[1, 8, 64, 512, 4_096]
    }
}

const MAX_THREADS: u64 = 64;

fn fan_in<E: Executor, C: Channel>(senders: u64, messages: u64) -> Duration {
    on_one_core(|executor: &E| {
        let (output, input) = C::new_pair();
        for _ in 1..senders {
            executor.start(producer(output.clone()));
        }
        executor.start(producer(output));
        let counter = executor.spawn(counter(input, messages));
        executor.block_on(counter)
    })
}

fn fan_out<E: Executor, C: Channel>(receivers: u64, messages: u64) -> Duration
where
    C::Receiver: Clone,
{
    on_one_core(|executor: &E| {
        let (output, input) = C::new_pair();
        for _ in 1..receivers {
            executor.start(sink(input.clone()));
        }
        executor.start(sink(input));
        let source = executor.spawn(source(output, messages));
        executor.block_on(source)
    })
}

fn case_in<E: Executor, C: Channel>(peer: &'static str, size: u64) -> Case {
    let block = move |messages| fan_in::<E, C>(size, messages);
    Case::new(IN, peer, UNIT, block).size(size)
}

fn case_out<E: Executor, C: Channel>(peer: &'static str, size: u64) -> Case
where
    C::Receiver: Clone,
{
    let block = move |messages| fan_out::<E, C>(size, messages);
    Case::new(OUT, peer, UNIT, block).size(size)
}

const FLUME: &str = "flume bounded(0), tokio LocalSet";
const KANAL: &str = "kanal bounded_async(0), tokio LocalSet";
const ASYNC_CHANNEL: &str = "async-channel bounded(1), smol LocalExecutor";
const CROSSBEAM: &str = "crossbeam bounded(0), threads";

fn main() {
    let mut cases = Vec::new();
    for &size in sizes() {
        cases.extend([
            case_in::<Luna, LunaChannel>("LUNA", size),
            case_in::<Tokio, TokioMpsc>("tokio mpsc(1), spawn", size),
            case_in::<TokioLocal, Flume>(FLUME, size),
            case_in::<TokioLocal, Kanal>(KANAL, size),
            case_in::<Smol, AsyncChannel>(ASYNC_CHANNEL, size),
        ]);
        if size <= MAX_THREADS {
            cases.push(case_in::<Threads, Crossbeam>(CROSSBEAM, size));
        }
    }
    // tokio's receivers cannot be shared.
    for &size in sizes() {
        cases.extend([
            case_out::<Luna, LunaChannel>("LUNA", size),
            case_out::<TokioLocal, Flume>(FLUME, size),
            case_out::<TokioLocal, Kanal>(KANAL, size),
            case_out::<Smol, AsyncChannel>(ASYNC_CHANNEL, size),
        ]);
        if size <= MAX_THREADS {
            cases.push(case_out::<Threads, Crossbeam>(CROSSBEAM, size));
        }
    }
    cases.extend(primitives::one_core_cases());
    run("fan", cases);
}

//! `rendezvous`: a producer sends numbers to a consumer, on one core and on two; and on two, back and forth.
//!
//! On two cores each process has an executor and a thread of its own, pinned.

use std::{future::Future, time::Duration};

use core_affinity::CoreId;
use luna_benches::{
    channels::{
        AsyncChannel, Channel, Crossbeam, Flume, Kanal, KanalBlocking, SyncChannel, TokioMpsc,
    },
    executors::{Executor, Smol, Threads, Tokio, TokioLocal},
    harness::{Case, on_core, on_cores, one_core, run, two_cores},
    ours::{Luna, LunaChannel},
    processes::{consumer, ping, pong, producer},
};

const ONE_CORE: &str = "rendezvous, one core";
const TWO_CORES: &str = "rendezvous, two cores";
const PING_PONG: &str = "ping-pong, two cores";

fn one_core_stream<E: Executor, C: Channel>(messages: u64) -> Duration {
    let core = one_core();
    on_core(core, || {
        let executor = E::new(core);
        let (output, input) = C::new_pair();
        let producer = executor.spawn(producer(output));
        let consumer = executor.spawn(consumer(input, messages));
        executor.block_on(async {
            let elapsed = consumer.await;
            producer.await;
            elapsed
        })
    })
}

fn two_core_stream<E: Executor, C: Channel>(cores: [CoreId; 2], messages: u64) -> Duration {
    let (output, input) = C::new_pair();
    on_cores(
        cores,
        || alone::<E, _>(cores[0], producer(output)),
        || alone::<E, _>(cores[1], consumer(input, messages)),
    )
}

fn ping_pong<E: Executor, C: Channel>(cores: [CoreId; 2], round_trips: u64) -> Duration {
    let (out, from_ping) = C::new_pair();
    let (back, from_pong) = C::new_pair();
    on_cores(
        cores,
        || alone::<E, _>(cores[0], pong(from_ping, back)),
        || alone::<E, _>(cores[1], ping(out, from_pong, round_trips)),
    )
}

/// Runs one process on an executor of its own.
fn alone<E: Executor, T: Send + 'static>(
    core: CoreId,
    process: impl Future<Output = T> + Send + 'static,
) -> T {
    let executor = E::new(core);
    let process = executor.spawn(process);
    executor.block_on(process)
}

fn on_one<E: Executor, C: Channel>(peer: &'static str) -> Case {
    Case::new(ONE_CORE, peer, "ns/message", one_core_stream::<E, C>)
}

/// Both scenarios on two cores: the stream, and back and forth.
fn on_two<E: Executor, C: Channel>(cores: [CoreId; 2], peer: &'static str) -> (Case, Case) {
    let stream = move |messages| two_core_stream::<E, C>(cores, messages);
    let ping_pong = move |round_trips| ping_pong::<E, C>(cores, round_trips);
    (
        Case::new(TWO_CORES, peer, "ns/message", stream),
        Case::new(PING_PONG, peer, "ns/round trip", ping_pong),
    )
}

fn main() {
    let mut cases = vec![
        on_one::<Luna, LunaChannel>("LUNA"),
        on_one::<Tokio, TokioMpsc>("tokio mpsc(1), spawn"),
        on_one::<TokioLocal, Flume>("flume bounded(0), tokio LocalSet"),
        on_one::<TokioLocal, Kanal>("kanal bounded_async(0), tokio LocalSet"),
        on_one::<Smol, AsyncChannel>("async-channel bounded(1), smol LocalExecutor"),
        on_one::<Threads, Crossbeam>("crossbeam bounded(0), threads"),
    ];
    if let Some(cores) = two_cores() {
        let (streams, ping_pongs): (Vec<_>, Vec<_>) = [
            on_two::<Luna, LunaChannel>(cores, "LUNA"),
            on_two::<Tokio, TokioMpsc>(cores, "tokio mpsc(1), spawn"),
            on_two::<TokioLocal, Flume>(cores, "flume bounded(0), tokio LocalSet"),
            on_two::<TokioLocal, Kanal>(cores, "kanal bounded_async(0), tokio LocalSet"),
            on_two::<Smol, AsyncChannel>(cores, "async-channel bounded(1), smol LocalExecutor"),
            on_two::<Threads, Crossbeam>(cores, "crossbeam bounded(0), threads"),
            on_two::<Threads, SyncChannel>(cores, "std sync_channel(0), threads"),
            on_two::<Threads, KanalBlocking>(cores, "kanal bounded(0), threads that spin"),
        ]
        .into_iter()
        .unzip();
        cases.extend(streams);
        cases.extend(ping_pongs);
    } else {
        println!("one core is usable: \"{TWO_CORES}\" and \"{PING_PONG}\" are left out");
    }
    run("rendezvous", cases);
}

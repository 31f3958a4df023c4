//! `buffered`: a producer sends numbers to a consumer through a buffer of 64, on one core and on
//! two.
//!
//! The producer waits when the buffer is full, the consumer when it is empty. A side that *spins*
//! polls for a bounded time before it sleeps, as crossbeam's threads do too.

use core_affinity::CoreId;
use luna_benches::{
    channels::{AsyncChannel, Channel, Crossbeam, Flume, Kanal, SyncChannel, TokioMpsc},
    cores::two_cores,
    executors::{Executor, Smol, Threads, Tokio, TokioLocal},
    external,
    harness::{Case, run},
    networks::{one_core_stream, two_core_stream},
    ours::{Luna, LunaChannel, LunaThatSpins, LunaThreads, LunaThreadsThatSpin},
    primitives,
};

const CAPACITY: usize = 64;
const ONE_CORE: &str = "buffer of 64, one core";
const TWO_CORES: &str = "buffer of 64, two cores";
const UNIT: &str = "ns/message";

fn on_one<E: Executor, C: Channel>(peer: &'static str) -> Case {
    let block = |messages| one_core_stream::<E, C>(|| C::buffered(CAPACITY), messages);
    Case::new(ONE_CORE, peer, UNIT, block)
}

fn on_two<E: Executor, C: Channel>(cores: [CoreId; 2], peer: &'static str) -> Case {
    let block = move |messages| two_core_stream::<E, E, C>(cores, C::buffered(CAPACITY), messages);
    Case::new(TWO_CORES, peer, UNIT, block)
}

const TOKIO: &str = "tokio mpsc, spawn";
const FLUME: &str = "flume bounded, tokio LocalSet";
const KANAL: &str = "kanal bounded_async, tokio LocalSet";
const ASYNC_CHANNEL: &str = "async-channel bounded, smol LocalExecutor";
const CROSSBEAM: &str = "crossbeam bounded, threads";
const STD: &str = "std sync_channel, threads";

fn main() {
    let mut cases = vec![
        on_one::<Luna, LunaChannel>("LUNA"),
        on_one::<LunaThreads, LunaChannel>("LUNA, OS threads"),
        on_one::<Tokio, TokioMpsc>(TOKIO),
        on_one::<TokioLocal, Flume>(FLUME),
        on_one::<TokioLocal, Kanal>(KANAL),
        on_one::<Smol, AsyncChannel>(ASYNC_CHANNEL),
        on_one::<Threads, Crossbeam>(CROSSBEAM),
        on_one::<Threads, SyncChannel>(STD),
    ];
    let elsewhere = external::cases(ONE_CORE, UNIT, "buffered", Some(CAPACITY as u64));
    cases.extend(elsewhere.into_iter().map(|mut case| {
        // It is the buffer's, which is in the name.
        case.size = None;
        case
    }));
    cases.extend(primitives::one_core_cases());
    match two_cores() {
        Some(cores) => cases.extend([
            on_two::<Luna, LunaChannel>(cores, "LUNA"),
            on_two::<LunaThreads, LunaChannel>(cores, "LUNA, OS threads"),
            on_two::<LunaThatSpins, LunaChannel>(cores, "LUNA, executors that spin"),
            on_two::<LunaThreadsThatSpin, LunaChannel>(cores, "LUNA, OS threads that spin"),
            on_two::<Tokio, TokioMpsc>(cores, TOKIO),
            on_two::<TokioLocal, Flume>(cores, FLUME),
            on_two::<TokioLocal, Kanal>(cores, KANAL),
            on_two::<Smol, AsyncChannel>(cores, ASYNC_CHANNEL),
            on_two::<Threads, Crossbeam>(cores, CROSSBEAM),
            on_two::<Threads, SyncChannel>(cores, STD),
        ]),
        None => println!("one core is usable: \"{TWO_CORES}\" is left out"),
    }
    run("buffered", cases);
}

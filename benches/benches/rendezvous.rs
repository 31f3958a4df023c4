//! `rendezvous`: a producer sends numbers to a consumer, or back and forth; on one core and on two;
//! processes of executors, OS threads, and one of each.
//!
//! On two cores each process has an executor and a thread of its own, pinned. *Asleep*: a waiting
//! side lets its core sleep, so the kernel's wake-up is measured; with `/dev/cpu_dma_latency` at 0
//! a core does not sleep deeply. *Awake*: each executor has a second process that can always run;
//! or it *spins*: it polls for its partner for a bounded time before it sleeps.

use std::{
    future::Future,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use core_affinity::CoreId;
use luna_benches::{
    channels::{
        AsyncChannel, Channel, Crossbeam, Flume, Kanal, KanalBlocking, SyncChannel, TokioMpsc,
    },
    cores::{on_cores, one_core, two_cores},
    executors::{Executor, Smol, Threads, Tokio, TokioLocal},
    external,
    harness::{Case, Goal, run},
    networks::{alone, one_core_stream, two_core_stream},
    ours::{Luna, LunaChannel, LunaThatSpins, LunaThreads, LunaThreadsThatSpin},
    primitives::{self, FUTEX, SPIN, ShortWakeUps},
    processes::{busy, consumer, ping, pong, producer},
};

const ONE_CORE: &str = "rendezvous, one core";
const FUTEX_ON_ONE: &str = "futex back and forth, one core";
const TWO_CORES: &str = "rendezvous, two cores, asleep";
const AWAKE: &str = "rendezvous, two cores, awake";
const SPIN_ON_TWO: &str = "spin back and forth, two cores";
const PING_PONG: &str = "ping-pong, two cores, asleep";
const PING_PONG_SHORT: &str = "ping-pong, two cores, asleep, cpu_dma_latency 0";

const PER_MESSAGE: &str = "ns/message";
const PER_TRIP: &str = "ns/round trip";

fn ping_pong<P: Executor, E: Executor, C: Channel>(
    cores: [CoreId; 2],
    round_trips: u64,
) -> Duration {
    let (out, from_ping) = C::between_executors(C::new_pair());
    let (back, from_pong) = C::between_executors(C::new_pair());
    on_cores(
        cores,
        || alone::<P, _>(cores[0], pong(from_ping, back)),
        || alone::<E, _>(cores[1], ping(out, from_pong, round_trips)),
    )
}

fn awake<E: Executor, C: Channel>(cores: [CoreId; 2], messages: u64) -> Duration {
    let (output, input) = C::between_executors(C::new_pair());
    let over = Arc::new(AtomicBool::new(false));
    let (sending, receiving) = (over.clone(), over);
    on_cores(
        cores,
        || beside_busy::<E, _>(cores[0], producer(output), sending),
        || beside_busy::<E, _>(cores[1], consumer(input, messages), receiving),
    )
}

/// Runs one process on an executor with a second one that is always running, until it is `over` on
/// either side.
fn beside_busy<E: Executor, T: Send + 'static>(
    core: CoreId,
    process: impl Future<Output = T> + Send + 'static,
    over: Arc<AtomicBool>,
) -> T {
    let executor = E::new(core);
    let ended = over.clone();
    let process = executor.spawn(async move {
        let result = process.await;
        ended.store(true, Ordering::Relaxed);
        result
    });
    let busy = executor.spawn(busy(E::yield_now, over));
    executor.block_on(async {
        let result = process.await;
        busy.await;
        result
    })
}

fn on_one<E: Executor, C: Channel>(peer: &'static str) -> Case {
    let block = |messages| one_core_stream::<E, C>(C::new_pair, messages);
    Case::new(ONE_CORE, peer, PER_MESSAGE, block)
}

fn on_two<P: Executor, E: Executor, C: Channel>(cores: [CoreId; 2], peer: &'static str) -> Case {
    let block = move |messages| two_core_stream::<P, E, C>(cores, C::new_pair(), messages);
    Case::new(TWO_CORES, peer, PER_MESSAGE, block)
}

fn both_awake<E: Executor, C: Channel>(cores: [CoreId; 2], peer: &'static str) -> Case {
    let block = move |messages| awake::<E, C>(cores, messages);
    Case::new(AWAKE, peer, PER_MESSAGE, block)
}

/// Awake since both look for each other before they sleep.
fn both_spin<E: Executor, C: Channel>(cores: [CoreId; 2], peer: &'static str) -> Case {
    let block = move |messages| two_core_stream::<E, E, C>(cores, C::new_pair(), messages);
    Case::new(AWAKE, peer, PER_MESSAGE, block)
}

fn back_and_forth<P: Executor, E: Executor, C: Channel>(
    cores: [CoreId; 2],
    peer: &'static str,
) -> Case {
    let block = move |round_trips| ping_pong::<P, E, C>(cores, round_trips);
    Case::new(PING_PONG, peer, PER_TRIP, block)
}

/// The same scenario with cores that sleep lightly.
fn short<P: Executor, E: Executor, C: Channel>(cores: [CoreId; 2], peer: &'static str) -> Case {
    Case::new(PING_PONG_SHORT, peer, PER_TRIP, move |round_trips| {
        let _held = ShortWakeUps::hold();
        ping_pong::<P, E, C>(cores, round_trips)
    })
}

fn times(factor: f64, name: &'static str, peer: &'static str, of: &'static str) -> Goal {
    Goal::Times {
        factor,
        name,
        peer,
        size: None,
        of,
    }
}

const TOKIO: &str = "tokio mpsc(1), spawn";
const FLUME: &str = "flume bounded(0), tokio LocalSet";
const KANAL: &str = "kanal bounded_async(0), tokio LocalSet";
const ASYNC_CHANNEL: &str = "async-channel bounded(1), smol LocalExecutor";
const CROSSBEAM: &str = "crossbeam bounded(0), threads";
const STD: &str = "std sync_channel(0), threads";
const SPINNING: &str = "kanal bounded(0), threads that spin";

fn one_core_cases() -> Vec<Case> {
    let core = one_core();
    let half = times(
        1.15 / 2.0,
        FUTEX_ON_ONE,
        FUTEX,
        "the bare futex' round trip on one core (1.15 × half of it)",
    );
    let mut cases = vec![
        on_one::<Luna, LunaChannel>("LUNA"),
        on_one::<LunaThreads, LunaChannel>("LUNA, OS threads").goal(half),
        Case::new(
            ONE_CORE,
            "LUNA, executor to OS thread",
            PER_MESSAGE,
            move |messages| {
                let channel = LunaChannel::new_pair();
                two_core_stream::<Luna, LunaThreads, LunaChannel>([core; 2], channel, messages)
            },
        ),
        on_one::<Tokio, TokioMpsc>(TOKIO),
        on_one::<TokioLocal, Flume>(FLUME),
        on_one::<TokioLocal, Kanal>(KANAL),
        on_one::<Smol, AsyncChannel>(ASYNC_CHANNEL),
        on_one::<Threads, Crossbeam>(CROSSBEAM),
        on_one::<Threads, SyncChannel>(STD),
    ];
    cases.extend(external::cases(ONE_CORE, PER_MESSAGE, "rendezvous", None));
    cases.extend(primitives::one_core_cases());
    cases.push(Case::new(
        FUTEX_ON_ONE,
        FUTEX,
        PER_TRIP,
        move |round_trips| primitives::futex([core; 2], round_trips),
    ));
    cases
}

fn two_core_cases(cores: [CoreId; 2]) -> Vec<Case> {
    let spinning = || times(1.5, SPIN_ON_TWO, SPIN, "the bare spin's round trip");
    let sleeping = |name| times(1.1, name, FUTEX, "the bare futex' round trip");
    let mut cases = vec![
        on_two::<Luna, Luna, LunaChannel>(cores, "LUNA"),
        on_two::<LunaThreads, LunaThreads, LunaChannel>(cores, "LUNA, OS threads"),
        on_two::<Luna, LunaThreads, LunaChannel>(cores, "LUNA, executor to OS thread"),
        on_two::<Tokio, Tokio, TokioMpsc>(cores, TOKIO),
        on_two::<TokioLocal, TokioLocal, Flume>(cores, FLUME),
        on_two::<TokioLocal, TokioLocal, Kanal>(cores, KANAL),
        on_two::<Smol, Smol, AsyncChannel>(cores, ASYNC_CHANNEL),
        on_two::<Threads, Threads, Crossbeam>(cores, CROSSBEAM),
        on_two::<Threads, Threads, SyncChannel>(cores, STD),
        on_two::<Threads, Threads, KanalBlocking>(cores, SPINNING),
        both_awake::<Luna, LunaChannel>(cores, "LUNA").goal(spinning()),
        both_spin::<LunaThatSpins, LunaChannel>(cores, "LUNA, executors that spin")
            .goal(spinning()),
        both_spin::<LunaThreadsThatSpin, LunaChannel>(cores, "LUNA, OS threads that spin")
            .goal(spinning()),
        both_spin::<Threads, KanalBlocking>(cores, SPINNING),
        both_awake::<Tokio, TokioMpsc>(cores, TOKIO),
        both_awake::<TokioLocal, Flume>(cores, FLUME),
        both_awake::<TokioLocal, Kanal>(cores, KANAL),
        both_awake::<Smol, AsyncChannel>(cores, ASYNC_CHANNEL),
        Case::new(SPIN_ON_TWO, SPIN, PER_TRIP, move |round_trips| {
            primitives::spin(cores, round_trips)
        }),
        back_and_forth::<Luna, Luna, LunaChannel>(cores, "LUNA").goal(sleeping(PING_PONG)),
        back_and_forth::<LunaThreads, LunaThreads, LunaChannel>(cores, "LUNA, OS threads")
            .goal(sleeping(PING_PONG)),
        back_and_forth::<Luna, LunaThreads, LunaChannel>(cores, "LUNA, executor and OS thread"),
        back_and_forth::<Tokio, Tokio, TokioMpsc>(cores, TOKIO),
        back_and_forth::<TokioLocal, TokioLocal, Flume>(cores, FLUME),
        back_and_forth::<TokioLocal, TokioLocal, Kanal>(cores, KANAL),
        back_and_forth::<Smol, Smol, AsyncChannel>(cores, ASYNC_CHANNEL),
        back_and_forth::<Threads, Threads, Crossbeam>(cores, CROSSBEAM),
        back_and_forth::<Threads, Threads, SyncChannel>(cores, STD),
        back_and_forth::<Threads, Threads, KanalBlocking>(cores, SPINNING),
        Case::new(PING_PONG, FUTEX, PER_TRIP, move |round_trips| {
            primitives::futex(cores, round_trips)
        }),
    ];
    if ShortWakeUps::hold().is_none() {
        println!("/dev/cpu_dma_latency cannot be opened: \"{PING_PONG_SHORT}\" is left out");
        return cases;
    }
    cases.extend([
        short::<Luna, Luna, LunaChannel>(cores, "LUNA").goal(sleeping(PING_PONG_SHORT)),
        short::<LunaThreads, LunaThreads, LunaChannel>(cores, "LUNA, OS threads")
            .goal(sleeping(PING_PONG_SHORT)),
        short::<Tokio, Tokio, TokioMpsc>(cores, TOKIO),
        short::<TokioLocal, TokioLocal, Flume>(cores, FLUME),
        short::<Threads, Threads, Crossbeam>(cores, CROSSBEAM),
        Case::new(PING_PONG_SHORT, FUTEX, PER_TRIP, move |round_trips| {
            let _held = ShortWakeUps::hold();
            primitives::futex(cores, round_trips)
        }),
    ]);
    cases
}

fn main() {
    let mut cases = one_core_cases();
    match two_cores() {
        Some(cores) => cases.extend(two_core_cases(cores)),
        None => println!("one core is usable: what needs two is left out"),
    }
    run("rendezvous", cases);
}

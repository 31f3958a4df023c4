//! `ring`: a number goes round a ring of processes on one core, each of which increments it.
//!
//! A hop is a rendezvous and a switch; the memory that a lap accesses grows with the ring.
//! *Ordered* rings are spawned in the order in which the number passes, so that neighbours are
//! adjacent in memory too; *shuffled* ones in random order.
//!
//! Large rings have an operating-system process for each block, which ends without freeing them.

use std::time::Duration;

use luna_benches::{
    channels::{AsyncChannel, Channel, Flume, Kanal, TokioMpsc},
    executors::{Executor, Smol, Tokio, TokioLocal, on_one_core},
    external,
    harness::{Case, Goal, finish, is_quick, run},
    ours::{Luna, LunaChannel},
    primitives,
    processes::{ring_head, successor},
};

const ORDERED: &str = "ring";
const SHUFFLED: &str = "ring, shuffled";
const UNIT: &str = "ns/hop";

/// Larger rings are measured apart.
const LARGE: u64 = 100_000;

/// How many processes.
fn sizes() -> &'static [u64] {
    if is_quick() {
        &[10, 1_000, 10_000]
    } else {
        &[10, 100, 1_000, 10_000, 100_000, 1_000_000]
    }
}

fn ring<E: Executor, C: Channel>(size: u64, shuffled: bool, hops: u64) -> Duration {
    let laps = hops.div_ceil(size);
    // As long as that many hops take, which are perhaps no whole laps.
    let scale = hops as f64 / (laps * size) as f64;
    on_one_core(|executor: &E| {
        let mut order: Vec<usize> = (0..size as usize).collect();
        if shuffled {
            shuffle(&mut order);
        }
        // Channel `i` leads to process `i`, from the one before it.
        let mut outputs: Vec<_> = order.iter().map(|_| None).collect();
        let mut inputs: Vec<_> = order.iter().map(|_| None).collect();
        let before = |place: usize| (place + order.len() - 1) % order.len();
        for &place in &order {
            let (output, input) = C::new_pair();
            outputs[before(place)] = Some(output);
            inputs[place] = Some(input);
        }
        let mut head = None;
        for &place in &order {
            let input = inputs[place].take().expect("each has one input");
            let output = outputs[place].take().expect("each has one output");
            if place == 0 {
                head = Some(executor.spawn(async move {
                    let elapsed = ring_head(output, input, size - 1, laps).await;
                    let elapsed = elapsed.mul_f64(scale);
                    finish(elapsed);
                    elapsed
                }));
            } else {
                executor.start(successor(input, output));
            }
        }
        executor.block_on(head.expect("a ring has a first process"))
    })
}

/// The same order in each run.
fn shuffle(order: &mut [usize]) {
    let mut state = 88_172_645_463_325_252_u64;
    for last in (1..order.len()).rev() {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        order.swap(last, (state % (last as u64 + 1)) as usize);
    }
}

fn case<E: Executor, C: Channel>(name: &'static str, peer: &'static str, size: u64) -> Case {
    let shuffled = name == SHUFFLED;
    let block = move |hops| ring::<E, C>(size, shuffled, hops);
    let case = Case::new(name, peer, UNIT, block).size(size);
    if size >= LARGE {
        // Building the ring takes longer than some laps: only as many laps as take some tens of
        // milliseconds, and fewer blocks.
        case.exactly(size.max(1_000_000)).blocks(3).apart()
    } else {
        case.at_least(size)
    }
}

fn luna(name: &'static str, size: u64) -> Case {
    let case = case::<Luna, LunaChannel>(name, "LUNA", size);
    match size {
        1_000 | 100_000 => case.goal(Goal::AtMost(8.3)),
        1_000_000 => case.goal(Goal::Times {
            factor: 1.3,
            name,
            peer: "LUNA",
            size: Some(1_000),
            of: "the hop with 1 000 processes",
        }),
        _ => case,
    }
}

fn main() {
    let mut cases = Vec::new();
    for name in [ORDERED, SHUFFLED] {
        for &size in sizes() {
            cases.extend([
                luna(name, size),
                case::<Tokio, TokioMpsc>(name, "tokio mpsc(1), spawn", size),
                case::<TokioLocal, Flume>(name, "flume bounded(0), tokio LocalSet", size),
                case::<TokioLocal, Kanal>(name, "kanal bounded_async(0), tokio LocalSet", size),
                case::<Smol, AsyncChannel>(
                    name,
                    "async-channel bounded(1), smol LocalExecutor",
                    size,
                ),
            ]);
            if name == ORDERED && size < LARGE {
                let elsewhere = external::cases(name, UNIT, "ring", Some(size));
                cases.extend(elsewhere.into_iter().map(|case| case.at_least(size)));
            }
        }
    }
    cases.extend(primitives::one_core_cases());
    run("ring", cases);
}

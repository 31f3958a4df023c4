//! `memory`: the memory of a process with its channel, in a ring of n that has passed a number
//! round once.
//!
//! *Allocated* is what the program holds, counted by its allocator. *Resident* is the peak of what
//! the system has given it since before the ring was made, with the allocator's overhead and
//! temporary memory. It includes the fixed memory of a system: for LUNA room for the statistics of
//! loops, so there is also a row without. Each figure is measured in an operating-system process of
//! its own.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    fs,
    sync::atomic::{AtomicI64, Ordering},
};

use luna_benches::{
    channels::{AsyncChannel, Channel, Flume, Kanal, TokioMpsc},
    cores::{on_core, one_core},
    executors::{Executor, Smol, Tokio, TokioLocal},
    external,
    harness::{Case, Goal, finish_with, is_quick, run},
    ours::{Luna, LunaChannel, LunaWithoutLoops},
    processes::{ring_head, successor},
};

/// Counts the bytes that the program holds.
struct Counting;

static HELD: AtomicI64 = AtomicI64::new(0);

// SAFETY: each call is passed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.fetch_add(layout.size() as i64, Ordering::Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size() as i64, Ordering::Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        HELD.fetch_add(size as i64 - layout.size() as i64, Ordering::Relaxed);
        // SAFETY: as the caller's.
        unsafe { System.realloc(place, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const ALLOCATED: &str = "memory, allocated";
const RESIDENT: &str = "memory, resident";
const UNIT: &str = "bytes/process";

/// How many processes.
fn sizes() -> &'static [u64] {
    if is_quick() {
        &[1_000, 10_000]
    } else {
        &[1_000, 10_000, 100_000, 1_000_000]
    }
}

fn allocated() -> f64 {
    HELD.load(Ordering::Relaxed) as f64
}

/// The most that has ever been resident.
fn resident() -> f64 {
    let status = fs::read_to_string("/proc/self/status").expect("Linux has this file");
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kibibytes = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    kibibytes.expect("it is a number of kB") * 1024.0
}

fn ring<E: Executor, C: Channel>(size: u64, taken: fn() -> f64) -> f64 {
    let core = one_core();
    on_core(core, || {
        let before = taken();
        let executor = E::new(core);
        let (first, mut last) = C::new_pair();
        for _ in 1..size {
            let (output, input) = C::new_pair();
            executor.start(successor(last, output));
            last = input;
        }
        let head = executor.spawn(async move {
            ring_head(first, last, size - 1, 1).await;
            let each = (taken() - before) / size as f64;
            finish_with(each);
            each
        });
        executor.block_on(head)
    })
}

fn case<E: Executor, C: Channel>(name: &'static str, peer: &'static str, size: u64) -> Case {
    let taken = if name == ALLOCATED {
        allocated
    } else {
        resident
    };
    Case::once(name, peer, UNIT, move || ring::<E, C>(size, taken))
        .size(size)
        .blocks(3)
        .apart()
}

fn main() {
    let mut cases = Vec::new();
    for name in [ALLOCATED, RESIDENT] {
        for &size in sizes() {
            let without_loops =
                case::<LunaWithoutLoops, LunaChannel>(name, "LUNA, max_loops(0)", size);
            cases.extend([
                if size >= 10_000 {
                    without_loops.goal(Goal::AtMost(200.0))
                } else {
                    without_loops
                },
                case::<Luna, LunaChannel>(name, "LUNA", size),
                case::<Tokio, TokioMpsc>(name, "tokio mpsc(1), spawn", size),
                case::<TokioLocal, Flume>(name, "flume bounded(0), tokio LocalSet", size),
                case::<TokioLocal, Kanal>(name, "kanal bounded_async(0), tokio LocalSet", size),
                case::<Smol, AsyncChannel>(
                    name,
                    "async-channel bounded(1), smol LocalExecutor",
                    size,
                ),
            ]);
            if name == RESIDENT {
                let elsewhere = external::figures(name, UNIT, "memory", size);
                cases.extend(elsewhere.into_iter().map(|case| case.blocks(3)));
            }
        }
    }
    run("memory", cases);
}

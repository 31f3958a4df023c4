//! Two threads of different priority on one core. The higher one wakes at random instants, wherever
//! the lower one is in its operation, and operates on the same channel, barrier, waker or lock. An
//! operation that spins on the other side's progress hangs here. One that threads in between can
//! delay takes as long as they do. See `docs/internals/proof-tools.md`.
//!
//! `LUNA_LONG=1`: millions of operations. `LUNA_SEED` sets the seed.

#![cfg(target_os = "linux")]

use crate::common;
mod high;
use crate::kernel;
mod low;
mod scenes;
mod shared;
mod stage;
mod two_wakers;
mod watch;

use common::{COMPLETE, Program, has_real_time, is_long, say, seed, skip, watchdog};
use kernel::spoilt;
use luna_platform::thread::{Policy, available_cores};
use scenes::{Scene, controls};
use shared::Shared;
use stage::{PLACEMENTS, Placement, play};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use watch::{Verdict, Watch, abort};

/// How often the high side operates in a scene.
fn rounds() -> u32 {
    if is_long() { 10_000 } else { 100 }
}

/// One of these tests at a time, on one core, so that the machine has another one left.
fn alone() -> MutexGuard<'static, ()> {
    static CORE: Mutex<()> = Mutex::new(());
    CORE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn core() -> usize {
    available_cores()[0]
}

fn cannot_run() -> bool {
    let can = COMPLETE && has_real_time();
    if !can {
        skip("no real-time policies are given here");
    }
    !can
}

/// Plays all scenes with `low` beside SCHED_FIFO 80, the sides at all places.
fn beside(low: Policy, burns: bool) {
    if cannot_run() {
        return;
    }
    let _alone = alone();
    let _watch = watchdog();
    let seed = seed();
    let (mut high_done, mut in_low, mut low_done, mut excused, mut inverted) = (0, 0, 0, 0, 0);
    let mut most_burnt = Duration::ZERO;
    for of_high in PLACEMENTS {
        for of_low in PLACEMENTS {
            let shared = Arc::new(Shared::default());
            let scenes = scenes::all();
            let names: Vec<_> = scenes.iter().map(|scene| scene.name).collect();
            let watch = Watch::start(shared.clone(), names, core(), abort);
            play(
                &shared,
                scenes,
                core(),
                (of_high, of_low),
                low,
                (rounds(), burns, seed),
            );
            drop(watch);
            let violations = shared.violations.lock().unwrap();
            assert!(
                violations.len() as u64 <= spoilt(shared.high.load(Ordering::SeqCst)),
                "high: {of_high:?}, low: {of_low:?}: {violations:#?}"
            );
            for violation in violations.iter() {
                say(&format!(
                    "spoilt: high: {of_high:?}, low: {of_low:?}: {violation}"
                ));
            }
            let load = |count: &std::sync::atomic::AtomicU64| count.load(Ordering::SeqCst);
            assert!(
                load(&shared.high_in_low) > 0,
                "the low side was never interrupted in an operation"
            );
            high_done += load(&shared.high);
            inverted += load(&shared.inverted);
            in_low += load(&shared.high_in_low);
            low_done += load(&shared.low);
            excused += load(&shared.excused);
            let step = Duration::from_nanos(load(&shared.burnt_for))
                .checked_div(load(&shared.burnt) as u32)
                .unwrap_or_default();
            most_burnt = most_burnt.max(step * load(&shared.most_burnt) as u32);
        }
    }
    say(&format!(
        "fifo:80 beside {low}: {high_done} operations, {in_low} of them in the middle of one below; {low_done} below; {excused} not judged, since the core was \
         taken from the high side{}",
        if burns {
            format!("; at most {most_burnt:?} of a fifo:50 in one that waits for nobody")
        } else {
            String::new()
        }
    ));
    assert!(
        inverted <= spoilt(high_done),
        "{inverted} inverted, at most {most_burnt:?}"
    );
}

#[test]
fn fifo_80_beside_fifo_20() {
    own_process!(long);
    beside(Policy::fifo(20), false);
}

#[test]
fn fifo_80_beside_other() {
    own_process!(long);
    beside(Policy::Other, false);
}

#[test]
fn fifo_80_beside_fifo_20_with_fifo_50_in_between() {
    own_process!(long);
    beside(Policy::fifo(20), true);
}

/// What this program does as its own child: it says what the watch has found, and ends.
#[test]
fn part() {
    let scene: Scene = match common::part().as_deref() {
        Some("spin lock") => controls::spin_lock(),
        Some("std rendezvous") => controls::std_rendezvous(),
        _ => return,
    };
    let shared = Arc::new(Shared::default());
    let report = |verdict: Verdict| {
        println!("{verdict}");
        std::process::exit(0);
    };
    let _watch = Watch::start(shared.clone(), vec![scene.name], core(), report);
    // Some twenty seconds.
    let places = (Placement::Plain, Placement::Plain);
    let extent = (400_000, false, seed());
    play(
        &shared,
        vec![scene],
        core(),
        places,
        Policy::fifo(20),
        extent,
    );
    println!(
        "no stall in {} operations",
        shared.high.load(Ordering::SeqCst)
    );
}

/// The control: the same test finds what hangs.
fn hangs(control: &str, verdict: &str) {
    if cannot_run() {
        return;
    }
    let _alone = alone();
    let _watch = watchdog();
    let ended = Program::start(control).end();
    assert!(ended.output.contains(verdict), "{ended:?}");
}

#[test]
fn a_lock_that_spins_hangs() {
    own_process!(long);
    hangs("spin lock", "stalled in `spin lock`, Try: Spins");
}

#[test]
fn the_rendezvous_of_std_hangs() {
    own_process!(long);
    hangs(
        "std rendezvous",
        "stalled in `std::sync::mpsc::sync_channel(0)`, Block: Spins",
    );
}

//! The lock: held below, held by a thread that waits for another, and the kernel's data on its
//! owner.

use crate::common::real_time_core;
use crate::inversion::between::{BURST, Burner, Waits};
use crate::inversion::{HIGH, LOW, ROUNDS, thread};
use crate::kernel::{as_scheduled, burn, scheduled_priority, thread_id};
use luna_core::park::Parker;
use luna_platform::clock::Instant;
use luna_platform::lock::PiLock;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A lock of either kind, as a function that runs another one inside.
type Within = dyn Fn(&mut dyn FnMut()) + Send + Sync;

fn inheriting() -> Arc<Within> {
    let lock = PiLock::new(());
    Arc::new(move |inside| {
        let _guard = lock.lock();
        inside();
    })
}

fn plain() -> Arc<Within> {
    let lock = Mutex::new(());
    Arc::new(move |inside| {
        let _guard = lock.lock().unwrap();
        inside();
    })
}

/// Low takes `lock` and releases high; high releases the thread between, and waits for `wanted`.
/// Returns what the thread between burns meanwhile.
fn waits(core: usize, lock: Arc<Within>, wanted: Arc<Within>, chained: bool) -> Vec<Duration> {
    let burner = Burner::start(core);
    let control = burner.control();
    let [low_goes, high_goes, chain_goes] = [(); 3].map(|()| Arc::new(Parker::new()));
    let chain = chained.then(|| {
        // Holds what high wants, and waits for what low holds.
        let (lock, wanted) = (lock.clone(), wanted.clone());
        let (goes, high_goes) = (chain_goes.clone(), high_goes.clone());
        thread("chain", core, LOW + 10, move || {
            for _ in 0..ROUNDS {
                goes.park(Instant::NEVER);
                wanted(&mut || {
                    // High goes first: it waits by the time that this one does.
                    high_goes.unpark();
                    lock(&mut || ());
                });
            }
        })
    });
    let next = if chained {
        chain_goes.clone()
    } else {
        high_goes.clone()
    };
    let goes = low_goes.clone();
    let low = thread("low", core, LOW, move || {
        for _ in 0..ROUNDS {
            goes.park(Instant::NEVER);
            lock(&mut || {
                // The unparked thread runs at once, and waits for this thread when it goes on.
                next.unpark();
                burn(Duration::from_micros(100));
            });
        }
    });
    let high = thread("high", core, HIGH, move || {
        let mut waits = Vec::with_capacity(ROUNDS);
        for _ in 0..ROUNDS {
            low_goes.unpark();
            high_goes.park(Instant::NEVER);
            let before = control.burnt();
            control.go();
            let mut after = before;
            wanted(&mut || after = control.burnt());
            waits.push(after - before);
            // Lets it burn what it has left, so that each round begins alike.
            let nobody_wakes = Parker::new();
            while control.burnt() < before + BURST {
                nobody_wakes.park(Instant::now() + BURST);
            }
        }
        waits
    });
    let waits = high.join().unwrap();
    low.join().unwrap();
    chain.into_iter().for_each(|chain| chain.join().unwrap());
    waits
}

#[test]
fn a_lock_that_is_held_below() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let lock = inheriting();
    Waits::of(&waits(core, lock.clone(), lock, false)).expect_inherited("lock");
    let lock = plain();
    Waits::of(&waits(core, lock.clone(), lock, false)).expect_inverted("std::sync::Mutex");
}

#[test]
fn a_lock_whose_owner_waits_for_another() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let all = waits(core, inheriting(), inheriting(), true);
    Waits::of(&all).expect_inherited("chain of two locks");
    let all = waits(core, plain(), plain(), true);
    Waits::of(&all).expect_inverted("chain of two std::sync::Mutex");
}

/// The owner asks the kernel for its own priority: before, while the high thread waits, and after.
#[test]
fn the_kernel_says_that_the_owner_is_boosted() {
    own_process!();
    let Some(core) = real_time_core() else { return };
    let lock = Arc::new(PiLock::new(()));
    let goes = Arc::new(Parker::new());
    let (wanted, high_goes) = (lock.clone(), goes.clone());
    let high = thread("high", core, HIGH, move || {
        high_goes.park(Instant::NEVER);
        drop(wanted.lock());
    });
    let low = thread("low", core, LOW, move || {
        let me = thread_id();
        let before = scheduled_priority(me);
        let guard = lock.lock();
        let alone = scheduled_priority(me);
        // It runs at once, and waits when this thread goes on.
        goes.unpark();
        let waited_for = scheduled_priority(me);
        drop(guard);
        [before, alone, waited_for, scheduled_priority(me)]
    });
    let [before, alone, waited_for, after] = low.join().unwrap();
    high.join().unwrap();
    let own = as_scheduled(LOW);
    assert_eq!((before, alone, after), (own, own, own));
    assert_eq!(waited_for, as_scheduled(HIGH));
}

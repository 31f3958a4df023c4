//! The priority-inheriting lock excludes, inherits, and says when it is misused.

#![cfg(not(loom))]

use crate::shared::Random;
use luna_platform::lock::PiLock;
use std::sync::Arc;

#[test]
fn smoke() {
    let mut lock = PiLock::new(1);
    *lock.lock() += 1;
    assert_eq!(*lock.lock(), 2);
    assert_eq!(*lock.get_mut(), 2);
    let held = lock.lock();
    assert!(lock.try_lock().is_none());
    assert_eq!(*held, 2);
    drop(held);
    assert_eq!(lock.try_lock().map(|value| *value), Some(2));
}

#[test]
fn excludes_many_threads() {
    const THREADS: u64 = 12;
    const ROUNDS: u64 = 5_000;
    // Two numbers that differ only while a thread is inside.
    let lock = Arc::new(PiLock::new((0_u64, 0_u64)));
    let threads: Vec<_> = (1..=THREADS)
        .map(|seed| {
            let lock = lock.clone();
            std::thread::spawn(move || {
                let mut random = Random::new(seed);
                for _ in 0..ROUNDS {
                    let mut pair = lock.lock();
                    assert_eq!(pair.0, pair.1);
                    pair.0 += 1;
                    // Losing the core here makes the others wait in the kernel.
                    if random.below(50) == 0 {
                        std::thread::yield_now();
                    }
                    pair.1 += 1;
                }
            })
        })
        .collect();
    for thread in threads {
        thread.join().unwrap();
    }
    assert_eq!(*lock.lock(), (THREADS * ROUNDS, THREADS * ROUNDS));
}

#[test]
fn a_panic_inside_unlocks_and_does_not_poison() {
    let lock = Arc::new(PiLock::new(0));
    let inside = lock.clone();
    let panicked = std::thread::spawn(move || {
        let mut value = inside.lock();
        *value = 1;
        panic!("as the test wants");
    });
    assert!(panicked.join().is_err());
    assert_eq!(*lock.lock(), 1);
}

#[test]
fn debug_does_not_wait() {
    let lock = PiLock::new(5);
    assert!(format!("{lock:?}").contains('5'));
    let held = lock.lock();
    assert!(format!("{lock:?}").contains("locked"));
    assert_eq!(format!("{held:?}"), "5");
}

/// What the portable lock, a plain mutex, does not promise.
#[cfg(all(target_os = "linux", not(luna_portable)))]
mod linux {
    use super::*;
    use luna_platform::clock::Instant;
    use luna_platform::futex::Futex;
    use luna_platform::thread::{Attributes, Mode, Policy, available_cores, spawn};
    use std::convert::Infallible;
    use std::fs;
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::mpsc;
    use std::time::Duration;

    /// Longer than any of this takes on a loaded machine: a hang, then.
    const WATCHDOG: Duration = Duration::from_secs(60);

    /// Whether this process gets SCHED_FIFO; says why a test is skipped where it does not.
    fn real_time(test: &str) -> bool {
        let attributes = Attributes::new("probe")
            .policy(Policy::fifo(80))
            .mode(Mode::Strict);
        match spawn(attributes, |_| Ok::<_, Infallible>(()), |()| ()) {
            Ok(thread) => thread.join().is_ok(),
            Err(error) => {
                report!("skipped: {test}: {error}");
                false
            }
        }
    }

    /// Runs `body` on a thread of its own, on the first allowed core.
    fn on_one_core<T: Send + 'static>(
        policy: Policy,
        body: impl FnOnce() -> T + Send + 'static,
    ) -> mpsc::Receiver<T> {
        let attributes = Attributes::new(format!("{policy}"))
            .core(available_cores()[0])
            .policy(policy)
            .mode(Mode::Strict);
        let (sender, receiver) = mpsc::channel();
        let body = move |()| drop(sender.send(body()));
        drop(spawn(attributes, |_| Ok::<_, Infallible>(()), body).unwrap());
        receiver
    }

    /// The priority that the kernel schedules a thread of this process by, boosts included: field
    /// 18 of its `stat`. -1 - p for a real-time priority p.
    fn kernel_priority(thread: i32) -> i64 {
        let stat = fs::read_to_string(format!("/proc/self/task/{thread}/stat")).unwrap();
        // Counted after the name, which may hold spaces.
        stat.rsplit_once(')')
            .unwrap()
            .1
            .split_whitespace()
            .nth(15)
            .unwrap()
            .parse()
            .unwrap()
    }

    fn wait_until(what: &str, mut is_so: impl FnMut() -> bool) {
        let deadline = Instant::now() + WATCHDOG;
        while !is_so() {
            assert!(Instant::now() < deadline, "not within {WATCHDOG:?}: {what}");
            std::thread::yield_now();
        }
    }

    #[test]
    fn locking_twice_panics() {
        let lock = PiLock::new(());
        let held = lock.lock();
        let panic = catch_unwind(AssertUnwindSafe(|| drop(lock.lock()))).unwrap_err();
        assert!(
            panic
                .downcast_ref::<&str>()
                .unwrap()
                .contains("holds already")
        );
        drop(held);
        assert!(lock.try_lock().is_some(), "and the lock goes on working");
    }

    #[test]
    fn a_lock_whose_owner_has_died_panics() {
        let lock = Arc::new(PiLock::new(()));
        let dying = lock.clone();
        std::thread::spawn(move || std::mem::forget(dying.lock()))
            .join()
            .unwrap();
        let panic = catch_unwind(AssertUnwindSafe(|| drop(lock.lock()))).unwrap_err();
        assert!(
            panic
                .downcast_ref::<&str>()
                .unwrap()
                .contains("ended while it held")
        );
    }

    /// The ordinary thread loses its core to the real-time one at any point, inside or outside the
    /// lock. One that spun until the lock is free would hang here.
    #[test]
    fn contention_of_two_policies_on_one_core_does_not_hang() {
        if !real_time("contention_of_two_policies_on_one_core_does_not_hang") {
            return;
        }
        const ROUNDS: u64 = 2_000;
        let lock = Arc::new(PiLock::new((0_u64, 0_u64)));
        let ended = Arc::new(AtomicBool::new(false));
        let (low_lock, low_ended) = (lock.clone(), ended.clone());
        let low = on_one_core(Policy::Other, move || {
            let mut random = Random::new(1);
            let mut rounds = 0_u64;
            while !low_ended.load(Ordering::Relaxed) {
                let mut pair = low_lock.lock();
                pair.0 += 1;
                for _ in 0..random.below(2_000) {
                    std::hint::spin_loop();
                }
                pair.1 += 1;
                drop(pair);
                rounds += 1;
            }
            rounds
        });
        let high_lock = lock.clone();
        let high = on_one_core(Policy::fifo(80), move || {
            let mut random = Random::new(2);
            let nobody_wakes = Futex::new(0);
            for _ in 0..ROUNDS {
                // Leaves the core to the other, and takes it back at some point or other of its
                // round.
                nobody_wakes.wait(0, Instant::now() + Duration::from_micros(random.below(60)));
                let mut pair = high_lock.lock();
                assert_eq!(pair.0, pair.1);
                pair.0 += 1;
                pair.1 += 1;
            }
        });
        let outcome = high.recv_timeout(WATCHDOG);
        ended.store(true, Ordering::Relaxed);
        outcome.expect("the real-time thread ends");
        let rounds = low
            .recv_timeout(WATCHDOG)
            .expect("the ordinary thread ends");
        assert_eq!(*lock.lock(), (ROUNDS + rounds, ROUNDS + rounds));
    }

    /// Low holds the lock, high waits for it, and middle takes the core from low unless low has
    /// high's priority: then it spins for as long as this test lets it.
    #[test]
    fn the_owner_gets_the_waiters_priority() {
        if !real_time("the_owner_gets_the_waiters_priority") {
            return;
        }
        let lock = Arc::new(PiLock::new(()));
        let (go, may_go) = mpsc::channel::<()>();
        let (is_held, held) = mpsc::channel();
        let low_lock = lock.clone();
        let low = on_one_core(Policy::Other, move || {
            let guard = low_lock.lock();
            let thread = nix::unistd::gettid().as_raw();
            is_held.send(thread).unwrap();
            // Holds the lock until middle says so.
            may_go.recv().unwrap();
            drop(guard);
            kernel_priority(thread)
        });
        let low_thread = held.recv_timeout(WATCHDOG).unwrap();
        let ordinary = kernel_priority(low_thread);
        assert!(ordinary >= 0, "{ordinary}");

        let acquired = Arc::new(AtomicBool::new(false));
        let (high_lock, high_acquired) = (lock.clone(), acquired.clone());
        let high = on_one_core(Policy::fifo(80), move || {
            let _guard = high_lock.lock();
            high_acquired.store(true, Ordering::Release);
        });
        wait_until("the kernel boosts the owner to 80", || {
            kernel_priority(low_thread) == -1 - 80
        });

        let middle = on_one_core(Policy::fifo(50), move || {
            go.send(()).unwrap();
            let deadline = Instant::now() + Duration::from_secs(2);
            while !acquired.load(Ordering::Acquire) && Instant::now() < deadline {
                std::hint::spin_loop();
            }
            acquired.load(Ordering::Acquire)
        });
        assert!(
            middle.recv_timeout(WATCHDOG).unwrap(),
            "high got the lock while middle had the core"
        );
        high.recv_timeout(WATCHDOG).unwrap();
        assert_eq!(
            low.recv_timeout(WATCHDOG).unwrap(),
            ordinary,
            "the boost ends with the lock"
        );
    }

    /// The kernel hands the lock over in order of priority, not of arrival.
    #[test]
    fn the_most_urgent_waiter_is_next() {
        if !real_time("the_most_urgent_waiter_is_next") {
            return;
        }
        let lock = Arc::new(PiLock::new(Vec::new()));
        let guard = lock.lock();
        let me = nix::unistd::gettid().as_raw();
        let waiting: Vec<_> = [20, 40, 60]
            .into_iter()
            .map(|priority| {
                let lock = lock.clone();
                let done = on_one_core(Policy::fifo(priority), move || lock.lock().push(priority));
                // It waits as soon as the owner, this thread, has its priority.
                wait_until("the kernel boosts the owner", || {
                    kernel_priority(me) == -1 - i64::from(priority)
                });
                done
            })
            .collect();
        drop(guard);
        for done in waiting {
            done.recv_timeout(WATCHDOG).unwrap();
        }
        assert_eq!(*lock.lock(), [60, 40, 20]);
    }
}

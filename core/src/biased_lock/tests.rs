//! The bias, its revocation, and mutual exclusion.

#[cfg(not(loom))]
mod running {
    use crate::biased_lock::{ALONE, BiasedLock};
    use crate::current::{self, Home, HomeGuard as Entered};
    use crate::timer_queue::TimerQueue;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

    fn enter() -> Entered {
        current::enter_home(Home::new(), Arc::new(TimerQueue::new()), false)
    }

    /// Takes the lock until it is biased to this thread's executor. `false`: this platform has no
    /// bias.
    fn earn(lock: &BiasedLock<u64>) -> bool {
        for _ in 0..ALONE {
            *lock.lock() += 1;
        }
        let earned = lock.is_favouring();
        if !earned {
            println!("skipped: the platform has no asymmetric fences, so no lock favours a home");
        }
        earned
    }

    #[test]
    fn a_home_alone_is_favoured_until_another_thread_comes_and_never_again() {
        let _home = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        *lock.lock() += 1;
        std::thread::scope(|scope| {
            scope.spawn(|| *lock.lock() += 1);
        });
        assert!(!lock.is_favouring());
        earn(&lock);
        assert!(!lock.is_favouring());
        assert_eq!(*lock.lock(), 2 * u64::from(ALONE) + 2);
    }

    #[test]
    fn who_only_looks_leaves_the_favour() {
        let _home = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        std::thread::scope(|scope| {
            scope.spawn(|| assert_eq!(*lock.lock_briefly(), u64::from(ALONE)));
        });
        assert!(lock.is_favouring());
        assert_eq!(*lock.lock_briefly(), u64::from(ALONE));
    }

    #[test]
    fn a_plain_thread_and_two_homes_in_turn_are_not_favoured() {
        let lock = BiasedLock::new(0);
        for _ in 0..2 * ALONE {
            *lock.lock() += 1;
        }
        assert!(!lock.is_favouring());
        for _ in 0..3 {
            let _home = enter();
            for _ in 0..ALONE / 2 {
                *lock.lock() += 1;
            }
        }
        assert!(!lock.is_favouring());
    }

    #[test]
    #[should_panic(expected = "that it holds already")]
    fn locked_twice_by_its_home_it_says_so() {
        let _home = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            panic!("that it holds already, it would say");
        }
        let _first = lock.lock();
        let _second = lock.lock();
    }

    /// The owner of the bias is inside when the bias is revoked, and locks again from there: it
    /// panics with a report, and the waiting thread gets the lock.
    #[cfg(all(target_os = "linux", not(luna_portable)))]
    #[test]
    fn locked_twice_while_its_favour_ends_it_says_so() {
        let _home = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        let thread = AtomicU32::new(0);
        std::thread::scope(|scope| {
            let guard = lock.lock();
            scope.spawn(|| {
                thread.store(nix::unistd::gettid().as_raw() as u32, Ordering::Release);
                *lock.lock() += 1;
            });
            while !sleeps_in_a_futex(thread.load(Ordering::Acquire)) {
                std::thread::yield_now();
            }
            let again =
                std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| drop(lock.lock())));
            let payload = again.expect_err("it holds the lock already");
            let message = payload.downcast_ref::<&str>().expect("it is a text");
            assert!(message.contains("holds already"), "{message}");
            drop(guard);
        });
        assert_eq!(*lock.lock(), u64::from(ALONE) + 1);
    }

    #[test]
    fn two_homes_are_not_forgotten_for_a_plain_thread_in_between() {
        let lock = BiasedLock::new(0);
        for _ in 0..2 {
            {
                let _home = enter();
                *lock.lock() += 1;
            }
            *lock.lock() += 1;
        }
        let _home = enter();
        for _ in 0..2 * ALONE {
            *lock.lock() += 1;
        }
        assert!(!lock.is_favouring());
    }

    #[test]
    #[should_panic(expected = "another thread is this home")]
    fn a_home_is_one_thread() {
        let home = Home::new();
        let _home = current::enter_home(home, Arc::new(TimerQueue::new()), false);
        let other = std::thread::spawn(move || {
            drop(current::enter_home(
                home,
                Arc::new(TimerQueue::new()),
                false,
            ));
        });
        if let Err(payload) = other.join() {
            std::panic::resume_unwind(payload);
        }
    }

    #[test]
    fn a_guard_that_is_kept_holds_the_lock_until_it_is_given_again() {
        let _home = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        let home = current::home_number();
        // SAFETY: this thread is the executor's, and the kept guard is taken again.
        unsafe {
            lock.lock_if_favoured(home).unwrap().keep();
            assert!(lock.inside.is_entered());
            *lock.kept(home) += 1;
            assert!(!lock.inside.is_entered());
            assert!(lock.lock_if_favoured(home + 1).is_none());
        }
    }

    #[test]
    fn a_lock_that_favours_a_home_from_the_start_is_shared_when_another_comes() {
        let _home = enter();
        if !earn(&BiasedLock::new(0)) {
            return;
        }
        let home = current::home_number();
        // SAFETY: this thread is the executor's, and another lock is biased to it.
        let lock = unsafe { BiasedLock::biased_to(home, 0) };
        // SAFETY: as above.
        unsafe { *lock.lock_if_favoured(home).unwrap() += 1 };
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                (0..1000).for_each(|_| *lock.lock() += 1);
                done.store(true, Ordering::Release);
            });
            while !done.load(Ordering::Acquire) {
                *lock.lock() += 2;
                *lock.lock() -= 2;
            }
        });
        assert!(!lock.is_favouring());
        assert_eq!(*lock.lock(), 1001);
    }

    #[test]
    fn a_lock_that_is_made_by_a_home_favours_it_and_one_of_a_plain_thread_nobody() {
        assert!(!BiasedLock::biased_to_this_executor(0).is_favouring());
        let _home = enter();
        if !earn(&BiasedLock::new(0)) {
            assert!(!BiasedLock::biased_to_this_executor(0).is_favouring());
            return;
        }
        let lock = BiasedLock::biased_to_this_executor(0);
        assert!(lock.is_favouring());
        *lock.lock() += 1;
        assert!(lock.is_favouring());
        std::thread::scope(|scope| {
            scope.spawn(|| *lock.lock() += 1);
        });
        assert!(!lock.is_favouring());
        assert_eq!(*lock.lock(), 2);
    }

    /// The other thread finds the owner inside, and asks the kernel: the owner does not leave
    /// before the other thread sleeps there.
    #[cfg(all(target_os = "linux", not(luna_portable)))]
    #[test]
    fn who_finds_the_home_inside_waits_and_is_handed_over() {
        for _ in 0..20 {
            let _home = enter();
            let lock = BiasedLock::new(0);
            if !earn(&lock) {
                return;
            }
            let thread = AtomicU32::new(0);
            let inside = AtomicBool::new(true);
            std::thread::scope(|scope| {
                let mut guard = lock.lock();
                scope.spawn(|| {
                    thread.store(nix::unistd::gettid().as_raw() as u32, Ordering::Release);
                    let mut value = lock.lock();
                    assert!(!inside.load(Ordering::Relaxed));
                    *value += 1;
                });
                while !sleeps_in_a_futex(thread.load(Ordering::Acquire)) {
                    std::thread::yield_now();
                }
                *guard += 1;
                inside.store(false, Ordering::Relaxed);
                drop(guard);
            });
            assert!(!lock.is_favouring());
            assert_eq!(*lock.lock(), u64::from(ALONE) + 2);
        }
    }

    #[cfg(all(target_os = "linux", not(luna_portable)))]
    fn sleeps_in_a_futex(thread: u32) -> bool {
        thread != 0
            && std::fs::read_to_string(format!("/proc/self/task/{thread}/syscall"))
                .is_ok_and(|call| call.starts_with(&format!("{} ", libc::SYS_futex)))
    }

    #[test]
    fn nothing_is_lost_while_others_come_and_go() {
        const EACH: u64 = 20_000;
        for _ in 0..20 {
            let lock = BiasedLock::new(0);
            let began = AtomicBool::new(false);
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let _home = enter();
                    for _ in 0..EACH {
                        *lock.lock() += 1;
                        began.store(true, Ordering::Relaxed);
                    }
                });
                for briefly in [true, false] {
                    let (lock, began) = (&lock, &began);
                    scope.spawn(move || {
                        while !began.load(Ordering::Relaxed) {
                            std::thread::yield_now();
                        }
                        for _ in 0..EACH / 20 {
                            match briefly {
                                true => *lock.lock_briefly() += 1,
                                false => *lock.lock() += 1,
                            }
                        }
                    });
                }
            });
            assert_eq!(*lock.lock(), EACH + EACH / 10);
        }
    }
}

#[cfg(all(loom, not(shuttle)))]
mod model {
    use crate::biased_lock::{BiasedLock, NOBODY};
    use loom::sync::Arc;
    use luna_platform::sync::atomic::Ordering;

    const HOME: u64 = 7;

    fn favouring() -> Arc<BiasedLock<u32>> {
        let lock = BiasedLock::new(0);
        lock.favoured.store(HOME, Ordering::SeqCst);
        Arc::new(lock)
    }

    #[test]
    fn one_at_a_time_whoever_ends_the_favour() {
        loom::model(|| {
            let lock = favouring();
            let other = lock.clone();
            let other = loom::thread::spawn(move || *other.lock_as(0) += 1);
            for _ in 0..2 {
                *lock.lock_as(HOME) += 1;
            }
            other.join().unwrap();
            assert_eq!(*lock.lock_as(HOME), 3);
            assert_eq!(lock.favoured.load(Ordering::SeqCst), NOBODY);
        });
    }

    #[test]
    fn one_at_a_time_while_another_borrows() {
        loom::model(|| {
            let lock = favouring();
            let other = lock.clone();
            // No thread of this model has entered an executor.
            let other = loom::thread::spawn(move || *other.lock_briefly() += 1);
            for _ in 0..2 {
                *lock.lock_as(HOME) += 1;
            }
            other.join().unwrap();
            assert_eq!(*lock.lock_as(HOME), 3);
            assert_eq!(lock.favoured.load(Ordering::SeqCst), HOME);
        });
    }

    #[test]
    fn one_at_a_time_of_three() {
        loom::model(|| {
            let lock = favouring();
            let others = [false, true].map(|briefly| {
                let other = lock.clone();
                loom::thread::spawn(move || match briefly {
                    true => *other.lock_briefly() += 1,
                    false => *other.lock_as(0) += 1,
                })
            });
            *lock.lock_as(HOME) += 1;
            for other in others {
                other.join().unwrap();
            }
            assert_eq!(*lock.lock_as(HOME), 3);
        });
    }
}

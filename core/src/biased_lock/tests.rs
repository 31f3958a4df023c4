//! The bias, its revocation, and mutual exclusion.

#[cfg(not(loom))]
mod running {
    use crate::biased_lock::{ALONE, BiasedLock};
    use crate::current::{self, Cpu as Entered, ExecutorId, Here, PlainTurn};
    use crate::timer_queue::TimerQueue;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

    fn enter() -> Entered {
        current::enter_executor(ExecutorId::new(), Arc::new(TimerQueue::new()), false)
    }

    /// Takes the lock until it is biased to this thread's executor. `false`: this platform has no
    /// bias.
    fn earn(lock: &BiasedLock<u64>) -> bool {
        for _ in 0..ALONE {
            *lock.lock() += 1;
        }
        let earned = lock.is_biased();
        if !earned {
            println!("skipped: the platform has no asymmetric fences, so no lock is biased");
        }
        earned
    }

    #[test]
    fn biased_to_one_executor_until_another_thread_locks_and_never_again() {
        let _entered = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        *lock.lock() += 1;
        std::thread::scope(|scope| {
            scope.spawn(|| *lock.lock() += 1);
        });
        assert!(!lock.is_biased());
        earn(&lock);
        assert!(!lock.is_biased());
        assert_eq!(*lock.lock(), 2 * u64::from(ALONE) + 2);
    }

    #[test]
    fn a_brief_lock_keeps_the_bias() {
        let _entered = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        std::thread::scope(|scope| {
            scope.spawn(|| assert_eq!(*lock.lock_briefly(), u64::from(ALONE)));
        });
        assert!(lock.is_biased());
        assert_eq!(*lock.lock_briefly(), u64::from(ALONE));
    }

    #[test]
    fn no_bias_to_a_plain_thread_or_to_two_executors_in_turn() {
        let lock = BiasedLock::new(0);
        for _ in 0..2 * ALONE {
            *lock.lock() += 1;
        }
        assert!(!lock.is_biased());
        for _ in 0..3 {
            let _entered = enter();
            for _ in 0..ALONE / 2 {
                *lock.lock() += 1;
            }
        }
        assert!(!lock.is_biased());
    }

    #[test]
    #[should_panic(expected = "that it holds already")]
    fn locked_twice_by_its_executor_it_panics() {
        let _entered = enter();
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
    fn locked_twice_during_a_revocation_it_panics() {
        let _entered = enter();
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
                let _entered = enter();
                *lock.lock() += 1;
            }
            *lock.lock() += 1;
        }
        let _entered = enter();
        for _ in 0..2 * ALONE {
            *lock.lock() += 1;
        }
        assert!(!lock.is_biased());
    }

    #[test]
    #[should_panic(expected = "another thread is this executor")]
    fn an_executor_is_one_thread() {
        let executor = ExecutorId::new();
        let _entered = current::enter_executor(executor, Arc::new(TimerQueue::new()), false);
        let other = std::thread::spawn(move || {
            drop(current::enter_executor(
                executor,
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
        let _entered = enter();
        let lock = BiasedLock::new(0);
        if !earn(&lock) {
            return;
        }
        let (executor, turn) = (current::executor_number(), PlainTurn::without_process());
        // SAFETY: this thread is the executor's, and the kept guard is taken again.
        unsafe {
            lock.enter_as(executor, luna_platform::inside::Inside::id_of_this_thread())
                .unwrap()
                .keep();
            assert!(lock.inside.is_entered());
            *lock.kept(turn) += 1;
            assert!(!lock.inside.is_entered());
            assert!(lock.enter_as(executor + 1, 0).is_none());
        }
    }

    #[test]
    fn biased_from_the_start_and_shared_when_another_locks() {
        let _entered = enter();
        if !earn(&BiasedLock::new(0)) {
            return;
        }
        let lock = BiasedLock::biased_in(Here::now(), 0);
        *lock.enter_in(Here::now()).unwrap() += 1;
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
        assert!(!lock.is_biased());
        assert_eq!(*lock.lock(), 1001);
    }

    #[test]
    fn made_by_an_executor_it_is_biased_and_by_a_plain_thread_it_is_not() {
        assert!(!BiasedLock::biased_in(Here::now(), 0).is_biased());
        let _entered = enter();
        if !earn(&BiasedLock::new(0)) {
            assert!(!BiasedLock::biased_in(Here::now(), 0).is_biased());
            return;
        }
        let lock = BiasedLock::biased_in(Here::now(), 0);
        assert!(lock.is_biased());
        *lock.lock() += 1;
        assert!(lock.is_biased());
        std::thread::scope(|scope| {
            scope.spawn(|| *lock.lock() += 1);
        });
        assert!(!lock.is_biased());
        assert_eq!(*lock.lock(), 2);
    }

    /// The other thread finds the owner inside, and asks the kernel: the owner does not leave
    /// before the other thread sleeps there.
    #[cfg(all(target_os = "linux", not(luna_portable)))]
    #[test]
    fn a_thread_that_finds_the_owner_inside_waits_for_the_hand_over() {
        for _ in 0..20 {
            let _entered = enter();
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
            assert!(!lock.is_biased());
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
                    let _entered = enter();
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
    use crate::biased_lock::{BiasedGuard, BiasedLock, NO_EXECUTOR};
    use loom::sync::Arc;
    use luna_platform::sync::atomic::Ordering;

    const EXECUTOR: u64 = 7;

    fn biased_lock() -> Arc<BiasedLock<u32>> {
        let lock = BiasedLock::new(0);
        lock.bias.store(EXECUTOR, Ordering::SeqCst);
        Arc::new(lock)
    }

    /// Adds one, in a way in which two at once would lose one: loom does not watch the value as
    /// long as the guard's reference to it lives.
    fn add(mut guard: BiasedGuard<'_, u32>) {
        let before = *guard;
        loom::thread::yield_now();
        *guard = before + 1;
    }

    #[test]
    fn one_at_a_time_whichever_thread_revokes_the_bias() {
        loom::model(|| {
            let lock = biased_lock();
            let other = lock.clone();
            let other = loom::thread::spawn(move || add(other.lock_as(0)));
            for _ in 0..2 {
                add(lock.lock_as(EXECUTOR));
            }
            other.join().unwrap();
            assert_eq!(*lock.lock_as(EXECUTOR), 3);
            assert_eq!(lock.bias.load(Ordering::SeqCst), NO_EXECUTOR);
        });
    }

    #[test]
    fn one_at_a_time_while_another_locks_briefly() {
        loom::model(|| {
            let lock = biased_lock();
            let other = lock.clone();
            // No thread of this model has entered an executor.
            let other = loom::thread::spawn(move || add(other.lock_briefly()));
            for _ in 0..2 {
                add(lock.lock_as(EXECUTOR));
            }
            other.join().unwrap();
            assert_eq!(*lock.lock_as(EXECUTOR), 3);
            assert_eq!(lock.bias.load(Ordering::SeqCst), EXECUTOR);
        });
    }

    #[test]
    fn one_at_a_time_of_three() {
        let mut builder = loom::model::Builder::new();
        // Without a bound it takes a minute.
        builder.preemption_bound.get_or_insert(4);
        builder.check(|| {
            let lock = biased_lock();
            let others = [false, true].map(|briefly| {
                let other = lock.clone();
                loom::thread::spawn(move || match briefly {
                    true => add(other.lock_briefly()),
                    false => add(other.lock_as(0)),
                })
            });
            add(lock.lock_as(EXECUTOR));
            for other in others {
                other.join().unwrap();
            }
            assert_eq!(*lock.lock_as(EXECUTOR), 3);
        });
    }
}

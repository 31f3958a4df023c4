//! Processes made while others run, by others, and too late.

#![cfg(not(loom))]

use crate::support;
use luna_core::current;
use luna_core::{Exit, PollMonitor, ProcessSpec, ProcessState, Verdict, poll_monitor, yield_now};
use luna_platform::clock::Instant;
use std::future::pending;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use support::{Drops, Log, executor, rounds, watchdog};

#[test]
fn processes_spawn_processes_on_their_own_executor() {
    let _watchdog = watchdog();
    let executor = executor();
    let (handle, log) = (executor.handle().clone(), Log::new());
    let own = log.clone();
    let parent = executor.spawn(ProcessSpec::new("parent").level(10), move || async move {
        let children: Vec<_> = [12, 3, 20]
            .into_iter()
            .map(|level| {
                let log = own.clone();
                handle.spawn(ProcessSpec::new("child").level(level), move || async move {
                    log.add(level)
                })
            })
            .collect();
        own.add(10);
        yield_now().await;
        own.add(10);
        for child in children {
            assert_eq!(child.join().await, Exit::Completed);
        }
    });
    executor.release();
    assert_eq!(parent.wait(), Exit::Completed);
    assert_eq!(log.take(), [10, 20, 12, 10, 3]);
}

#[test]
fn generations_from_elsewhere_and_from_inside() {
    let _watchdog = watchdog();
    let (one, two) = (executor(), executor());
    one.release();
    two.release();
    let (drops, built) = (Drops::default(), Arc::new(AtomicUsize::new(0)));
    let each = rounds(500);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                for _ in 0..each {
                    let (token, child_token) = (drops.token(), drops.token());
                    let (built, there) = (built.clone(), two.handle().clone());
                    one.spawn(ProcessSpec::new("parent"), move || async move {
                        let _token = token;
                        let child = there.spawn(ProcessSpec::new("child"), move || async move {
                            yield_now().await;
                            drop(child_token);
                            built.fetch_add(1, Ordering::SeqCst);
                        });
                        assert_eq!(child.join().await, Exit::Completed);
                    })
                    .wait();
                }
            });
        }
    });
    assert_eq!(
        (built.load(Ordering::SeqCst), drops.count()),
        (2 * each, 4 * each)
    );
}

#[test]
fn a_stopped_executor_takes_nobody_in() {
    let _watchdog = watchdog();
    let (executor, drops) = (executor(), Drops::default());
    let handle = executor.handle().clone();
    executor.stop();
    let token = drops.token();
    let process = handle.spawn(ProcessSpec::new("late"), move || {
        drop(token);
        async { unreachable!("never built") }
    });
    assert_eq!(
        (process.exit(), process.wait(), process.state()),
        (Some(Exit::Cancelled), Exit::Cancelled, ProcessState::Ended)
    );
    assert_eq!((process.polls(), drops.count()), (0, 1));
}

#[test]
fn spawning_races_with_the_stop() {
    let _watchdog = watchdog();
    for _ in 0..rounds(200) {
        let (executor, drops) = (executor(), Drops::default());
        executor.release();
        let handle = executor.handle().clone();
        let tokens: Vec<_> = (0..20).map(|_| drops.token()).collect();
        let spawner = std::thread::spawn(move || {
            tokens
                .into_iter()
                .map(|token| {
                    handle.spawn(ProcessSpec::new("raced"), move || async move {
                        let _token = token;
                        pending::<()>().await;
                    })
                })
                .collect::<Vec<_>>()
        });
        executor.stop();
        let processes = spawner.join().unwrap();
        assert!(
            processes
                .iter()
                .all(|process| process.wait() == Exit::Cancelled)
        );
        assert_eq!(drops.count(), 20);
    }
}

#[test]
fn a_body_that_spawns_as_it_is_dropped() {
    let _watchdog = watchdog();
    struct SpawnsWhenDropped(luna_core::ExecutorHandle, Log<Exit>);
    impl Drop for SpawnsWhenDropped {
        fn drop(&mut self) {
            let process = self.0.spawn(ProcessSpec::new("too late"), || async {});
            self.1.add(process.exit().expect("refused at once"));
        }
    }
    let (executor, log) = (executor(), Log::new());
    let held = SpawnsWhenDropped(executor.handle().clone(), log.clone());
    executor.spawn(ProcessSpec::new("exit value"), move || async move {
        let _held = held;
        pending::<()>().await;
    });
    executor.release();
    executor.settle();
    executor.stop();
    assert_eq!(log.take(), [Exit::Cancelled]);
}

#[test]
fn what_is_refused_is_dropped_where_its_spawner_likes() {
    let _watchdog = watchdog();
    let (executor, drops) = (executor(), Drops::default());
    let token = drops.token();
    let body = move || async move { drop(token) };
    let (announced, process) = executor.handle().announce(ProcessSpec::new("late"), body);
    executor.stop();
    let refused = announced.start();
    assert_eq!((drops.count(), process.exit()), (0, None));
    drop(refused.expect("the executor has stopped"));
    assert_eq!((drops.count(), process.exit()), (1, Some(Exit::Cancelled)));
}

/// Whether the turn that this is called in is looked at, is one in which a body is abandoned, or
/// poisons what is dropped.
fn turn_of_another() -> bool {
    poll_monitor().is_some() || current::is_abandoned() || current::dropped_ends_poison()
}

#[test]
fn a_child_of_a_monitored_process_is_built_in_a_turn_of_its_own() {
    struct LooksOn;
    impl PollMonitor for LooksOn {
        fn poll_begins(&self, _: Instant) {}
        fn poll_ends(&self, _: Instant, _: Instant) -> Verdict {
            Verdict::GoOn
        }
    }
    let _watchdog = watchdog();
    let (executor, log) = (executor(), Log::new());
    let (handle, own) = (executor.handle().clone(), log.clone());
    let spec = ProcessSpec::new("monitored").monitored(Arc::new(LooksOn));
    let parent = executor.spawn(spec, move || async move {
        assert!(turn_of_another());
        let child = handle.spawn(ProcessSpec::new("child"), move || {
            own.add(turn_of_another());
            async {}
        });
        assert_eq!(child.join().await, Exit::Completed);
    });
    executor.release();
    assert_eq!(parent.wait(), Exit::Completed);
    assert_eq!(log.take(), [false]);
}

#[test]
fn a_child_of_an_abandoned_body_is_built_in_a_turn_of_its_own() {
    let _watchdog = watchdog();
    struct SpawnsWhenDropped(luna_core::ExecutorHandle, Log<bool>);
    impl Drop for SpawnsWhenDropped {
        fn drop(&mut self) {
            assert!(turn_of_another());
            let log = self.1.clone();
            self.0.spawn(ProcessSpec::new("inheritor"), move || {
                log.add(turn_of_another());
                async {}
            });
        }
    }
    let (executor, log) = (executor(), Log::new());
    let held = SpawnsWhenDropped(executor.handle().clone(), log.clone());
    let parent = executor.spawn(ProcessSpec::new("abandoned"), move || async move {
        let _held = held;
        pending::<()>().await;
    });
    executor.release();
    parent.cancel();
    assert_eq!(parent.wait(), Exit::Cancelled);
    executor.settle();
    assert_eq!(log.take(), [false]);
}

#[test]
fn settle_waits_for_all_builders_so_far() {
    let _watchdog = watchdog();
    let (executor, built) = (executor(), Arc::new(AtomicUsize::new(0)));
    for round in 1..=20 {
        for _ in 0..10 {
            let built = built.clone();
            executor.spawn(ProcessSpec::new("built"), move || {
                built.fetch_add(1, Ordering::SeqCst);
                async {}
            });
        }
        executor.settle();
        assert_eq!(built.load(Ordering::SeqCst), round * 10);
        if round == 10 {
            executor.release();
        }
    }
}

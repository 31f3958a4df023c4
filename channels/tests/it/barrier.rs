//! Barriers: rounds, enrolling and resigning, cancelling, alternatives, groups on one executor, and
//! all of it across threads.

#![cfg(not(loom))]

use futures_lite::future::{block_on, poll_once, zip};
use luna_channels::{Barrier, alt, channel, pri_alt};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::future::Future;
use std::pin::{Pin, pin};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Waker};

fn is_pending<F: Future>(future: &mut Pin<Box<F>>) -> bool {
    future
        .as_mut()
        .poll(&mut Context::from_waker(Waker::noop()))
        .is_pending()
}

#[test]
fn nobody_goes_before_all_have_come_round_after_round() {
    let barrier = Barrier::new(3);
    for _ in 0..3 {
        let (mut first, mut second) = (Box::pin(barrier.sync()), Box::pin(barrier.sync()));
        assert!(is_pending(&mut first) && is_pending(&mut second));
        assert!(is_pending(&mut first));
        let mut third = Box::pin(barrier.sync());
        assert!(!is_pending(&mut third));
        assert!(!is_pending(&mut second) && !is_pending(&mut first));
    }
}

#[test]
fn a_barrier_without_parties_holds_nobody() {
    block_on(Barrier::new(0).sync());
    block_on(Barrier::new(1).sync());
}

#[test]
fn one_that_is_dropped_has_not_come() {
    let barrier = Barrier::new(2);
    let mut gone = Box::pin(barrier.sync());
    assert!(is_pending(&mut gone));
    drop(gone);
    let mut first = Box::pin(barrier.sync());
    assert!(is_pending(&mut first));
    assert!(!is_pending(&mut Box::pin(barrier.sync())));
    assert!(!is_pending(&mut first));
}

#[test]
fn one_that_is_dropped_after_the_round_has_come() {
    let barrier = Barrier::new(2);
    let mut gone = Box::pin(barrier.sync());
    assert!(is_pending(&mut gone));
    assert!(!is_pending(&mut Box::pin(barrier.sync())));
    drop(gone);
    assert!(is_pending(&mut Box::pin(barrier.sync())));
}

#[test]
fn one_that_enrolls_is_waited_for_and_the_one_that_resigns_is_not() {
    let barrier = Barrier::new(1);
    let party = barrier.enroll();
    assert_eq!(barrier.parties(), 2);
    let mut sync = Box::pin(barrier.sync());
    assert!(is_pending(&mut sync));
    drop(party);
    assert!(!is_pending(&mut sync));

    let barrier = Barrier::new(2);
    let mut sync = Box::pin(barrier.sync());
    assert!(is_pending(&mut sync));
    barrier.resign();
    assert!(!is_pending(&mut sync));
    barrier.resign();
    barrier.resign();
    assert_eq!(barrier.parties(), 0);
}

#[test]
fn an_alternative_comes_only_if_all_others_have() {
    let barrier = Barrier::new(2);
    let (sender, receiver) = channel::<u32>();
    let choose = async || {
        pri_alt! {
            _ = barrier.sync() => None,
            value = receiver.recv() => value.ok(),
        }
    };
    // The other guard is chosen: the barrier knows nothing of it any more.
    let mut alternative = Box::pin(choose());
    assert!(is_pending(&mut alternative));
    assert!(sender.try_send(1).is_ok());
    let mut sync = Box::pin(barrier.sync());
    assert!(is_pending(&mut sync), "the alternative has chosen already");
    assert_eq!(block_on(alternative), Some(1));
    // It waits, and the alternative comes second.
    assert_eq!(block_on(choose()), None);
    assert!(!is_pending(&mut sync));
    // The alternative waits, and the arriving party chooses it.
    let mut alternative = Box::pin(choose());
    assert!(is_pending(&mut alternative));
    assert!(!is_pending(&mut Box::pin(barrier.sync())));
    assert!(sender.try_send(2).is_err(), "it has chosen");
    assert_eq!(block_on(alternative), None);
    // One that is dropped leaves no trace.
    let mut alternative = Box::pin(choose());
    assert!(is_pending(&mut alternative));
    drop(alternative);
    assert!(is_pending(&mut Box::pin(barrier.sync())));
}

#[test]
fn alternatives_alone_meet_and_the_same_barrier_twice_is_one_party() {
    let barrier = Barrier::new(2);
    let twice = async || {
        alt! {
            _ = barrier.sync() => 1,
            _ = barrier.sync() => 2,
        }
    };
    let mut first = Box::pin(twice());
    assert!(is_pending(&mut first));
    assert!((1..=2).contains(&block_on(twice())));
    assert_eq!(block_on(first), 1);
}

/// Each of three has two of three barriers, in a circle: whichever two meet, the third waits.
#[test]
fn two_barriers_in_each_of_three_alternatives() {
    let barriers = [Barrier::new(2), Barrier::new(2), Barrier::new(2)];
    let choose = async |index: usize| {
        pri_alt! {
            _ = barriers[index].sync() => index,
            _ = barriers[(index + 1) % 3].sync() => (index + 1) % 3,
        }
    };
    let mut all: Vec<_> = (0..3).map(|index| Box::pin(choose(index))).collect();
    assert!(is_pending(&mut all[0]));
    assert_eq!(
        block_on(poll_once(all[1].as_mut())),
        Some(1),
        "0 and 1 have barrier 1"
    );
    assert_eq!(block_on(poll_once(all[0].as_mut())), Some(1));
    assert!(is_pending(&mut all[2]));
}

#[test]
fn a_timeout_beside_a_barrier() {
    luna_core::block_on(async {
        let barrier = Barrier::new(2);
        let late = alt! {
            _ = barrier.sync() => false,
            _ = luna_channels::after(std::time::Duration::from_millis(1)) => true,
        };
        assert!(late);
        let mut other = pin!(barrier.sync());
        assert!(poll_once(other.as_mut()).await.is_none());
    })
    .unwrap();
}

/// In each round all have the same number, on two executors and a thread, some of them by
/// alternatives that may choose something else.
#[test]
fn rounds_across_executors_and_threads() {
    const ROUNDS: usize = 300;
    let barrier = Barrier::new(5);
    let arrived = Arc::new(AtomicUsize::new(0));
    let executors = ["left", "right"].map(|name| Executor::start(Attributes::new(name)).unwrap());
    let mut processes = Vec::new();
    for party in 0..4 {
        let (barrier, arrived) = (barrier.clone(), arrived.clone());
        let executor = &executors[party % 2];
        processes.push(
            executor.spawn(ProcessSpec::new("party"), move || async move {
                let (_quiet, nothing) = channel::<u32>();
                for round in 1..=ROUNDS {
                    arrived.fetch_add(1, Ordering::SeqCst);
                    if party < 2 {
                        barrier.sync().await;
                    } else {
                        alt! {
                            _ = nothing.recv() => unreachable!(),
                            _ = barrier.sync() => {}
                        }
                    }
                    assert!(arrived.load(Ordering::SeqCst) >= 5 * round);
                }
            }),
        );
    }
    for executor in &executors {
        executor.release();
    }
    for round in 1..=ROUNDS {
        arrived.fetch_add(1, Ordering::SeqCst);
        block_on(barrier.sync());
        assert!(arrived.load(Ordering::SeqCst) >= 5 * round);
    }
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
    assert_eq!(arrived.load(Ordering::SeqCst), 5 * ROUNDS);
}

#[test]
fn a_group_counts_as_the_one_party_whose_place_it_takes() {
    let barrier = Barrier::new(3);
    let group = barrier.local(4);
    assert_eq!(barrier.parties(), 6);
    group.local(1);
    barrier.local(0);
    assert_eq!(group.parties(), 6);
}

#[test]
fn both_guards_of_two_processes_at_two_barriers() {
    let (left, right) = (Barrier::new(2), Barrier::new(2));
    let choose = async || {
        alt! {
            _ = left.sync() => "left",
            _ = right.sync() => "right",
        }
    };
    for _ in 0..10 {
        let (one, other) = block_on(zip(choose(), choose()));
        assert_eq!(one, other);
    }
}

/// More parties of one executor than are released at once: for many rounds alone, then with one of
/// them in an alternative, or with a thread.
#[test]
fn rounds_of_one_executor_alone_and_with_others() {
    const PARTIES: usize = 20;
    const ALONE: usize = 100;
    const ROUNDS: usize = 200;

    #[derive(Clone, Copy, PartialEq)]
    enum Then {
        Alone,
        Alternative,
        Thread,
    }

    for then in [Then::Alone, Then::Alternative, Then::Thread] {
        let barrier = Barrier::new(PARTIES);
        let arrived = Arc::new(AtomicUsize::new(0));
        let (gives, party) = std::sync::mpsc::channel();
        let executor = Executor::start(Attributes::new("parties")).unwrap();
        let processes: Vec<_> = (0..PARTIES)
            .map(|number| {
                let (barrier, arrived) = (barrier.clone(), arrived.clone());
                let gives = gives.clone();
                let level = [7, 8, 7, 9][number % 4];
                let spec = ProcessSpec::new("party").level(level);
                executor.spawn(spec, move || async move {
                    let (_quiet, nothing) = channel::<u32>();
                    for round in 1..=ROUNDS {
                        arrived.fetch_add(1, Ordering::SeqCst);
                        let is_first = number == 0 && round > ALONE;
                        if is_first && round == ALONE + 1 && then == Then::Thread {
                            gives.send(barrier.enroll()).unwrap();
                        }
                        if is_first && then == Then::Alternative {
                            alt! {
                                _ = nothing.recv() => unreachable!(),
                                _ = barrier.sync() => {}
                            }
                        } else {
                            barrier.sync().await;
                        }
                        assert!(arrived.load(Ordering::SeqCst) >= PARTIES * round);
                    }
                })
            })
            .collect();
        drop(gives);
        executor.release();
        if let Ok(party) = party.recv() {
            for round in ALONE + 1..=ROUNDS {
                block_on(party.sync());
                assert!(arrived.load(Ordering::SeqCst) >= PARTIES * round);
            }
        }
        for process in processes {
            assert_eq!(process.wait(), Exit::Completed);
        }
    }
}

/// A party that waits, of a process of this executor that has ended. The barrier is biased to the
/// executor.
fn left_by_its_process(
    executor: &Executor,
    barrier: &Barrier,
) -> Pin<Box<dyn Future<Output = ()> + Send>> {
    let (gives, gets) = std::sync::mpsc::channel();
    let barrier = barrier.clone();
    let process = executor.spawn(ProcessSpec::new("here"), move || async move {
        // The barrier is used by this executor alone, until its lock is biased to it.
        for _ in 0..50 {
            assert_eq!(barrier.parties(), 2);
        }
        let mut waits: Pin<Box<dyn Future<Output = ()> + Send>> =
            Box::pin(async move { barrier.sync().await });
        assert!(poll_once(waits.as_mut()).await.is_none());
        gives.send(waits).unwrap();
    });
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    gets.recv().unwrap()
}

/// A waiting party's future goes to another executor, whose process is then the one to be woken.
#[test]
fn a_party_that_waits_moves_to_another_executor() {
    for comes_there in [false, true] {
        let barrier = Barrier::new(2);
        let executors =
            ["here", "there"].map(|name| Executor::start(Attributes::new(name)).unwrap());
        let waits = left_by_its_process(&executors[0], &barrier);
        let there = executors[1].spawn(ProcessSpec::new("there"), move || async move {
            let mut waits = waits;
            if comes_there {
                assert!(poll_once(waits.as_mut()).await.is_none());
            }
            waits.await;
        });
        let last = executors[1].spawn(ProcessSpec::new("last"), move || async move {
            barrier.sync().await;
        });
        executors[1].release();
        assert_eq!(last.wait(), Exit::Completed);
        assert_eq!(there.wait(), Exit::Completed);
    }
}

#[test]
fn a_party_whose_process_has_ended_has_come() {
    let barrier = Barrier::new(2);
    let executor = Executor::start(Attributes::new("here")).unwrap();
    let waits = left_by_its_process(&executor, &barrier);
    let last = executor.spawn(ProcessSpec::new("last"), move || async move {
        barrier.sync().await;
    });
    assert_eq!(last.wait(), Exit::Completed);
    block_on(waits);
}

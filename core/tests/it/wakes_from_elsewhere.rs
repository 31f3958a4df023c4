//! Other threads wake processes: none is lost, none waits behind less urgent ones, none does harm
//! before the start or after the end.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Exit, ProcessSpec, ProcessState, yield_now};
use std::future::poll_fn;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Poll, Waker};
use support::{Gate, Log, Random, executor, rounds, until, watchdog};

/// Where wakers and the woken meet: how many wakes are owed to the process.
#[derive(Default)]
struct Mailbox {
    owed: AtomicU64,
    waker: Mutex<Option<Waker>>,
}

impl Mailbox {
    fn wake(&self) {
        self.owed.fetch_add(1, Ordering::SeqCst);
        if let Some(waker) = &*self.waker.lock().unwrap() {
            waker.wake_by_ref();
        }
    }

    /// Waits until something is owed, and takes it.
    async fn take(&self) -> u64 {
        poll_fn(|cx| {
            *self.waker.lock().unwrap() = Some(cx.waker().clone());
            match self.owed.swap(0, Ordering::SeqCst) {
                0 => Poll::Pending,
                owed => Poll::Ready(owed),
            }
        })
        .await
    }
}

#[test]
fn many_threads_wake_many_processes_and_nothing_is_lost() {
    let _watchdog = watchdog();
    const PROCESSES: usize = 48;
    const THREADS: usize = 4;
    let each = rounds(20_000);
    let mut random = Random::seeded();
    let executor = executor();
    let boxes: Arc<Vec<Mailbox>> = Arc::new((0..PROCESSES).map(|_| Mailbox::default()).collect());
    let taken: Arc<Vec<AtomicU64>> = Arc::new((0..PROCESSES).map(|_| AtomicU64::new(0)).collect());
    let processes: Vec<_> = (0..PROCESSES)
        .map(|n| {
            let (boxes, taken) = (boxes.clone(), taken.clone());
            executor.spawn(
                ProcessSpec::new("woken").level((n % 32) as u8),
                move || async move {
                    loop {
                        let owed = boxes[n].take().await;
                        taken[n].fetch_add(owed, Ordering::SeqCst);
                    }
                },
            )
        })
        .collect();
    executor.release();
    let wakers: Vec<_> = (0..THREADS)
        .map(|_| {
            let (boxes, mut random) = (boxes.clone(), random.split());
            std::thread::spawn(move || {
                let mut sent = [0u64; PROCESSES];
                for _ in 0..each {
                    let n = random.below(PROCESSES as u64) as usize;
                    boxes[n].wake();
                    sent[n] += 1;
                }
                sent
            })
        })
        .collect();
    let sent: Vec<[u64; PROCESSES]> = wakers
        .into_iter()
        .map(|waker| waker.join().unwrap())
        .collect();
    for n in 0..PROCESSES {
        let all: u64 = sent.iter().map(|sent| sent[n]).sum();
        until(|| taken[n].load(Ordering::SeqCst) == all);
        // No more often than it was woken, first run, cancel, and one run by each link aside.
        assert!(processes[n].polls() <= 2 * all + 2);
    }
    executor.stop();
    assert!(
        processes
            .iter()
            .all(|process| process.wait() == Exit::Cancelled)
    );
}

/// The wake comes while a process has its turn that yields to the next one.
#[test]
fn a_wake_leaves_those_that_yield_to_each_other_in_their_order() {
    let _watchdog = watchdog();
    for (level, expected) in [
        (20, "a b c a woken b c a b c"),
        (1, "a b c a b c a b c woken"),
    ] {
        let (executor, log) = (executor(), Log::new());
        let mailbox = Arc::new(Mailbox::default());
        let (own, seen) = (mailbox.clone(), log.clone());
        let spec = ProcessSpec::new("woken").level(level);
        let mut processes = vec![executor.spawn(spec, move || async move {
            own.take().await;
            seen.add("woken");
        })];
        for name in ["a", "b", "c"] {
            let (mailbox, log) = (mailbox.clone(), log.clone());
            let spec = ProcessSpec::new(name).level(10);
            processes.push(executor.spawn(spec, move || async move {
                for round in 0..3 {
                    log.add(name);
                    if (name, round) == ("a", 1) {
                        let mailbox = mailbox.clone();
                        std::thread::spawn(move || mailbox.wake()).join().unwrap();
                    }
                    yield_now().await;
                }
            }));
        }
        executor.settle();
        executor.release();
        processes.iter().for_each(|process| drop(process.wait()));
        assert_eq!(log.take().join(" "), expected);
    }
}

#[test]
fn one_wake_at_a_time_of_a_sleeping_executor() {
    let _watchdog = watchdog();
    let executor = executor();
    let mailbox = Arc::new(Mailbox::default());
    let answers = Arc::new(AtomicU64::new(0));
    let (own, counted) = (mailbox.clone(), answers.clone());
    executor.spawn(ProcessSpec::new("answers"), move || async move {
        loop {
            let owed = own.take().await;
            counted.fetch_add(owed, Ordering::SeqCst);
        }
    });
    executor.release();
    // Each wake comes near the moment when the executor goes to sleep.
    for n in 1..=rounds(20_000) as u64 {
        mailbox.wake();
        until(|| answers.load(Ordering::SeqCst) == n);
    }
}

#[test]
fn a_high_wake_does_not_wait_behind_low_ones() {
    let _watchdog = watchdog();
    let executor = executor();
    let (gate, log) = (Gate::default(), Log::new());
    let mut waiting: Vec<_> = (0..500)
        .map(|_| {
            let (gate, log) = (gate.clone(), log.clone());
            executor.spawn(ProcessSpec::new("low").level(3), move || async move {
                gate.pass().await;
                log.add("low");
            })
        })
        .collect();
    let (high_gate, own) = (Gate::default(), log.clone());
    let opened_last = high_gate.clone();
    waiting.push(
        executor.spawn(ProcessSpec::new("high").level(25), move || async move {
            high_gate.pass().await;
            own.add("high");
        }),
    );
    let (own, all) = (log.clone(), gate.clone());
    let busy = executor.spawn(ProcessSpec::new("busy").level(1), move || async move {
        // The executor is busy here while all are woken from elsewhere, the high one last.
        std::thread::spawn(move || {
            all.open();
            opened_last.open();
        })
        .join()
        .unwrap();
        own.add("busy");
        yield_now().await;
        own.add("busy again");
    });
    executor.settle();
    executor.release();
    busy.wait();
    waiting.iter().for_each(|process| drop(process.wait()));
    let order = log.take();
    assert_eq!(order[..2], ["busy", "high"]);
    assert_eq!(order[502], "busy again");
    assert_eq!(order.len(), 503);
}

/// The processes that were woken since the executor looked come in the order of their making, and
/// before all that are woken later.
#[test]
fn nobody_of_a_level_is_overtaken_by_one_that_is_woken_later() {
    let _watchdog = watchdog();
    let executor = executor();
    let (gates, log): (Vec<Gate>, _) = ((0..100).map(|_| Gate::default()).collect(), Log::new());
    let wake = |gates: Vec<Gate>| {
        std::thread::spawn(move || gates.iter().for_each(Gate::open))
            .join()
            .unwrap()
    };
    let mut processes: Vec<_> = (0..100)
        .map(|n| {
            let (gate, log) = (gates[n].clone(), log.clone());
            let next = if n < 50 {
                vec![gates[99 - n].clone()]
            } else {
                Vec::new()
            };
            executor.spawn(ProcessSpec::new("waits"), move || async move {
                gate.pass().await;
                log.add(n);
                wake(next);
            })
        })
        .collect();
    processes.push(
        executor.spawn(ProcessSpec::new("busy").level(1), move || async move {
            wake((0..50).map(|n| gates[n * 37 % 50].clone()).collect());
        }),
    );
    executor.release();
    processes.iter().for_each(|process| drop(process.wait()));
    assert_eq!(
        log.take(),
        (0..50).chain((50..100).rev()).collect::<Vec<_>>()
    );
}

#[test]
fn a_wake_before_the_release_is_kept_and_runs_nothing() {
    let _watchdog = watchdog();
    let (first, second) = (executor(), executor());
    let gate = Gate::default();
    let own = gate.clone();
    let process = first.spawn(ProcessSpec::new("early"), move || async move {
        own.pass().await
    });
    first.settle();
    // A cancel is a wake from elsewhere.
    let cancelled = first.spawn(ProcessSpec::new("cancelled"), || async {
        unreachable!("cancelled before the release")
    });
    first.settle();
    cancelled.cancel();
    let other = second.spawn(
        ProcessSpec::new("opener"),
        move || async move { gate.open() },
    );
    second.release();
    other.wait();
    assert_eq!((process.polls(), process.state()), (0, ProcessState::Ready));
    first.release();
    assert_eq!(process.wait(), Exit::Completed);
    assert_eq!((cancelled.wait(), cancelled.polls()), (Exit::Cancelled, 0));
}

#[test]
fn a_wake_after_the_end_does_nothing() {
    let _watchdog = watchdog();
    let executor = executor();
    let wakers = Log::new();
    let own = wakers.clone();
    let process = executor.spawn(ProcessSpec::new("short"), move || async move {
        yield_now().await;
        poll_fn(|cx| {
            own.add(cx.waker().clone());
            Poll::Ready(())
        })
        .await;
    });
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    let polls = process.polls();
    let waker = wakers.take().pop().unwrap();
    waker.wake_by_ref();
    executor.stop();
    waker.wake_by_ref();
    waker.wake();
    assert_eq!(
        (process.polls(), process.state()),
        (polls, ProcessState::Ended)
    );
}

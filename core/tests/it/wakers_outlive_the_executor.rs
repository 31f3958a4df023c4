//! Wakers that others keep when their process, and its executor, are gone: nothing leaks, nothing
//! is freed twice.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Exit, ProcessSpec, yield_now};
use std::future::poll_fn;
use std::sync::Arc;
use std::task::{Poll, Waker};
use support::{Drops, Gate, Log, Random, executor, rounds, until, watchdog};

#[test]
fn clones_are_used_and_dropped_on_other_threads_after_the_executor() {
    let _watchdog = watchdog();
    for _ in 0..rounds(50) {
        let (gate, drops, kept) = (Gate::default(), Drops::default(), Arc::new(()));
        let executor = executor();
        let processes: Vec<_> = (0..8)
            .map(|n| {
                let (gate, token, kept) = (gate.clone(), drops.token(), kept.clone());
                executor.spawn(ProcessSpec::new("left"), move || async move {
                    let _both = (token, kept);
                    if n % 2 == 0 {
                        yield_now().await;
                    }
                    gate.pass().await;
                })
            })
            .collect();
        executor.release();
        until(|| gate.waiting() == 8);
        let threads: Vec<_> = (0..3)
            .map(|_| {
                let wakers: Vec<Waker> = gate.wakers();
                let stopped = Gate::default();
                let wait = stopped.clone();
                let thread = std::thread::spawn(move || {
                    futures_lite::future::block_on(wait.pass());
                    let again = wakers.clone();
                    again.iter().for_each(Waker::wake_by_ref);
                    drop(wakers);
                    again.into_iter().for_each(Waker::wake);
                });
                (thread, stopped)
            })
            .collect();
        executor.stop();
        assert!(
            processes
                .iter()
                .all(|process| process.wait() == Exit::Cancelled)
        );
        assert_eq!(
            (drops.count(), Arc::strong_count(&kept)),
            (8, 1),
            "the futures were dropped by the stop"
        );
        for (thread, stopped) in threads {
            stopped.open();
            thread.join().unwrap();
        }
        assert_eq!(drops.count(), 8);
    }
}

#[test]
fn wakes_and_drops_race_with_the_stop() {
    let _watchdog = watchdog();
    let mut random = Random::seeded();
    for _ in 0..rounds(200) {
        let (wakers, drops) = (Log::<Waker>::new(), Drops::default());
        let executor = executor();
        for n in 0..6 {
            let (wakers, token) = (wakers.clone(), drops.token());
            executor.spawn(ProcessSpec::new("raced").level(n), move || async move {
                let _token = token;
                poll_fn(|cx| {
                    wakers.add(cx.waker().clone());
                    Poll::<()>::Pending
                })
                .await;
            });
        }
        executor.release();
        until(|| wakers.len() >= 6);
        let threads: Vec<_> = (0..2)
            .map(|_| {
                let (wakers, mut random) = (wakers.clone(), random.split());
                std::thread::spawn(move || {
                    for _ in 0..random.below(100) {
                        wakers.take().into_iter().for_each(Waker::wake);
                    }
                })
            })
            .collect();
        if random.below(2) == 0 {
            executor.stop();
        } else {
            drop(executor);
        }
        assert_eq!(drops.count(), 6);
        threads
            .into_iter()
            .for_each(|thread| thread.join().unwrap());
    }
}

#[test]
fn a_process_that_keeps_its_own_waker_is_freed() {
    let _watchdog = watchdog();
    let drops = Drops::default();
    let executor = executor();
    for ends in [true, false] {
        let token = drops.token();
        executor.spawn(ProcessSpec::new("circle"), move || async move {
            let _token = token;
            let own = poll_fn(|cx| Poll::Ready(cx.waker().clone())).await;
            if !ends {
                std::future::pending::<()>().await;
            }
            drop(own);
        });
    }
    executor.release();
    executor.stop();
    assert_eq!(drops.count(), 2);
}

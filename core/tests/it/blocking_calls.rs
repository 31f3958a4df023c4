//! Blocking calls made on buddy threads.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Exit, ProcessSpec, block_on, blocking, prepare_blocking, yield_now};
use std::sync::mpsc;
use std::sync::{Arc, Barrier};
use support::{Drops, Gate, Log, executor, poll_once, quiet_panics, until, watchdog};

#[test]
fn calls_run_at_the_same_time_and_the_executor_goes_on() {
    let _watchdog = watchdog();
    prepare_blocking().unwrap();
    let executor = executor();
    // Each call waits for the others: one after the other they would never end.
    let barrier = Arc::new(Barrier::new(9));
    let processes: Vec<_> = (0..8)
        .map(|n| {
            let barrier = barrier.clone();
            executor.spawn(ProcessSpec::new("calls"), move || async move {
                let answer = blocking(move || {
                    barrier.wait();
                    n * 2
                });
                assert_eq!(answer.await, n * 2);
            })
        })
        .collect();
    let others = executor.spawn(ProcessSpec::new("goes on").level(1), || async {
        for _ in 0..10 {
            yield_now().await;
        }
    });
    executor.release();
    assert_eq!(others.wait(), Exit::Completed);
    assert!(processes.iter().all(|process| process.exit().is_none()));
    barrier.wait();
    assert!(
        processes
            .iter()
            .all(|process| process.wait() == Exit::Completed)
    );
    assert!(processes.iter().all(|process| process.polls() == 2));
}

#[test]
fn a_call_that_waits_for_later_calls() {
    let _watchdog = watchdog();
    fn nested(depth: u32) -> u32 {
        if depth == 0 {
            return 0;
        }
        // A buddy is a plain thread: it may block on processes with calls that need other buddies.
        1 + block_on(async move { blocking(move || nested(depth - 1)).await }).unwrap()
    }
    assert_eq!(block_on(async { blocking(|| nested(20)).await }), Ok(20));
}

#[test]
fn a_panic_passes_to_the_one_that_awaits_and_the_buddies_go_on() {
    let _watchdog = watchdog();
    quiet_panics();
    let executor = executor();
    executor.release();
    for _ in 0..100 {
        let process = executor.spawn(ProcessSpec::new("calls"), || async {
            blocking(|| panic!("on purpose, in a call")).await;
        });
        assert_eq!(
            process.wait(),
            Exit::Panicked("on purpose, in a call".into())
        );
    }
    assert_eq!(block_on(async { blocking(|| 5).await }), Ok(5));
}

#[test]
fn dropped_before_the_end_the_result_is_forgotten() {
    let _watchdog = watchdog();
    let drops = Drops::default();
    let (token, result) = (drops.token(), drops.token());
    let (go_on, wait) = mpsc::channel::<()>();
    let (started, has_started) = mpsc::channel();
    block_on(async {
        let mut call = Box::pin(blocking(move || {
            let _token = token;
            started.send(()).unwrap();
            let _ = wait.recv();
            result
        }));
        assert!(poll_once(&mut call).await.is_none());
        has_started.recv().unwrap();
        assert!(poll_once(&mut call).await.is_none());
    })
    .unwrap();
    assert_eq!(drops.count(), 0, "a call that has started runs to its end");
    drop(go_on);
    until(|| drops.count() == 2);
}

#[test]
fn one_that_is_never_polled_is_never_made() {
    let drops = Drops::default();
    let token = drops.token();
    drop(blocking(move || drop(token)));
    assert_eq!(drops.count(), 1);
}

#[test]
fn a_forgotten_result_whose_drop_panics_costs_no_buddy() {
    let _watchdog = watchdog();
    quiet_panics();
    struct Bad(Log<()>);
    impl Drop for Bad {
        fn drop(&mut self) {
            self.0.add(());
            panic!("on purpose, in the result");
        }
    }
    let (dropped, gate) = (Log::new(), Gate::default());
    let calls = luna_core::MAX_BUDDIES + 10;
    for _ in 0..calls {
        let (own, wait) = (dropped.clone(), gate.clone());
        block_on(async {
            let mut call = Box::pin(blocking(move || {
                futures_lite::future::block_on(wait.pass());
                Bad(own)
            }));
            assert!(poll_once(&mut call).await.is_none());
        })
        .unwrap();
    }
    gate.open();
    until(|| dropped.len() == calls);
    assert_eq!(block_on(async { blocking(|| 1).await }), Ok(1));
}

#[test]
fn cancelled_while_it_waits_for_a_call() {
    let _watchdog = watchdog();
    let executor = executor();
    executor.release();
    let (go_on, wait) = mpsc::channel::<()>();
    let process = executor.spawn(ProcessSpec::new("calls"), || async move {
        let _ = blocking(move || wait.recv()).await;
    });
    until(|| process.polls() == 1);
    process.cancel();
    assert_eq!(process.wait(), Exit::Cancelled);
    drop(go_on);
}

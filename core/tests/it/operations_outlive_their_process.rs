//! An operation that is polled by a process, moved out of it, and left waiting when the process is
//! gone: it wakes no process, and the next task that polls it goes on with it.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Executor, Exit, ProcessHandle, ProcessSpec, block_on};
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use support::{Gate, Log, executor, poll_once, rounds, watchdog};

/// A join that can go anywhere.
type Moved = Pin<Box<dyn Future<Output = Exit> + Send>>;

fn join(process: &ProcessHandle) -> Moved {
    let process = process.clone();
    Box::pin(async move { process.join().await })
}

/// A process that waits at a gate.
fn joined(executor: &Executor, gate: &Gate) -> ProcessHandle {
    let gate = gate.clone();
    executor.spawn(ProcessSpec::new("joined"), move || async move {
        gate.pass().await
    })
}

#[test]
fn left_behind_by_block_on() {
    let _watchdog = watchdog();
    let (executor, gate) = (executor(), Gate::default());
    let joined = joined(&executor, &gate);
    executor.release();
    let mut left = join(&joined);
    assert_eq!(block_on(poll_once(&mut left)), Ok(None));
    // Another process in the place of the first: it is not taken for it.
    let polls = Arc::new(AtomicUsize::new(0));
    let mut inner = join(&joined);
    let exit = block_on(std::future::poll_fn(|cx| {
        if polls.fetch_add(1, Ordering::SeqCst) == 0 {
            gate.open();
        }
        inner.as_mut().poll(cx)
    }));
    assert_eq!(exit, Ok(Exit::Completed));
    assert!(polls.load(Ordering::SeqCst) <= 2);
    assert_eq!(block_on(left), Ok(Exit::Completed));
}

#[test]
fn left_behind_by_processes_of_executors_that_end_and_are_freed() {
    let _watchdog = watchdog();
    for round in 0..rounds(100) {
        let (executor_one, gate, moved) = (executor(), Gate::default(), Log::<Moved>::new());
        let joined = joined(&executor_one, &gate);
        executor_one.release();
        {
            let other = executor();
            let place = if round % 2 == 0 {
                &executor_one
            } else {
                &other
            };
            for _ in 0..10 {
                let (moved, joined) = (moved.clone(), joined.clone());
                place.spawn(ProcessSpec::new("leaves"), move || async move {
                    let mut left = join(&joined);
                    assert!(poll_once(&mut left).await.is_none());
                    moved.add(left);
                });
            }
            other.release();
            support::until(|| moved.len() == 10);
        }
        // The processes have ended; a spawn frees what is left of them, and its process takes over
        // a place.
        support::until(|| {
            executor_one
                .spawn(ProcessSpec::new("next"), || async {})
                .wait()
                == Exit::Completed
        });
        let mut left = moved.take();
        left.truncate(7);
        gate.open();
        joined.wait();
        for one in left {
            assert_eq!(block_on(one), Ok(Exit::Completed));
        }
    }
}

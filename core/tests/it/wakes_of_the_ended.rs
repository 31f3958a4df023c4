//! A process that ended in the turn in which a branch of it yielded: a waker of it that others keep
//! does not queue it again.

#![cfg(not(loom))]

use crate::support;
use luna_core::{Exit, ProcessSpec, current, yield_now};
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::task::{Poll, Waker};
use support::{executor, watchdog};

#[test]
fn a_more_urgent_wake_does_not_queue_it() {
    let _watchdog = watchdog();
    let kept: Arc<Mutex<Option<Waker>>> = Arc::default();
    let executor = executor();
    let keeps = kept.clone();
    let ends = executor.spawn(ProcessSpec::new("ends").level(10), move || async move {
        poll_fn(|cx| {
            *keeps.lock().unwrap() = Some(cx.waker().clone());
            // A branch below the process yields, and queues the process at its level.
            let branch = pin!(yield_now());
            let _ = current::with_branch_below(false, 3, 0, || branch.poll(cx));
            Poll::Ready(())
        })
        .await;
    });
    let wakes = executor.spawn(ProcessSpec::new("wakes").level(5), move || async move {
        kept.lock().unwrap().take().unwrap().wake();
        // Were it queued, it would have its turn here.
        for _ in 0..5 {
            yield_now().await;
        }
    });
    executor.release();
    assert_eq!(
        (ends.wait(), wakes.wait()),
        (Exit::Completed, Exit::Completed)
    );
}

//! An operation that fails without having waited is a scheduling point as one that succeeds is: a
//! loop over errors does not keep other processes of its executor from running.

#![cfg(not(loom))]

use crate::common;
use common::Watchdog;
use luna_channels::{Alternative, Receiver, Sender, alt, call_channel, channel};
use luna_core::current::{self, OPERATIONS_PER_POLL};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::Poll;
use std::time::Duration;

/// Far more errors than one may have in one go.
const TOO_MANY: u32 = OPERATIONS_PER_POLL * 10;

fn closed() -> (Sender<u8>, Receiver<u8>) {
    let (sender, receiver) = channel();
    let (other, gone) = channel();
    drop(sender);
    drop(gone);
    (other, receiver)
}

fn poisoned() -> (Sender<u8>, Receiver<u8>) {
    let (sender, receiver) = channel();
    sender.poison();
    (sender, receiver)
}

/// Fails again and again beside another process of its level, and after it has woken one of a
/// higher level.
fn check(what: &str, fails: impl AsyncFn() + Send + 'static) {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("errors")).unwrap();
    let (ready, readied) = channel::<()>();
    let [has_run, has_come] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let (beside, above) = (has_run.clone(), has_come.clone());
    let name = what.to_owned();
    let failing = executor.spawn(ProcessSpec::new("fails").level(5), move || async move {
        let mut errors = 0;
        while !has_run.load(Ordering::Relaxed) {
            fails().await;
            errors += 1;
            assert!(errors < TOO_MANY, "{name}: its equal does not run");
        }
        ready.try_send(()).unwrap();
        fails().await;
        assert!(has_come.load(Ordering::Relaxed), "{name}: the urgent waits");
    });
    let equal = executor.spawn(ProcessSpec::new("equal").level(5), move || async move {
        beside.store(true, Ordering::Relaxed);
    });
    let urgent = executor.spawn(ProcessSpec::new("urgent").level(9), move || async move {
        readied.recv().await.unwrap();
        above.store(true, Ordering::Relaxed);
    });
    executor.release();
    for process in [failing, equal, urgent] {
        assert_eq!(process.wait(), Exit::Completed, "{what}");
    }
    executor.stop();
}

#[test]
fn sends_and_receives_that_fail() {
    for (how, ends) in [("closed", closed as fn() -> _), ("poisoned", poisoned)] {
        let (_keep, receiver) = ends();
        check(&format!("recv, {how}"), async move || {
            assert!(receiver.recv().await.is_err());
        });
        let (_keep, receiver) = ends();
        check(&format!("recv_timeout, {how}"), async move || {
            let received = receiver.recv_timeout(Duration::ZERO).await;
            assert!(!received.unwrap_err().is_timeout());
        });
        let (_keep, receiver) = ends();
        check(&format!("extended, {how}"), async move || {
            assert!(receiver.recv_extended().await.is_err());
        });
        let (sender, _keep) = ends();
        check(&format!("send, {how}"), async move || {
            assert_eq!(sender.send(3).await.unwrap_err().into_inner(), 3);
        });
        let (sender, _keep) = ends();
        check(&format!("send_timeout, {how}"), async move || {
            let sent = sender.send_timeout(3, Duration::ZERO).await;
            assert!(!sent.unwrap_err().is_timeout());
        });
        let (sender, receiver) = ends();
        check(&format!("alt!, {how}"), async move || {
            alt! {
                sent = sender.send(3) => assert!(sent.is_err()),
                received = receiver.recv() => assert!(received.is_err()),
            }
        });
        let (sender, _keep) = ends();
        check(&format!("ended, {how}"), async move || {
            sender.ended().await;
        });
    }
}

#[test]
fn calls_that_fail() {
    let (client, server) = call_channel::<u8, u8>();
    drop(server);
    check("call", async move || {
        assert!(client.call(1).await.is_err());
    });
    let (client, server) = call_channel::<u8, u8>();
    drop(client);
    check("accept", async move || {
        assert!(server.accept().await.is_err());
    });
}

#[test]
fn an_alternative_whose_channels_have_all_ended() {
    for (how, ends) in [("closed", closed as fn() -> _), ("poisoned", poisoned)] {
        for is_fair in [true, false] {
            let (_keep, inputs) = (0..3).map(|_| ends()).unzip::<_, _, Vec<_>, Vec<_>>();
            let inputs: &'static [_] = Box::leak(inputs.into_boxed_slice());
            let alternative = match is_fair {
                true => Alternative::fair(inputs),
                false => Alternative::prioritized(inputs),
            };
            let alternative = std::sync::Mutex::new(Some(alternative));
            check(&format!("alternative, {how}"), async move || {
                let mut taken = alternative.lock().unwrap().take().unwrap();
                assert!(taken.recv().await.1.is_err());
                *alternative.lock().unwrap() = Some(taken);
            });
        }
    }
}

/// A branch that is polled first leaves the others no operation in any turn.
#[test]
fn an_end_comes_beside_a_branch_that_spends_all_operations() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("errors")).unwrap();
    let process = executor.spawn(ProcessSpec::new("both"), || async move {
        let (sender, _keep) = closed();
        let mut end = pin!(sender.ended());
        for _ in 0..3 {
            let found = poll_fn(|cx| {
                while current::count_operation() {}
                Poll::Ready(end.as_mut().poll(cx).is_ready())
            });
            if found.await {
                return;
            }
            luna_core::yield_now().await;
        }
        panic!("it never ends");
    });
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    executor.stop();
}

#[test]
fn that_a_branch_had_failed_is_nothing_to_the_one_that_selects_later() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("errors")).unwrap();
    let process = executor.spawn(ProcessSpec::new("selects"), || async move {
        let (sender, receiver) = channel::<u8>();
        let inputs = [receiver];
        let mut alternative = Alternative::fair(&inputs);
        poll_fn(|cx| {
            while current::count_operation() {}
            let polled =
                current::with_branch_below(true, 0, 0, || pin!(alternative.recv()).poll(cx));
            assert!(polled.is_pending(), "it lets others run first");
            Poll::Ready(())
        })
        .await;
        luna_core::yield_now().await;
        poll_fn(|cx| {
            let polled = pin!(alternative.recv()).poll(cx);
            assert_eq!(polled, Poll::Pending, "its channel is open");
            Poll::Ready(())
        })
        .await;
        drop(sender);
        assert!(alternative.recv().await.1.is_err());
    });
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    executor.stop();
}

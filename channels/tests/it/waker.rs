//! The wakers of waiting operations: what they do as they wake or are dropped does no harm, and
//! they may outlive the tasks that they wake.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Watchdog, pending, poll, poll_with, ready};
use luna_channels::{Sender, TryRecvError, channel};
use luna_core::current;
use luna_core::{Executor, ProcessSpec};
use luna_platform::thread::Attributes;
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::{Arc, Mutex, mpsc};
use std::task::{Poll, Wake, Waker};
use std::thread;

/// Polls an operation once within a process of `executor`, or on a thread of its own, lets that
/// end, and gives the operation.
fn polled_by_a_process_that_has_ended<F: Future + Send + 'static>(
    on_executor: bool,
    mut operation: Pin<Box<F>>,
) -> Pin<Box<F>> {
    let (hand_out, handed_out) = mpsc::channel();
    let body = async move || {
        poll_fn(|cx| {
            assert!(operation.as_mut().poll(cx).is_pending());
            Poll::Ready(())
        })
        .await;
        hand_out.send(operation).unwrap();
    };
    if on_executor {
        let executor = Executor::start(Attributes::new("short-lived")).unwrap();
        executor.spawn(ProcessSpec::new("polls once"), body);
        executor.release();
        let operation = handed_out.recv().unwrap();
        executor.stop();
        operation
    } else {
        thread::spawn(|| luna_core::block_on(body()).unwrap())
            .join()
            .unwrap();
        handed_out.recv().unwrap()
    }
}

#[test]
fn an_operation_may_outlive_the_process_that_polled_it() {
    // Its node then names a waker of a task that is gone: a memory checker sees what this test
    // alone may not.
    let _watchdog = Watchdog::new();
    for on_executor in [true, false] {
        for dropped in [true, false] {
            let (sender, receiver) = channel::<u32>();
            let (sender, receiver) = (Arc::new(sender), Arc::new(receiver));
            let (its_sender, its_receiver) = (sender.clone(), receiver.clone());
            let recv = Box::pin(async move { its_receiver.recv().await });
            let mut recv = polled_by_a_process_that_has_ended(on_executor, recv);
            if dropped {
                drop(recv);
                assert!(sender.try_send(1).unwrap_err().is_full());
            } else {
                sender.try_send(1).unwrap();
                assert_eq!(ready(&mut recv), Ok(1));
            }
            let send = Box::pin(async move { its_sender.send(2).await });
            let mut send = polled_by_a_process_that_has_ended(on_executor, send);
            if dropped {
                drop(send);
                assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
            } else {
                assert_eq!(receiver.try_recv(), Ok(2));
                assert_eq!(ready(&mut send), Ok(()));
            }
        }
    }
}

/// A waker that runs a closure as it is dropped: as the last reference to another task might.
struct Last<F: FnMut() + Send + 'static>(Mutex<F>);

impl<F: FnMut() + Send + 'static> Wake for Last<F> {
    fn wake(self: Arc<Self>) {}
}

impl<F: FnMut() + Send + 'static> Drop for Last<F> {
    fn drop(&mut self) {
        (self.0.get_mut().unwrap())();
    }
}

#[test]
fn no_waker_is_dropped_under_the_lock() {
    fn waker(sender: &Sender<u8>) -> Waker {
        let sender = sender.clone();
        Waker::from(Arc::new(Last(Mutex::new(move || {
            assert!(sender.try_send(9).is_err())
        }))))
    }
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel::<u8>();
    // Replaced by another one.
    let mut send = Box::pin(sender.send(1));
    let first = waker(&sender);
    assert!(poll_with(&mut send, &first).is_pending());
    drop(first);
    pending(&mut send);
    drop(send);
    // Withdrawn with its operation.
    let mut send = Box::pin(sender.send(1));
    let last = waker(&sender);
    assert!(poll_with(&mut send, &last).is_pending());
    drop(last);
    drop(send);
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
}

/// A waker that panics when it is dropped.
struct PanicsAsItIsDropped;

impl Wake for PanicsAsItIsDropped {
    fn wake(self: Arc<Self>) {}
}

impl Drop for PanicsAsItIsDropped {
    fn drop(&mut self) {
        panic!("a waker's drop");
    }
}

#[test]
fn an_operation_is_withdrawn_once_though_the_drop_of_its_waker_panics() {
    let (sender, receiver) = channel();
    let mut recvs: Vec<_> = (0..3).map(|_| Box::pin(receiver.recv())).collect();
    pending(&mut recvs[0]);
    let waker = Waker::from(Arc::new(PanicsAsItIsDropped));
    assert!(poll_with(&mut recvs[1], &waker).is_pending());
    drop(waker);
    pending(&mut recvs[2]);
    let withdrawn = catch_unwind(AssertUnwindSafe(|| {
        current::with_branch_below(true, 0, 0, || poll(&mut recvs[1]).is_ready())
    }));
    assert!(withdrawn.is_err());
    drop(recvs.remove(1));
    // The others still wait.
    assert_eq!([sender.try_send(1), sender.try_send(2)], [Ok(()), Ok(())]);
    assert_eq!([ready(&mut recvs[0]), ready(&mut recvs[1])], [Ok(1), Ok(2)]);
}

/// A waker that panics when it wakes.
struct PanicsAsItWakes;

impl Wake for PanicsAsItWakes {
    fn wake(self: Arc<Self>) {
        panic!("a waker's wake");
    }
}

#[test]
fn a_receive_that_fails_as_it_wakes_its_sender_puts_the_value_back() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    let waker = Waker::from(Arc::new(PanicsAsItWakes));
    let mut send = Box::pin(sender.send(ledger.token(0)));
    assert!(poll_with(&mut send, &waker).is_pending());
    let mut recv = Box::pin(receiver.recv());
    assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut recv))).is_err());
    drop(recv);
    assert!(ready(&mut send).is_ok());
    assert_eq!(receiver.try_recv().unwrap().id, 0);
    ledger.assert_all_dropped_once();
}

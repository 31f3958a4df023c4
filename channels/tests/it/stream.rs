//! A receiver as a stream.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Wakes, Watchdog, pending};
use futures_core::Stream;
use futures_lite::future::{block_on, zip};
use futures_lite::{StreamExt, pin};
use luna_channels::{Buffer, RecvError, TryRecvError, buffered, channel};
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

fn poll_next<S: Stream>(stream: Pin<&mut S>, waker: &Waker) -> Poll<Option<S::Item>> {
    stream.poll_next(&mut Context::from_waker(waker))
}

#[test]
fn gives_all_values_in_order_and_ends_with_the_channel() {
    let _watchdog = Watchdog::new();
    for (sender, receiver) in [channel(), buffered(Buffer::fifo(2))] {
        let produce = async move {
            for n in 0..5 {
                sender.send(n).await.unwrap();
            }
        };
        let (values, ()) = block_on(zip(receiver.stream().collect::<Vec<_>>(), produce));
        assert_eq!(values, [0, 1, 2, 3, 4]);
    }
}

#[test]
fn stays_ended() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel::<u8>();
    let stream = receiver.stream();
    pin!(stream);
    drop(sender);
    for _ in 0..3 {
        assert_eq!(block_on(stream.next()), None);
    }
}

#[test]
fn ends_when_poisoned_and_the_receiver_says_why() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = buffered(Buffer::fifo(1));
    sender.try_send(1).unwrap();
    sender.poison();
    assert_eq!(block_on(receiver.stream().count()), 0);
    assert_eq!(block_on(receiver.recv()), Err(RecvError::Poisoned));
}

#[test]
fn waits_and_is_woken_once_for_each_value() {
    let (sender, receiver) = channel();
    let stream = receiver.stream();
    pin!(stream);
    let (wakes, waker) = Wakes::new();
    for n in 0..3 {
        assert!(poll_next(stream.as_mut(), &waker).is_pending());
        assert!(poll_next(stream.as_mut(), &waker).is_pending());
        sender.try_send(n).unwrap();
        assert_eq!(wakes.count(), n + 1);
        assert_eq!(poll_next(stream.as_mut(), &waker), Poll::Ready(Some(n)));
    }
}

#[test]
fn dropped_while_it_waits_it_leaves_no_trace() {
    let (sender, receiver) = channel();
    {
        let stream = receiver.stream();
        pin!(stream);
        assert!(poll_next(stream.as_mut(), Waker::noop()).is_pending());
    }
    assert!(sender.try_send(1).unwrap_err().is_full());
}

#[test]
fn dropped_with_a_value_it_gives_it_back() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    {
        let stream = receiver.stream();
        pin!(stream);
        assert!(poll_next(stream.as_mut(), Waker::noop()).is_pending());
        sender.try_send(ledger.token(0)).unwrap();
    }
    assert_eq!(receiver.try_recv().unwrap().id, 0);
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
    ledger.assert_all_dropped_once();
}

#[test]
fn two_streams_and_a_plain_receive_share_the_values() {
    let (sender, receiver) = channel();
    let (first, second) = (receiver.stream(), receiver.stream());
    pin!(first, second);
    let mut recv = Box::pin(receiver.recv());
    assert!(poll_next(first.as_mut(), Waker::noop()).is_pending());
    pending(&mut recv);
    assert!(poll_next(second.as_mut(), Waker::noop()).is_pending());
    for n in 0..3 {
        sender.try_send(n).unwrap();
    }
    assert_eq!(poll_next(first, Waker::noop()), Poll::Ready(Some(0)));
    assert_eq!(common::ready(&mut recv), Ok(1));
    assert_eq!(poll_next(second, Waker::noop()), Poll::Ready(Some(2)));
}

//! Channels without a buffer: a send ends when a receiver has taken the value, not before.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Wakes, Watchdog, pending, poll_with, ready};
use futures_lite::future::{block_on, zip};
use luna_channels::{RecvError, TryRecvError, TrySendError, channel};
use std::task::Poll;

#[test]
fn a_send_completes_only_after_its_value_was_taken() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let mut send = Box::pin(sender.send(1));
    for _ in 0..3 {
        assert!(poll_with(&mut send, &waker).is_pending());
    }
    assert_eq!(wakes.count(), 0);
    assert_eq!(receiver.try_recv(), Ok(1));
    assert_eq!(wakes.count(), 1, "the taking wakes the sender, once");
    assert_eq!(poll_with(&mut send, &waker), Poll::Ready(Ok(())));
}

#[test]
fn a_receiver_that_waits_is_given_the_value_and_woken_once() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let mut recv = Box::pin(receiver.recv());
    assert!(poll_with(&mut recv, &waker).is_pending());
    assert_eq!(sender.try_send(7), Ok(()));
    assert_eq!(wakes.count(), 1);
    assert!(
        sender.try_send(8).unwrap_err().is_full(),
        "one offer takes one value"
    );
    assert_eq!(poll_with(&mut recv, &waker), Poll::Ready(Ok(7)));
}

#[test]
fn nothing_is_buffered() {
    let (sender, receiver) = channel();
    assert_eq!(sender.try_send(1), Err(TrySendError::Full(1)));
    let mut send = Box::pin(sender.send(2));
    pending(&mut send);
    assert_eq!(receiver.buffered(), 0);
    assert_eq!(receiver.try_recv(), Ok(2));
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
}

#[test]
fn those_that_wait_are_served_in_the_order_of_their_arrival() {
    let (sender, receiver) = channel();
    let mut sends: Vec<_> = (0..4).map(|n| Box::pin(sender.send(n))).collect();
    for index in [2, 0, 3, 1] {
        pending(&mut sends[index]);
    }
    // Being polled again is no new arrival.
    pending(&mut sends[2]);
    assert_eq!([(); 4].map(|()| receiver.try_recv().unwrap()), [2, 0, 3, 1]);
    drop(sends);

    let mut recvs: Vec<_> = (0..4).map(|_| Box::pin(receiver.recv())).collect();
    for index in [3, 1, 0, 2] {
        pending(&mut recvs[index]);
    }
    for value in 0..4 {
        sender.try_send(value).unwrap();
    }
    assert_eq!(
        [3, 1, 0, 2].map(|index| ready(&mut recvs[index])),
        [0, 1, 2, 3].map(Ok)
    );
}

#[test]
fn an_operation_does_nothing_before_its_first_poll() {
    let (sender, receiver) = channel();
    let (_send, _recv) = (sender.send(1), receiver.recv());
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    assert_eq!(sender.try_send(2), Err(TrySendError::Full(2)));
}

#[test]
fn one_that_polled_last_is_woken() {
    let (sender, receiver) = channel();
    let ((first, first_waker), (second, second_waker)) = (Wakes::new(), Wakes::new());
    let mut recv = Box::pin(receiver.recv());
    assert!(poll_with(&mut recv, &first_waker).is_pending());
    assert!(poll_with(&mut recv, &second_waker).is_pending());
    sender.try_send(1).unwrap();
    assert_eq!((first.count(), second.count()), (0, 1));

    let mut send = Box::pin(sender.send(2));
    drop(recv);
    assert_eq!(receiver.try_recv(), Ok(1)); // given back by the receive that was dropped
    assert!(poll_with(&mut send, &first_waker).is_pending());
    assert!(poll_with(&mut send, &second_waker).is_pending());
    assert_eq!(receiver.try_recv(), Ok(2));
    assert_eq!((first.count(), second.count()), (0, 2));
}

#[test]
fn values_without_size_are_counted_all_the_same() {
    let (sender, receiver) = channel::<()>();
    assert!(sender.try_send(()).unwrap_err().is_full());
    let mut sends: Vec<_> = (0..3).map(|_| Box::pin(sender.send(()))).collect();
    sends.iter_mut().for_each(pending);
    for _ in 0..3 {
        assert_eq!(receiver.try_recv(), Ok(()));
    }
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    assert!(sends.iter_mut().all(|send| ready(send).is_ok()));
}

#[test]
fn big_values_and_values_of_great_alignment_arrive_whole() {
    #[repr(align(128))]
    #[derive(Clone, PartialEq, Debug)]
    struct Wide(u8);

    let (sender, receiver) = channel();
    let big: [u64; 4096] = std::array::from_fn(|n| n as u64);
    let mut send = Box::pin(sender.send(big));
    pending(&mut send);
    assert!(receiver.try_recv().unwrap() == big);

    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(Wide(9)).unwrap();
    assert_eq!(ready(&mut recv), Ok(Wide(9)));
}

#[test]
fn each_value_is_dropped_once_and_by_the_one_that_has_it() {
    let _watchdog = Watchdog::new();
    let ledger = Ledger::new(3);
    let (sender, receiver) = channel();
    let (sent, received) = block_on(zip(sender.send(ledger.token(0)), receiver.recv()));
    sent.unwrap();
    assert_eq!(ledger.dropped(), []);
    drop(received);
    assert_eq!(ledger.dropped(), [0]);

    let error = sender.try_send(ledger.token(1)).unwrap_err();
    assert_eq!(ledger.dropped(), [0]);
    assert_eq!(error.into_inner().id, 1);
    drop(receiver);
    let error = block_on(sender.send(ledger.token(2))).unwrap_err();
    assert_eq!(ledger.dropped(), [0, 1]);
    drop(error);
    ledger.assert_all_dropped_once();
}

#[test]
fn values_may_borrow() {
    let text = String::from("borrowed");
    let (sender, receiver) = channel::<&str>();
    assert_eq!(
        block_on(zip(sender.send(&text), receiver.recv())).1,
        Ok("borrowed")
    );
}

#[test]
#[should_panic(expected = "a receive was polled after it was over")]
fn a_receive_that_is_over_must_not_be_polled() {
    let (sender, receiver) = channel::<u8>();
    drop(sender);
    let mut recv = Box::pin(receiver.recv());
    assert_eq!(ready(&mut recv), Err(RecvError::Closed));
    let _ = common::poll(&mut recv);
}

#[test]
#[should_panic(expected = "a send was polled after it was over")]
fn a_send_that_is_over_must_not_be_polled() {
    let (sender, receiver) = channel::<u8>();
    drop(receiver);
    let mut send = Box::pin(sender.send(1));
    assert!(ready(&mut send).unwrap_err().is_closed());
    let _ = common::poll(&mut send);
}

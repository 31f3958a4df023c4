//! The end of a channel: by the drop of its last sender or its last receiver, seen from both sides.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Token, Wakes, Watchdog, pending, poll_with, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, Receiver, RecvError, Sender, TryRecvError, TrySendError, buffered, channel,
};
use std::task::Poll;
use std::thread;

/// A rendezvous, and buffers of each kind.
fn channels<T: Send>() -> Vec<(Sender<T>, Receiver<T>)> {
    let mut channels = vec![channel()];
    for buffer in [
        Buffer::fifo(1),
        Buffer::fifo(3),
        Buffer::overwrite_oldest(1),
        Buffer::overwrite_newest(3),
    ] {
        channels.push(buffered(buffer));
    }
    channels
}

#[test]
fn the_last_sender_closes_and_not_one_before() {
    let _watchdog = Watchdog::new();
    for (sender, receiver) in channels::<u8>() {
        let clones = [sender.clone(), sender.clone()];
        drop(sender);
        for clone in clones {
            assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
            drop(clone);
        }
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Closed));
        assert_eq!(block_on(receiver.recv()), Err(RecvError::Closed));
        assert_eq!(receiver.blocking_recv(), Err(RecvError::Closed));
    }
}

#[test]
fn the_last_receiver_closes_and_values_come_back() {
    let _watchdog = Watchdog::new();
    for (sender, receiver) in channels::<u8>() {
        let clone = receiver.clone();
        drop(receiver);
        assert!(!matches!(sender.try_send(1), Err(TrySendError::Closed(_))));
        drop(clone);
        assert_eq!(sender.try_send(2), Err(TrySendError::Closed(2)));
        let error = block_on(sender.send(3)).unwrap_err();
        assert!(error.is_closed() && !error.is_poisoned());
        assert_eq!(error.into_inner(), 3);
        assert_eq!(sender.blocking_send(4).unwrap_err().value, 4);
    }
}

#[test]
fn all_receivers_that_wait_are_woken_once_by_the_close() {
    for (sender, receiver) in channels::<u8>() {
        let (wakes, waker) = Wakes::new();
        let mut recvs: Vec<_> = (0..3).map(|_| Box::pin(receiver.recv())).collect();
        for recv in &mut recvs {
            assert!(poll_with(recv, &waker).is_pending());
        }
        drop(sender);
        assert_eq!(wakes.count(), 3);
        for recv in &mut recvs {
            assert_eq!(poll_with(recv, &waker), Poll::Ready(Err(RecvError::Closed)));
        }
    }
}

#[test]
fn all_senders_that_wait_get_their_values_back() {
    let ledger = Ledger::new(4);
    for (full, (sender, receiver)) in [channel(), buffered(Buffer::fifo(1))]
        .into_iter()
        .enumerate()
    {
        let base = full * 2;
        if full == 1 {
            sender.try_send(Ok(())).unwrap();
        }
        let (wakes, waker) = Wakes::new();
        let mut sends: Vec<_> = (0..2)
            .map(|n| Box::pin(sender.send(Err(ledger.token(base + n)))))
            .collect();
        for send in &mut sends {
            assert!(poll_with(send, &waker).is_pending());
        }
        drop(receiver);
        assert_eq!(wakes.count(), 2);
        for (n, send) in sends.iter_mut().enumerate() {
            let error = ready(send).unwrap_err();
            assert!(error.is_closed());
            assert_eq!(error.into_inner().unwrap_err().id, base + n);
        }
    }
    ledger.assert_all_dropped_once();
}

#[test]
fn waiting_senders_that_nobody_polls_again_drop_their_values_once() {
    let ledger = Ledger::new(2);
    let (sender, receiver) = channel();
    let mut sends: Vec<_> = (0..2)
        .map(|n| Box::pin(sender.send(ledger.token(n))))
        .collect();
    sends.iter_mut().for_each(pending);
    drop(receiver);
    assert_eq!(ledger.dropped(), []);
    drop(sends);
    ledger.assert_all_dropped_once();
}

#[test]
fn what_was_sent_before_the_close_is_received_first() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = buffered(Buffer::fifo(3));
    for n in 0..3 {
        sender.try_send(n).unwrap();
    }
    drop(sender);
    assert_eq!(
        [(); 3].map(|()| block_on(receiver.recv())),
        [Ok(0), Ok(1), Ok(2)]
    );
    assert_eq!(block_on(receiver.recv()), Err(RecvError::Closed));
}

#[test]
fn what_was_communicated_is_not_reported_as_closed() {
    // A receive that was given its value before the close, and a send that had its value taken
    // before it.
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(1).unwrap();
    drop(sender);
    assert_eq!(ready(&mut recv), Ok(1));

    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(2));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(2));
    drop(receiver);
    assert_eq!(ready(&mut send), Ok(()));
}

#[test]
fn a_given_back_value_outlives_the_close() {
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(1).unwrap();
    drop(sender);
    drop(recv);
    assert_eq!(receiver.try_recv(), Ok(1));
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Closed));
}

#[test]
fn what_nobody_will_receive_is_dropped_when_the_last_receiver_goes() {
    // A request that lies in the buffer holds the way back to its client: if it stayed there, the
    // client would wait for ever.
    let _watchdog = Watchdog::new();
    let (requests, server) = buffered::<Sender<u32>>(Buffer::fifo(4));
    let (reply, answer) = channel::<u32>();
    requests.try_send(reply).unwrap();
    drop(server);
    assert_eq!(answer.blocking_recv(), Err(RecvError::Closed));
}

#[test]
fn values_do_not_outlive_what_they_borrow_on_the_real_time_path_either() {
    // There the channel's memory is freed later; its values must not be, since they may borrow.
    let ledger = Ledger::new(2);
    let before = luna_core::current::set_on_path(true);
    let (sender, receiver) = buffered::<Token>(Buffer::fifo(2));
    for n in 0..2 {
        sender.try_send(ledger.token(n)).unwrap();
    }
    drop(sender);
    drop(receiver);
    luna_core::current::set_on_path(before);
    ledger.assert_all_dropped_once();
    luna_core::deferred_free::collect();
    ledger.assert_all_dropped_once();
}

#[test]
fn a_value_may_hold_an_end_of_its_own_channel() {
    struct Circle(
        #[expect(dead_code, reason = "held, not read")] Sender<Circle>,
        #[expect(dead_code, reason = "held, not read")] Token,
    );
    let ledger = Ledger::new(1);
    let (sender, receiver) = buffered(Buffer::fifo(2));
    sender
        .try_send(Circle(sender.clone(), ledger.token(0)))
        .unwrap();
    drop(receiver);
    assert_eq!(
        ledger.dropped(),
        [0],
        "the circle ends with the last receiver"
    );
    drop(sender);
    ledger.assert_all_dropped_once();
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn threads_that_wait_are_released() {
    let _watchdog = Watchdog::new();
    for _ in 0..200 {
        let (sender, receiver) = channel::<u8>();
        thread::scope(|scope| {
            for _ in 0..2 {
                let receiver = receiver.clone();
                scope.spawn(move || assert_eq!(receiver.blocking_recv(), Err(RecvError::Closed)));
            }
            drop(sender);
        });
        let (sender, receiver) = channel::<u8>();
        thread::scope(|scope| {
            for n in 0..2 {
                let sender = sender.clone();
                scope.spawn(move || assert_eq!(sender.blocking_send(n).unwrap_err().value, n));
            }
            drop(receiver);
        });
    }
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn both_ends_may_go_at_the_same_time() {
    let ledger = Ledger::new(600);
    for n in 0..300 {
        let (sender, receiver) = buffered(Buffer::fifo(2));
        sender.try_send(ledger.token(2 * n)).unwrap();
        sender.try_send(ledger.token(2 * n + 1)).unwrap();
        thread::scope(|scope| {
            scope.spawn(move || drop(sender));
            scope.spawn(move || drop(receiver));
        });
    }
    ledger.assert_all_dropped_once();
}

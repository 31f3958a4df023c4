//! Futures that are dropped before they are done, in each state they can be in: nothing is lost,
//! nothing doubled.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Wakes, pending, poll_with, ready};
use luna_channels::{Buffer, Receiver, TryRecvError, buffered, channel};
use std::thread;

#[test]
fn before_the_first_poll_a_send_drops_its_value_and_a_receive_nothing() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    drop(sender.send(ledger.token(0)));
    ledger.assert_all_dropped_once();
    drop(receiver.recv());
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
}

#[test]
fn a_waiting_send_takes_its_offer_back() {
    let ledger = Ledger::new(3);
    let (sender, receiver) = channel();
    for gone in 0..3 {
        let mut sends: Vec<_> = (0..3).map(|n| Box::pin(sender.send(n))).collect();
        sends.iter_mut().for_each(pending);
        drop(sends.remove(gone));
        let left: Vec<usize> = (0..3).filter(|&n| n != gone).collect();
        assert_eq!(
            [receiver.try_recv().unwrap(), receiver.try_recv().unwrap()],
            left[..]
        );
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    }
    let (sender, receiver) = channel();
    for n in 0..3 {
        let mut send = Box::pin(sender.send(ledger.token(n)));
        pending(&mut send);
        assert_eq!(ledger.drops(n), 0);
    }
    ledger.assert_all_dropped_once();
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
}

#[test]
fn a_waiting_receive_leaves_no_trace() {
    let (sender, receiver) = channel();
    for gone in 0..3 {
        let mut recvs: Vec<_> = (0..3).map(|_| Box::pin(receiver.recv())).collect();
        recvs.iter_mut().for_each(pending);
        drop(recvs.remove(gone));
        for n in 0..2 {
            sender.try_send(n).unwrap();
        }
        assert!(sender.try_send(2).unwrap_err().is_full());
        assert_eq!([ready(&mut recvs[0]), ready(&mut recvs[1])], [Ok(0), Ok(1)]);
    }
}

#[test]
fn a_send_that_was_taken_and_not_polled_again_stays_sent() {
    let ledger = Ledger::new(2);
    for (n, (sender, receiver)) in [channel(), buffered(Buffer::fifo(1))]
        .into_iter()
        .enumerate()
    {
        if n == 1 {
            sender.try_send(None).unwrap();
        }
        let mut send = Box::pin(sender.send(Some(ledger.token(n))));
        pending(&mut send);
        let mut received = receiver.try_recv().unwrap();
        drop(send);
        if n == 1 {
            received = receiver.try_recv().unwrap();
        }
        assert_eq!(received.as_ref().map(|token| token.id), Some(n));
        assert_eq!(ledger.drops(n), 0);
    }
    ledger.assert_all_dropped_once();
}

#[test]
fn a_value_that_was_received_and_not_handed_on_goes_back_to_the_head() {
    // With room for it, and without. What overwriting buffers do is in given_back.rs.
    for buffer in [Buffer::fifo(3), Buffer::fifo(2)] {
        let (sender, receiver) = buffered(buffer);
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        for n in 0..3 {
            // The first is given to the receive, the others are buffered.
            sender.try_send(n).unwrap();
        }
        drop(recv);
        assert_eq!([(); 3].map(|()| receiver.try_recv().unwrap()), [0, 1, 2]);
    }
}

#[test]
fn a_value_that_came_back_to_a_full_buffer_takes_nobodys_place() {
    let (sender, receiver) = buffered(Buffer::fifo(1));
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    for n in 0..2 {
        sender.try_send(n).unwrap();
    }
    drop(recv);
    assert_eq!(receiver.buffered(), 2);
    // It is over full by one: a sender waits until it is below its capacity again, and is then
    // moved up.
    let mut send = Box::pin(sender.send(2));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(0));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(1));
    assert_eq!(ready(&mut send), Ok(()));
    assert_eq!(receiver.try_recv(), Ok(2));
}

#[test]
fn a_value_that_came_back_to_a_rendezvous_is_received_before_the_one_that_waits_to_send() {
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(0).unwrap();
    let mut send = Box::pin(sender.send(1));
    pending(&mut send);
    drop(recv);
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(0));
    pending(&mut send); // its value has not been taken yet
    assert_eq!(receiver.try_recv(), Ok(1));
    assert_eq!(ready(&mut send), Ok(()));
}

#[test]
fn a_value_that_came_back_goes_to_the_next_that_waits() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let mut recvs: Vec<_> = (0..3).map(|_| Box::pin(receiver.recv())).collect();
    for recv in &mut recvs {
        assert!(poll_with(recv, &waker).is_pending());
    }
    sender.try_send(7).unwrap();
    assert_eq!(wakes.count(), 1);
    // Passed on along all waiters, as each in turn is dropped.
    drop(recvs.remove(0));
    assert_eq!(wakes.count(), 2);
    drop(recvs.remove(0));
    assert_eq!(wakes.count(), 3);
    assert_eq!(ready(&mut recvs[0]), Ok(7));
}

#[test]
fn many_values_come_back_at_once() {
    let ledger = Ledger::new(20);
    let (sender, receiver) = channel();
    let receivers: Vec<Receiver<_>> = (0..20).map(|_| receiver.clone()).collect();
    let mut recvs: Vec<_> = receivers
        .iter()
        .map(|receiver| Box::pin(receiver.recv()))
        .collect();
    recvs.iter_mut().for_each(pending);
    for n in 0..20 {
        sender.try_send(ledger.token(n)).unwrap();
    }
    // Dropped from the last to the first, so that the first comes out first again.
    while let Some(recv) = recvs.pop() {
        drop(recv);
    }
    assert_eq!(ledger.dropped(), []);
    for n in 0..20 {
        assert_eq!(receiver.try_recv().unwrap().id, n);
    }
    ledger.assert_all_dropped_once();
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn in_another_thread() {
    let ledger = Ledger::new(3);
    let (sender, receiver) = channel();
    thread::scope(|scope| {
        // A send that waits.
        let mut send = Box::pin(sender.send(ledger.token(0)));
        pending(&mut send);
        scope.spawn(move || drop(send)).join().unwrap();
        assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
        assert_eq!(ledger.dropped(), [0]);
        // A receive that waits.
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        scope.spawn(move || drop(recv)).join().unwrap();
        drop(sender.try_send(ledger.token(1)).unwrap_err());
        // A receive that was given a value.
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        sender.try_send(ledger.token(2)).unwrap();
        scope.spawn(move || drop(recv)).join().unwrap();
        assert_eq!(receiver.try_recv().unwrap().id, 2);
    });
    ledger.assert_all_dropped_once();
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn a_drop_that_races_with_the_partner_neither_loses_nor_doubles_the_value() {
    // Two threads at once: one drops a waiting operation, the other is its partner.
    for n in 0..2000_usize {
        let ledger = Ledger::new(1);
        let (sender, receiver) = channel();
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        let sent = thread::scope(|scope| {
            let partner = scope.spawn(|| sender.try_send(ledger.token(0)).is_ok());
            scope.spawn(move || drop(recv));
            partner.join().unwrap()
        });
        assert_eq!(receiver.try_recv().is_ok(), sent, "round {n}");
        ledger.assert_all_dropped_once();
    }
}

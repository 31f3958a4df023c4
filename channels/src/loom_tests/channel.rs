//! Rendezvous and buffers: delivery, the end, cancellation, poison.

use super::{Drops, Token, check, poll, recv_id, waiting_recv, waiting_send};
use crate::{Buffer, RecvError, TryRecvError, buffered, channel};
use loom::future::block_on;
use loom::thread;
use luna_core::spin;
use std::task::Poll;

#[test]
fn rendezvous_and_close() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let token = drops.token(7);
        let thread = thread::spawn(move || block_on(sender.send(token)).is_ok());
        assert_eq!(recv_id(&receiver), Ok(7));
        assert_eq!(recv_id(&receiver), Err(RecvError::Closed));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

/// As on a thread that looks before it sleeps: its operations are listed without a wake handle at
/// first. A token has no room on a hand-off slot, and is exchanged in the nodes.
#[test]
fn rendezvous_of_two_that_look_for_each_other() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let tokens = [7, 8].map(|id| drops.token(id));
        let thread = thread::spawn(move || {
            spin::let_look();
            tokens.map(|token| block_on(sender.send(token)).is_ok())
        });
        spin::let_look();
        assert_eq!(recv_id(&receiver), Ok(7));
        assert_eq!(recv_id(&receiver), Ok(8));
        assert_eq!(recv_id(&receiver), Err(RecvError::Closed));
        assert_eq!(thread.join().unwrap(), [true; 2]);
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn a_receive_that_looks_is_poisoned_or_withdrawn() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let token = drops.token(1);
        let thread = thread::spawn(move || {
            let sent = sender.try_send(token).is_ok();
            sender.poison();
            sent
        });
        spin::let_look();
        let mut recv = Box::pin(receiver.recv());
        let received = match poll(&mut recv) {
            Poll::Ready(received) => received.map(|token| token.id),
            Poll::Pending => {
                drop(recv);
                Err(RecvError::Poisoned)
            }
        };
        let sent = thread.join().unwrap();
        assert!(sent || received == Err(RecvError::Poisoned));
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn two_senders_and_one_receiver() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let threads = [0, 1].map(|id| {
            let (sender, token) = (sender.clone(), drops.token(id));
            thread::spawn(move || block_on(sender.send(token)).is_ok())
        });
        drop(sender);
        let mut received: Vec<usize> = (0..2).map(|_| recv_id(&receiver).unwrap()).collect();
        received.sort_unstable();
        assert_eq!(received, [0, 1]);
        assert!(
            threads
                .map(|thread| thread.join().unwrap())
                .iter()
                .all(|&sent| sent)
        );
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn two_receivers_and_one_sender_through_a_buffer() {
    check(|| {
        let (sender, receiver) = buffered(Buffer::fifo(1));
        let other = receiver.clone();
        let thread = thread::spawn(move || block_on(other.recv()).unwrap());
        // The second one may have to wait for room, and be moved up.
        block_on(sender.send(1)).unwrap();
        block_on(sender.send(2)).unwrap();
        assert_eq!(
            block_on(receiver.recv()).unwrap() + thread.join().unwrap(),
            3
        );
    });
}

#[test]
fn a_waker_that_changes_while_the_partner_comes() {
    check(|| {
        let (sender, receiver) = channel();
        let thread = thread::spawn(move || block_on(sender.send(1)).unwrap());
        // First with a waker that does nothing, then with one that must not be missed.
        let mut recv = Box::pin(receiver.recv());
        match poll(&mut recv) {
            Poll::Ready(received) => assert_eq!(received, Ok(1)),
            Poll::Pending => assert_eq!(block_on(recv), Ok(1)),
        }
        thread.join().unwrap();
    });
}

#[test]
fn a_send_that_is_cancelled_as_a_receiver_comes() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let send = waiting_send(&sender, drops.token(0));
        let thread =
            thread::spawn(move || (receiver.try_recv().ok(), receiver.try_recv().is_err()));
        drop(send);
        let (received, then_empty) = thread.join().unwrap();
        assert_eq!(
            drops.count(),
            usize::from(received.is_none()),
            "received or dropped, and not both"
        );
        assert!(then_empty);
        drop(received);
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_send_that_is_cancelled_before_a_receiver_that_waits() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let thread = thread::spawn(move || recv_id(&receiver));
        let mut send = Box::pin(sender.send(drops.token(5)));
        let sent = poll(&mut send).is_ready();
        drop(send);
        drop(sender);
        let received = thread.join().unwrap();
        assert!(received == Ok(5) || (!sent && received == Err(RecvError::Closed)));
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_receive_that_is_cancelled_as_a_sender_comes() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let recv = waiting_recv(&receiver);
        let token = drops.token(3);
        let thread = thread::spawn(move || block_on(sender.send(token)).is_ok());
        drop(recv);
        // Given back, or never taken: the next one has it.
        assert_eq!(recv_id(&receiver), Ok(3));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_value_that_comes_back_as_another_receiver_comes() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let recv = waiting_recv(&receiver);
        assert!(sender.try_send(drops.token(4)).is_ok());
        let other = receiver.clone();
        let thread = thread::spawn(move || recv_id(&other));
        drop(recv);
        assert_eq!(thread.join().unwrap(), Ok(4));
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_try_send_as_the_receiver_withdraws() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let recv = waiting_recv(&receiver);
        let token = drops.token(0);
        let thread = thread::spawn(move || {
            let sent = sender.try_send(token).is_ok();
            (sent, sender)
        });
        drop(recv);
        let (sent, sender) = thread.join().unwrap();
        match receiver.try_recv() {
            Ok(_) => assert!(sent),
            Err(error) => assert!(!sent && error == TryRecvError::Empty),
        }
        drop(sender);
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_close_as_a_receiver_waits() {
    check(|| {
        let (sender, receiver) = channel::<Token>();
        let thread = thread::spawn(move || block_on(receiver.recv()).map(|_| ()));
        drop(sender);
        assert_eq!(thread.join().unwrap(), Err(RecvError::Closed));
    });
}

#[test]
fn a_close_as_a_sender_waits() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let token = drops.token(6);
        let thread =
            thread::spawn(move || block_on(sender.send(token)).unwrap_err().into_inner().id);
        drop(receiver);
        assert_eq!(thread.join().unwrap(), 6);
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn both_ends_go_with_a_value_between_them() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = buffered(Buffer::fifo(1));
        assert!(sender.try_send(drops.token(0)).is_ok());
        let thread = thread::spawn(move || drop(sender));
        drop(receiver);
        thread.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn poison_as_two_communicate() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let (token, poison) = (drops.token(0), sender.clone());
        let send = thread::spawn(move || {
            block_on(sender.send(token))
                .map_err(|error| assert!(error.is_poisoned()))
                .is_ok()
        });
        let poisoner = thread::spawn(move || poison.poison());
        let received = block_on(receiver.recv())
            .map_err(|error| assert!(error.is_poisoned()))
            .is_ok();
        assert_eq!(
            send.join().unwrap(),
            received,
            "both have communicated, or neither"
        );
        poisoner.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn poison_as_a_value_comes_back() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let recv = waiting_recv(&receiver);
        assert!(sender.try_send(drops.token(0)).is_ok());
        let thread = thread::spawn(move || {
            sender.poison();
            sender
        });
        drop(recv);
        let sender = thread.join().unwrap();
        assert_eq!(receiver.try_recv().map(|_| ()), Err(TryRecvError::Poisoned));
        assert_eq!(
            drops.count(),
            1,
            "whichever came first, it does not stay in the channel"
        );
        drop(sender);
    });
}

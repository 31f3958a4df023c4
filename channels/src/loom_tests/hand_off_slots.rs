//! Operations that look for each other, and meet on the hand-off slots; and operations that come
//! for something else meanwhile, and list them.
//!
//! An operation looks once here, so each model has both: what a look sees, and what comes when it
//! sees nothing.

use super::{Drops, check, check_within, poll, recv_id, waiting_recv};
use crate::{Receiver, RecvError, Sender, alt, channel};
use loom::future::block_on;
use loom::thread;
use luna_core::spin;
use std::task::Poll;

/// As the processes of a thread that may look.
fn looking<R>(operations: impl FnOnce() -> R) -> R {
    spin::let_look();
    operations()
}

#[test]
fn a_sender_is_a_value_ahead_of_its_receiver() {
    check(|| {
        let (sender, receiver) = channel::<u32>();
        let thread = thread::spawn(move || {
            looking(|| [1, 2, 3].map(|value| block_on(sender.send(value)).is_ok()))
        });
        looking(|| {
            for value in 1..=3 {
                assert_eq!(block_on(receiver.recv()), Ok(value));
            }
            assert_eq!(block_on(receiver.recv()), Err(RecvError::Closed));
        });
        assert_eq!(thread.join().unwrap(), [true; 3]);
    });
}

#[test]
fn back_and_forth() {
    check_within(2, || {
        let (out, from_here) = channel::<u32>();
        let (back, from_there) = channel::<u32>();
        let thread = thread::spawn(move || {
            looking(|| {
                while let Ok(value) = block_on(from_here.recv()) {
                    assert!(block_on(back.send(value + 1)).is_ok());
                }
            });
        });
        looking(|| {
            for value in [1, 5] {
                assert!(block_on(out.send(value)).is_ok());
                assert_eq!(block_on(from_there.recv()), Ok(value + 1));
            }
        });
        drop(out);
        thread.join().unwrap();
    });
}

/// The second sender lists the first.
#[test]
fn two_senders_look_for_one_receiver() {
    check_within(2, || {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let threads = [0, 1].map(|id| {
            let (sender, token) = (sender.clone(), drops.token(id));
            thread::spawn(move || looking(|| block_on(sender.send(token)).is_ok()))
        });
        drop(sender);
        let mut received: Vec<usize> =
            looking(|| (0..2).map(|_| recv_id(&receiver).unwrap()).collect());
        received.sort_unstable();
        assert_eq!(received, [0, 1]);
        assert_eq!(threads.map(|thread| thread.join().unwrap()), [true; 2]);
        assert_eq!(drops.count(), 2);
    });
}

/// Two receivers of one thread: the one that looks in its poll finds the other listed, or not.
#[test]
fn two_receivers_look_for_one_sender() {
    check_within(2, || {
        let (sender, receiver) = channel::<u32>();
        let threads = [receiver.clone(), receiver]
            .map(|receiver| thread::spawn(move || looking(|| block_on(receiver.recv()).unwrap())));
        looking(|| {
            assert!(block_on(sender.send(1)).is_ok());
            assert!(block_on(sender.send(2)).is_ok());
        });
        let received: u32 = threads.map(|thread| thread.join().unwrap()).iter().sum();
        assert_eq!(received, 3);
    });
}

#[test]
fn a_try_receive_lists_a_sender_that_looks() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let token = drops.token(4);
        let thread = thread::spawn(move || looking(|| block_on(sender.send(token)).is_ok()));
        let mut received = receiver.try_recv().ok().map(|token| token.id);
        if received.is_none() {
            received = recv_id(&receiver).ok();
        }
        assert_eq!(received, Some(4));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_try_send_lists_a_receiver_that_looks() {
    check(|| {
        let (sender, receiver) = channel::<u32>();
        let thread = thread::spawn(move || looking(|| block_on(receiver.recv())));
        let sent = sender.try_send(1).is_ok();
        drop(sender);
        let received = thread.join().unwrap();
        assert_eq!(received, if sent { Ok(1) } else { Err(RecvError::Closed) });
    });
}

/// Ends the channel by `end` while a send looks: it is received, or comes back.
fn a_send_that_looks_meets(
    end: impl Fn(Receiver<super::Token>) -> Option<usize> + Copy + Send + Sync + 'static,
) {
    check(move || {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let token = drops.token(6);
        let thread = thread::spawn(move || {
            looking(|| match block_on(sender.send(token)) {
                Ok(()) => None,
                Err(error) => Some(error.into_inner().id),
            })
        });
        let received = end(receiver);
        let back = thread.join().unwrap();
        assert_eq!(
            (received, back),
            if received.is_some() {
                (Some(6), None)
            } else {
                (None, Some(6))
            }
        );
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_send_that_looks_meets_the_end() {
    a_send_that_looks_meets(|receiver| {
        drop(receiver);
        None
    });
}

#[test]
fn a_send_that_looks_meets_poison() {
    a_send_that_looks_meets(|receiver| {
        receiver.poison();
        None
    });
}

#[test]
fn a_send_that_looks_meets_an_extended_receive() {
    a_send_that_looks_meets(|receiver| {
        let received = looking(|| block_on(receiver.recv_extended()));
        received.ok().map(|held| held.finish().id)
    });
}

#[test]
fn a_send_that_looks_is_given_up_after_its_look() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let token = drops.token(2);
        let thread = thread::spawn(move || {
            looking(|| {
                let mut send = Box::pin(sender.send(token));
                let sent = poll(&mut send).is_ready();
                drop(send);
                sent
            })
        });
        let received = looking(|| recv_id(&receiver));
        let sent = thread.join().unwrap();
        // It may have been received after its poll, and before its drop.
        assert!(received == Ok(2) || (!sent && received == Err(RecvError::Closed)));
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn an_alternative_lists_a_sender_that_looks() {
    check_within(2, || {
        let (sender, receiver) = channel::<u32>();
        let (_kept, other) = channel::<u32>();
        let thread = thread::spawn(move || looking(|| block_on(sender.send(3)).is_ok()));
        let received = block_on(async {
            alt! {
                value = receiver.recv() => value.ok(),
                _value = other.recv() => None,
            }
        });
        assert_eq!(received, Some(3));
        assert!(thread.join().unwrap());
    });
}

/// An operation that may not look gives to one that does, and takes from it, without listing it.
#[test]
fn one_that_may_not_look_meets_one_that_does() {
    fn once<S, R>(send: S, recv: R)
    where
        S: Fn(Sender<u32>) -> bool + Copy + Send + Sync + 'static,
        R: Fn(Receiver<u32>) -> Result<u32, RecvError> + Copy + Send + Sync + 'static,
    {
        check(move || {
            let (sender, receiver) = channel();
            let thread = thread::spawn(move || send(sender));
            assert_eq!(recv(receiver), Ok(9));
            assert!(thread.join().unwrap());
        });
    }
    once(
        |sender| looking(|| block_on(sender.send(9)).is_ok()),
        |receiver| block_on(receiver.recv()),
    );
    once(
        |sender| block_on(sender.send(9)).is_ok(),
        |receiver| looking(|| block_on(receiver.recv())),
    );
}

/// A future that is polled again after its look has seen nothing.
#[test]
fn a_receive_that_has_looked_is_woken() {
    check(|| {
        let (sender, receiver) = channel::<u32>();
        let thread = thread::spawn(move || looking(|| block_on(sender.send(5)).is_ok()));
        let mut recv = Box::pin(receiver.recv());
        let received = looking(|| match poll(&mut recv) {
            Poll::Ready(received) => received,
            Poll::Pending => block_on(recv.as_mut()),
        });
        assert_eq!(received, Ok(5));
        assert!(thread.join().unwrap());
    });
}

/// It is not in a node, so an operation that looks at the hand-off slots alone does not find it.
#[test]
fn a_receive_that_looks_finds_what_came_back() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let recv = waiting_recv(&receiver);
        assert!(sender.try_send(drops.token(0)).is_ok());
        let next = drops.token(1);
        let thread = thread::spawn(move || looking(|| block_on(sender.send(next)).is_ok()));
        drop(recv);
        looking(|| {
            // The second one may have come before the first was back.
            let mut received = [recv_id(&receiver).unwrap(), recv_id(&receiver).unwrap()];
            received.sort_unstable();
            assert_eq!(received, [0, 1]);
        });
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 2);
    });
}

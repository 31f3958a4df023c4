//! `Alternative`, which stays registered: what becomes ready while it looks, starts to wait, or
//! goes is not missed and not lost.

use super::{Drops, check, check_within, poll, recv_id};
use crate::{Alternative, Buffer, RecvError, buffered, channel, pri_alt};
use loom::future::block_on;
use loom::thread;

#[test]
fn a_sender_comes_as_it_starts_to_wait() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let receivers = [receiver];
        let token = drops.token(1);
        let thread = thread::spawn(move || {
            let sent = block_on(sender.send(token)).is_ok();
            (sent, sender)
        });
        let mut inputs = Alternative::fair(&receivers);
        let (index, received) = block_on(inputs.recv());
        assert_eq!((index, received.unwrap().id), (0, 1));
        let (sent, _sender) = thread.join().unwrap();
        assert!(sent);
        drop(inputs);
        assert_eq!(drops.count(), 1);
    });
}

/// It starts to wait under its own lock, in the middle of the other's decision.
#[test]
fn an_alternative_of_sends_meets_it_by_its_first_guard() {
    check(|| {
        let (sender, receiver) = channel();
        let receivers = [receiver];
        let thread = thread::spawn(move || {
            block_on(async {
                pri_alt! {
                    sent = sender.send(1) => assert!(sent.is_ok()),
                    _ = sender.send(2) => panic!("the first guard was ready"),
                }
            });
            sender
        });
        let mut inputs = Alternative::prioritized(&receivers);
        assert_eq!(block_on(inputs.recv()), (0, Ok(1)));
        thread.join().unwrap();
    });
}

#[test]
fn an_alternative_of_sends_on_two_channels_meets_it_by_its_first_guard() {
    check_within(2, || {
        let (first, at_first) = channel();
        let (second, at_second) = channel();
        let receivers = [at_first, at_second];
        let thread = thread::spawn(move || {
            block_on(async {
                pri_alt! {
                    sent = first.send(1) => assert!(sent.is_ok()),
                    _ = second.send(2) => panic!("the first guard was ready"),
                }
            });
            (first, second)
        });
        let mut inputs = Alternative::prioritized(&receivers);
        assert_eq!(block_on(inputs.recv()), (0, Ok(1)));
        thread.join().unwrap();
    });
}

#[test]
fn two_senders_on_two_channels() {
    check_within(2, || {
        let drops = Drops::default();
        let (senders, receivers): (Vec<_>, Vec<_>) = (0..2).map(|_| channel()).unzip();
        let threads: Vec<_> = senders
            .into_iter()
            .enumerate()
            .map(|(id, sender)| {
                let token = drops.token(id);
                thread::spawn(move || {
                    assert!(block_on(sender.send(token)).is_ok());
                    sender
                })
            })
            .collect();
        let mut inputs = Alternative::fair(&receivers);
        let mut seen = [false; 2];
        for _ in 0..2 {
            let (index, received) = block_on(inputs.recv());
            assert_eq!(received.unwrap().id, index);
            assert!(!std::mem::replace(&mut seen[index], true));
        }
        for thread in threads {
            thread.join().unwrap();
        }
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn a_value_comes_into_a_buffer_between_two_looks() {
    check(|| {
        let (sender, receiver) = buffered(Buffer::fifo(2));
        let receivers = [receiver];
        let thread = thread::spawn(move || {
            sender.try_send(1).unwrap();
            sender.try_send(2).unwrap();
            sender
        });
        let mut inputs = Alternative::prioritized(&receivers);
        assert_eq!(block_on(inputs.recv()), (0, Ok(1)));
        assert_eq!(block_on(inputs.recv()), (0, Ok(2)));
        thread.join().unwrap();
    });
}

#[test]
fn another_receiver_takes_what_it_was_told_of() {
    check_within(2, || {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let (other_sender, other_receiver) = channel();
        let receivers = [receiver.clone(), other_receiver];
        let thief = thread::spawn(move || receiver.try_recv().is_ok());
        let token = drops.token(0);
        let thread = thread::spawn(move || {
            assert!(block_on(sender.send(token)).is_ok());
            sender
        });
        let second = drops.token(1);
        let mut inputs = Alternative::fair(&receivers);
        let mut recv = Box::pin(inputs.recv());
        let first = poll(&mut recv);
        let stolen = thief.join().unwrap();
        if stolen {
            assert!(first.is_pending());
            // It waits for both, or has just got the report of what is gone and looks again: a send
            // finds it, or is found.
            let mut send = Box::pin(other_sender.send(second));
            let sent = poll(&mut send);
            let (index, received) = block_on(recv);
            assert_eq!((index, received.unwrap().id), (1, 1));
            assert!(sent.is_ready() || poll(&mut send).is_ready());
        } else {
            drop(second);
            let (index, received) = match first {
                std::task::Poll::Ready(received) => {
                    drop(recv);
                    received
                }
                std::task::Poll::Pending => block_on(recv),
            };
            assert_eq!((index, received.unwrap().id), (0, 0));
        }
        thread.join().unwrap();
        drop(inputs);
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn it_goes_as_a_sender_comes() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let receivers = [receiver];
        let token = drops.token(3);
        let mut inputs = Alternative::fair(&receivers);
        {
            let mut recv = Box::pin(inputs.recv());
            assert!(poll(&mut recv).is_pending());
        }
        let mut recv = Box::pin(inputs.recv());
        assert!(poll(&mut recv).is_pending());
        let thread = thread::spawn(move || {
            let sent = block_on(sender.send(token)).is_ok();
            (sent, sender)
        });
        drop(recv);
        drop(inputs);
        // Given back, or never taken.
        assert_eq!(recv_id(&receivers[0]), Ok(3));
        let (sent, _sender) = thread.join().unwrap();
        assert!(sent);
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn the_end_of_a_channel_as_it_starts_to_wait() {
    check(|| {
        let (sender, receiver) = channel::<u32>();
        let receivers = [receiver];
        let thread = thread::spawn(move || sender.poison());
        let mut inputs = Alternative::fair(&receivers);
        assert_eq!(block_on(inputs.recv()), (0, Err(RecvError::Poisoned)));
        thread.join().unwrap();
    });
}

#[test]
fn a_channel_that_has_ended_is_left_out_as_the_other_is_sent_to() {
    check_within(2, || {
        let drops = Drops::default();
        let (senders, receivers): (Vec<_>, Vec<_>) = (0..2).map(|_| channel()).unzip();
        let [first, second]: [_; 2] = senders.try_into().unwrap();
        let ends = thread::spawn(move || first.poison());
        let token = drops.token(1);
        let sends = thread::spawn(move || {
            assert!(block_on(second.send(token)).is_ok());
            second
        });
        let mut inputs = Alternative::prioritized(&receivers);
        let mut seen = [false; 2];
        for _ in 0..2 {
            let (index, received) = block_on(inputs.recv());
            assert_eq!(received.map(|token| token.id).is_err(), index == 0);
            assert!(!std::mem::replace(&mut seen[index], true));
        }
        ends.join().unwrap();
        let second = sends.join().unwrap();
        let mut recv = Box::pin(inputs.recv());
        assert!(poll(&mut recv).is_pending());
        second.poison();
        let (index, received) = block_on(recv);
        assert_eq!((index, received.is_err()), (1, true));
        assert_eq!(block_on(inputs.recv()).0, 0, "all have ended");
        drop(inputs);
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn two_of_them_share_a_channel() {
    check_within(2, || {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let theirs = receiver.clone();
        let threads = [0, 1].map(|id| {
            let (sender, token) = (sender.clone(), drops.token(id));
            thread::spawn(move || assert!(block_on(sender.send(token)).is_ok()))
        });
        let (ours, theirs) = ([receiver], [theirs]);
        let mut one = Alternative::fair(&ours);
        let mut other = Alternative::fair(&theirs);
        let first = block_on(one.recv()).1.unwrap().id;
        let second = block_on(other.recv()).1.unwrap().id;
        assert_eq!(first + second, 1);
        for thread in threads {
            thread.join().unwrap();
        }
        drop(sender);
        assert_eq!(drops.count(), 2);
    });
}

//! Extended rendezvous: a held sender goes on, once, whatever happens meanwhile.

use super::{Drops, check, poll, recv_id, waiting_send};
use crate::{RecvError, alt, channel};
use loom::future::block_on;
use loom::thread;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

#[test]
fn the_sender_goes_on_after_the_receiver_is_done() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let done = Arc::new(AtomicBool::new(false));
        let (token, is_done) = (drops.token(1), done.clone());
        let thread = thread::spawn(move || {
            assert!(block_on(sender.send(token)).is_ok());
            assert!(is_done.load(Ordering::Relaxed));
        });
        let extended = block_on(receiver.recv_extended()).unwrap();
        done.store(true, Ordering::Relaxed);
        assert_eq!(extended.finish().id, 1);
        thread.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn poison_as_the_sender_is_held() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let (token, poisoner) = (drops.token(1), sender.clone());
        let send = thread::spawn(move || block_on(sender.send(token)).is_ok());
        let poison = thread::spawn(move || poisoner.poison());
        let received = match block_on(receiver.recv_extended()) {
            Ok(extended) => extended.finish().id == 1,
            Err(error) => error != RecvError::Poisoned,
        };
        assert_eq!(send.join().unwrap(), received, "both, or neither");
        poison.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn the_senders_future_goes_as_it_is_released() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let send = waiting_send(&sender, drops.token(1));
        let thread = thread::spawn(move || {
            let extended = poll(&mut Box::pin(receiver.recv_extended()));
            let received = extended.is_ready();
            drop(extended);
            (received, receiver)
        });
        drop(send);
        let (_, receiver) = thread.join().unwrap();
        assert!(receiver.try_recv().is_err());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn the_receivers_future_goes_as_a_sender_comes() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let mut recv = Box::pin(receiver.recv_extended());
        assert!(poll(&mut recv).is_pending());
        let token = drops.token(1);
        let thread = thread::spawn(move || block_on(sender.send(token)).is_ok());
        drop(recv);
        assert_eq!(recv_id(&receiver), Ok(1));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_value_that_comes_back_as_an_extended_receiver_comes() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let mut recv = Box::pin(receiver.recv());
        assert!(poll(&mut recv).is_pending());
        assert!(sender.try_send(drops.token(1)).is_ok());
        let other = receiver.clone();
        let thread = thread::spawn(move || block_on(other.recv_extended()).unwrap().finish().id);
        drop(recv);
        assert_eq!(thread.join().unwrap(), 1);
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn an_output_guard_is_held() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (_to_two, two)) = (channel(), channel());
        let done = Arc::new(AtomicBool::new(false));
        let is_done = done.clone();
        let thread = thread::spawn(move || {
            let extended = block_on(one.recv_extended()).unwrap();
            done.store(true, Ordering::Relaxed);
            drop(extended);
        });
        block_on(async {
            alt! {
                sent = to_one.send(drops.token(1)) => assert!(sent.is_ok()),
                value = two.recv() => { let _: Result<u8, _> = value; unreachable!() }
            }
        });
        assert!(is_done.load(Ordering::Relaxed));
        thread.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn an_alternative_goes_as_it_is_taken_and_held() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (_to_two, two)) = (channel(), channel::<u8>());
        let mut alternative = Box::pin(async {
            alt! {
                sent = to_one.send(drops.token(1)) => assert!(sent.is_ok()),
                _ = two.recv() => unreachable!(),
            }
        });
        assert!(poll(&mut alternative).is_pending());
        let thread = thread::spawn(move || {
            drop(poll(&mut Box::pin(one.recv_extended())));
            one
        });
        drop(alternative);
        let one = thread.join().unwrap();
        assert!(one.try_recv().is_err());
        assert_eq!(drops.count(), 1);
    });
}

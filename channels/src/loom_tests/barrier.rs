//! Barriers: no party goes before all have come, none is forgotten, and alternatives choose the
//! barrier together or not at all.

use super::{check, check_within, poll};
use crate::{Barrier, Receiver, alt, channel, pri_alt};
use loom::future::block_on;
use loom::thread;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::Poll;

#[test]
fn two_parties_and_two_rounds() {
    check(|| {
        let barrier = Barrier::new(2);
        let other = barrier.clone();
        // Not watched by loom: it only shows the order.
        let come = Arc::new(AtomicUsize::new(0));
        let theirs = come.clone();
        let thread = thread::spawn(move || {
            for round in 1..=2 {
                theirs.fetch_add(1, Ordering::SeqCst);
                block_on(other.sync());
                assert!(theirs.load(Ordering::SeqCst) >= 2 * round);
            }
        });
        for round in 1..=2 {
            come.fetch_add(1, Ordering::SeqCst);
            block_on(barrier.sync());
            assert!(come.load(Ordering::SeqCst) >= 2 * round);
        }
        thread.join().unwrap();
    });
}

#[test]
fn three_parties() {
    check_within(2, || {
        let barrier = Barrier::new(3);
        let threads = [0, 1].map(|_| {
            let barrier = barrier.clone();
            thread::spawn(move || block_on(barrier.sync()))
        });
        block_on(barrier.sync());
        for thread in threads {
            thread.join().unwrap();
        }
    });
}

#[test]
fn one_resigns_as_the_other_comes() {
    check(|| {
        let barrier = Barrier::new(1);
        let party = barrier.enroll();
        let thread = thread::spawn(move || drop(party));
        block_on(barrier.sync());
        thread.join().unwrap();
        block_on(barrier.sync());
    });
}

#[test]
fn one_is_dropped_as_the_other_comes() {
    check(|| {
        let barrier = Barrier::new(2);
        let other = barrier.clone();
        let mut gone = Box::pin(barrier.sync());
        assert!(poll(&mut gone).is_pending());
        let thread = thread::spawn(move || block_on(other.sync()));
        drop(gone);
        // It had come, and the other has gone; or the other waits, now for no party.
        barrier.resign();
        thread.join().unwrap();
        // Nothing is left behind of either.
        block_on(barrier.sync());
    });
}

/// The barrier, or the channel.
async fn choose(barrier: &Barrier, receiver: &Receiver<u32>) -> bool {
    pri_alt! {
        _ = barrier.sync() => true,
        value = receiver.recv() => value.is_err(),
    }
}

#[test]
fn two_alternatives_meet() {
    check(|| {
        let barrier = Barrier::new(2);
        let other = barrier.clone();
        let (_sender, receiver) = channel::<u32>();
        let (_sender2, receiver2) = channel::<u32>();
        let thread = thread::spawn(move || assert!(block_on(choose(&other, &receiver2))));
        assert!(block_on(choose(&barrier, &receiver)));
        thread.join().unwrap();
    });
}

#[test]
fn an_alternative_meets_the_barrier_or_a_sender_and_never_both() {
    check_within(2, || {
        let barrier = Barrier::new(2);
        let (of_party, of_alternative) = (barrier.clone(), barrier.clone());
        let (sender, receiver) = channel::<u32>();
        let alternative = thread::spawn(move || {
            let met = block_on(choose(&of_alternative, &receiver));
            (met, receiver)
        });
        let party = thread::spawn(move || block_on(of_party.sync()));
        let sent = sender.try_send(1).is_ok();
        if sent {
            // The alternative has chosen: the party waits for another one.
            block_on(barrier.sync());
        }
        let (met, _receiver) = alternative.join().unwrap();
        party.join().unwrap();
        assert_eq!(met, !sent);
    });
}

#[test]
fn opposite_choices_of_two_barriers() {
    check_within(2, || {
        let (left, right) = (Barrier::new(2), Barrier::new(2));
        let (left2, right2) = (left.clone(), right.clone());
        let thread = thread::spawn(move || {
            block_on(async {
                pri_alt! {
                    _ = right2.sync() => "right",
                    _ = left2.sync() => "left",
                }
            })
        });
        let chosen = block_on(async {
            alt! {
                _ = left.sync() => "left",
                _ = right.sync() => "right",
            }
        });
        assert_eq!(thread.join().unwrap(), chosen);
    });
}

#[test]
fn an_alternative_is_dropped_as_a_party_comes() {
    check(|| {
        let barrier = Barrier::new(2);
        let other = barrier.clone();
        let (_sender, receiver) = channel::<u32>();
        let mut alternative = Box::pin(choose(&barrier, &receiver));
        assert!(poll(&mut alternative).is_pending());
        let thread = thread::spawn(move || {
            let mut sync = Box::pin(other.sync());
            match poll(&mut sync) {
                Poll::Ready(()) => true,
                Poll::Pending => {
                    block_on(sync);
                    false
                }
            }
        });
        drop(alternative);
        // Either the round was complete before the drop, or the party waits for this one.
        barrier.resign();
        thread.join().unwrap();
        block_on(barrier.sync());
    });
}

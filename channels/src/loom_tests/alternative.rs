//! Alternatives: exactly one guard happens, and the others leave no trace, for every partner and
//! every order of arrival.

use super::{Drops, Token, check, check_within, poll, recv_id};
use crate::{Receiver, RecvError, Sender, alt, channel, pri_alt};
use loom::future::block_on;
use loom::thread;
use std::task::Poll;

/// Waits for either, and returns the channel and its result.
async fn either(one: &Receiver<Token>, two: &Receiver<Token>) -> (usize, Result<usize, RecvError>) {
    pri_alt! {
        token = one.recv() => (1, token.map(|token| token.id)),
        token = two.recv() => (2, token.map(|token| token.id)),
    }
}

/// Offers to both; returns which took it, or 0 if the chosen channel has ended.
async fn offer(one: &Sender<Token>, two: &Sender<Token>, drops: &Drops) -> usize {
    alt! {
        sent = one.send(drops.token(1)) => usize::from(sent.is_ok()),
        sent = two.send(drops.token(2)) => 2 * usize::from(sent.is_ok()),
    }
}

#[test]
fn two_against_two() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let theirs = drops.clone();
        // The ends outlive the alternatives, so that neither sees the other one gone.
        let thread = thread::spawn(move || {
            let sent = block_on(offer(&to_one, &to_two, &theirs));
            (sent, to_one, to_two)
        });
        let (from, received) = block_on(either(&one, &two));
        let (sent, _to_one, _to_two) = thread.join().unwrap();
        assert_eq!((from, received), (sent, Ok(sent)));
        assert!(one.try_recv().is_err() && two.try_recv().is_err());
        assert_eq!(drops.count(), 2, "what was received, and what was not");
    });
}

/// Offers to send, and to receive: whether it sent, and what it received.
async fn exchange(
    to: &Sender<Token>,
    from: &Receiver<Token>,
    token: Token,
    sends_first: bool,
) -> (bool, Option<usize>) {
    let mut slot = Some(token);
    if sends_first {
        pri_alt! {
            sent = to.send_from(&mut slot) => (sent.is_ok(), None),
            token = from.recv() => (false, token.ok().map(|token| token.id)),
        }
    } else {
        pri_alt! {
            token = from.recv() => (false, token.ok().map(|token| token.id)),
            sent = to.send_from(&mut slot) => (sent.is_ok(), None),
        }
    }
}

#[test]
fn opposite_ends_of_two_channels() {
    for sends_first in [false, true] {
        check(move || {
            let drops = Drops::default();
            let ((to_right, from_left), (to_left, from_right)) = (channel(), channel());
            let token = drops.token(2);
            let thread = thread::spawn(move || {
                let chosen = block_on(exchange(&to_left, &from_left, token, sends_first));
                (chosen, to_left, from_left)
            });
            let chosen = block_on(exchange(&to_right, &from_right, drops.token(1), true));
            let (theirs, _to_left, _from_left) = thread.join().unwrap();
            // One of them sent, and the other received that.
            match chosen {
                (true, None) => assert_eq!(theirs, (false, Some(1))),
                (false, Some(2)) => assert_eq!(theirs, (true, None)),
                other => panic!("{other:?}"),
            }
            assert_eq!(drops.count(), 2);
        });
    }
}

#[test]
fn both_ends_of_one_channel_against_both() {
    check(|| {
        let drops = Drops::default();
        let (sender, receiver) = channel();
        let ends = (sender.clone(), receiver.clone());
        let token = drops.token(2);
        let thread = thread::spawn(move || {
            let chosen = block_on(exchange(&ends.0, &ends.1, token, false));
            (chosen, ends)
        });
        let chosen = block_on(exchange(&sender, &receiver, drops.token(1), true));
        let (theirs, _ends) = thread.join().unwrap();
        match chosen {
            (true, None) => assert_eq!(theirs, (false, Some(1))),
            (false, Some(2)) => assert_eq!(theirs, (true, None)),
            other => panic!("{other:?}"),
        }
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn three_in_a_ring_one_of_which_finds_the_others_gone() {
    check_within(2, || {
        let drops = Drops::default();
        let channels = [channel(), channel(), channel()];
        let [(x, from_x), (y, from_y), (z, from_z)] = channels;
        let run = |to: Sender<Token>, from: Receiver<Token>, token: Token| {
            move || block_on(exchange(&to, &from, token, false))
        };
        let one = thread::spawn(run(x, from_z, drops.token(1)));
        let two = thread::spawn(run(y, from_x, drops.token(2)));
        let third = run(z, from_y, drops.token(3))();
        let all = [one.join().unwrap(), two.join().unwrap(), third];
        let sent = all.iter().filter(|chosen| chosen.0).count();
        let received = all.iter().filter(|chosen| chosen.1.is_some()).count();
        assert_eq!((sent, received), (1, 1), "and the third found an end gone");
        assert_eq!(drops.count(), 3);
    });
}

#[test]
fn a_partner_comes_as_it_withdraws() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (_to_two, two)) = (channel(), channel());
        let mut alternative = Box::pin(either(&one, &two));
        assert!(poll(&mut alternative).is_pending());
        let token = drops.token(1);
        let thread = thread::spawn(move || block_on(to_one.send(token)).is_ok());
        drop(alternative);
        // Given back, or never taken: the next one has it.
        assert_eq!(recv_id(&one), Ok(1));
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_receiver_comes_as_an_offer_withdraws() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let mut alternative = Box::pin(offer(&to_one, &to_two, &drops));
        assert!(poll(&mut alternative).is_pending());
        let thread = thread::spawn(move || {
            let received = two.try_recv().is_ok();
            (received, two)
        });
        drop(alternative);
        let (received, two) = thread.join().unwrap();
        assert!(one.try_recv().is_err() && two.try_recv().is_err());
        assert_eq!(drops.count(), 2);
        drop((received, two));
    });
}

#[test]
fn two_partners_at_the_same_time_of_which_one_waits() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let senders = [(to_one, 1), (to_two, 2)].map(|(sender, id)| {
            let token = drops.token(id);
            thread::spawn(move || block_on(sender.send(token)).is_ok())
        });
        let (from, received) = block_on(either(&one, &two));
        assert_eq!(received, Ok(from));
        let other = if from == 1 { &two } else { &one };
        assert_eq!(recv_id(other), Ok(3 - from));
        for sender in senders {
            assert!(sender.join().unwrap());
        }
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn two_partners_at_the_same_time_of_which_one_goes_to_the_one_that_waits_behind() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let behind = two.clone();
        let mut alternative = Box::pin(either(&one, &two));
        assert!(poll(&mut alternative).is_pending());
        let mut recv = Box::pin(behind.recv());
        assert!(poll(&mut recv).is_pending());
        let senders = [(to_one, 1), (to_two, 2)].map(|(sender, id)| {
            let token = drops.token(id);
            thread::spawn(move || (sender.try_send(token).is_ok(), sender))
        });
        let [(to_one, _one), (to_two, _two)] = senders.map(|sender| sender.join().unwrap());
        assert!(to_two, "somebody waits on the second channel in any case");
        let chosen = poll(&mut alternative);
        let received = poll(&mut recv);
        if to_one {
            assert_eq!(chosen, Poll::Ready((1, Ok(1))));
            assert!(matches!(received, Poll::Ready(Ok(token)) if token.id == 2));
        } else {
            assert_eq!(chosen, Poll::Ready((2, Ok(2))));
            assert!(received.is_pending());
        }
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn two_alternatives_and_one_partner_for_both() {
    check(|| {
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let drops = Drops::default();
        let (mut first, mut second) = (Box::pin(either(&one, &two)), Box::pin(either(&two, &one)));
        assert!(poll(&mut first).is_pending() && poll(&mut second).is_pending());
        // Each partner takes one of them, whichever it is.
        let senders = [(to_one, 1), (to_two, 2)].map(|(sender, id)| {
            let token = drops.token(id);
            thread::spawn(move || (sender.try_send(token).is_ok(), sender))
        });
        let ends = senders.map(|sender| sender.join().unwrap());
        assert!(ends.iter().all(|end| end.0));
        let mut received = [poll(&mut first), poll(&mut second)].map(|chosen| match chosen {
            Poll::Ready((_, received)) => received.unwrap(),
            Poll::Pending => panic!("an alternative that was chosen waits"),
        });
        received.sort_unstable();
        assert_eq!(received, [1, 2]);
    });
}

#[test]
fn pri_alt_takes_what_was_there_first() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let tokens = (drops.token(1), drops.token(2));
        // Parks on 1, then on 2: a thread that sees 2 also sees 1.
        let thread = thread::spawn(move || {
            let mut first = Box::pin(to_one.send(tokens.0));
            let mut second = Box::pin(to_two.send(tokens.1));
            // Taken at once, maybe: it is listed before its waker is cloned, and looks again with
            // that.
            let _ = poll(&mut first);
            let second = poll(&mut second).is_ready();
            assert!(!second, "nobody takes it");
        });
        let chosen = block_on(async {
            pri_alt! {
                token = one.recv() => token.map_or(0, |token| token.id),
                token = two.recv() => token.map_or(0, |token| token.id),
                skip => 0,
            }
        });
        assert_ne!(chosen, 2);
        thread.join().unwrap();
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn poison_as_it_is_chosen() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let token = drops.token(1);
        let send = thread::spawn(move || block_on(to_one.send(token)).is_ok());
        let poison = thread::spawn(move || to_two.poison());
        let (from, received) = block_on(either(&one, &two));
        match received {
            Ok(id) => assert_eq!((from, id), (1, 1)),
            Err(error) => {
                assert_eq!((from, error), (2, RecvError::Poisoned));
                assert_eq!(recv_id(&one), Ok(1));
            }
        }
        assert!(send.join().unwrap());
        poison.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn poison_of_the_channel_that_is_chosen() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (_to_two, two)) = (channel(), channel());
        let (token, poisoner) = (drops.token(1), one.clone());
        let send = thread::spawn(move || block_on(to_one.send(token)).is_ok());
        let poison = thread::spawn(move || poisoner.poison());
        let (from, received) = block_on(either(&one, &two));
        assert_eq!(from, 1);
        assert_eq!(send.join().unwrap(), received.is_ok(), "both, or neither");
        poison.join().unwrap();
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_close_as_it_waits() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let thread = thread::spawn(move || drop(to_two));
        let token = drops.token(1);
        let sender = thread::spawn(move || block_on(to_one.send(token)).is_ok());
        let (from, received) = block_on(either(&one, &two));
        if from == 2 {
            assert_eq!(received, Err(RecvError::Closed));
            assert_eq!(recv_id(&one), Ok(1));
        } else {
            assert_eq!(received, Ok(1));
        }
        thread.join().unwrap();
        assert!(sender.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_close_as_it_offers() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let thread = thread::spawn(move || {
            drop(one);
            drop(two);
        });
        assert_eq!(block_on(offer(&to_one, &to_two, &drops)), 0);
        thread.join().unwrap();
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn what_is_not_chosen_stays_in_its_slot() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let mut slot = Some(drops.token(1));
        let mut alternative = Box::pin(async {
            alt! {
                sent = to_one.send_from(&mut slot) => { assert!(sent.is_ok()); 1 }
                token = two.recv() => { assert!(token.is_ok()); 2 }
            }
        });
        assert!(poll(&mut alternative).is_pending());
        let token = drops.token(2);
        let sender = thread::spawn(move || (to_two.try_send(token).is_ok(), to_two));
        let receiver = thread::spawn(move || (one.try_recv().ok(), one));
        let chosen = block_on(alternative);
        let (sent, _to_two) = sender.join().unwrap();
        let (received, _one) = receiver.join().unwrap();
        assert_eq!(received.is_some(), chosen == 1);
        assert_eq!(sent, chosen == 2);
        assert_eq!(slot.is_some(), chosen == 2);
        drop((received, slot));
        assert_eq!(drops.count(), 2);
    });
}

#[test]
fn a_waker_that_changes_as_a_partner_comes() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let token = drops.token(2);
        let thread =
            thread::spawn(move || block_on(to_two.send(token)).is_ok() && drop(to_one) == ());
        // First with a waker that does nothing, then with one that must not be missed.
        let mut alternative = Box::pin(either(&one, &two));
        match poll(&mut alternative) {
            Poll::Ready(chosen) => assert_eq!(chosen, (2, Ok(2))),
            Poll::Pending => assert_eq!(block_on(alternative), (2, Ok(2))),
        }
        assert!(thread.join().unwrap());
        assert_eq!(drops.count(), 1);
    });
}

#[test]
fn a_waker_that_changes_as_the_chosen_channel_is_contended() {
    check(|| {
        let drops = Drops::default();
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let mut alternative = Box::pin(either(&one, &two));
        assert!(poll(&mut alternative).is_pending());
        let senders = [(to_one, 1), (to_two, 2)].map(|(sender, id)| {
            let token = drops.token(id);
            thread::spawn(move || (sender.try_send(token).is_ok(), sender))
        });
        let (from, received) = block_on(alternative);
        assert_eq!(received, Ok(from));
        let sent = senders.map(|sender| sender.join().unwrap().0);
        assert_eq!(sent, [from == 1, from == 2]);
        assert_eq!(drops.count(), 2);
    });
}

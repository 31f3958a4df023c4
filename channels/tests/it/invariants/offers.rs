//! Invariants 4 to 7: what becomes of offers that lose, of opposite ones, and of several on one
//! channel.

use super::common::{Ledger, Watchdog, pending, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, Receiver, Sender, TryRecvError, alt, buffered, channel, inspect, pri_alt,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Waiters on the channel of this name.
fn waiting(name: &str) -> usize {
    let places = inspect::wait_points();
    let place = places
        .iter()
        .find(|place| place.name.as_deref() == Some(name));
    place.expect("a channel of this name").waiting.len()
}

#[test]
fn invariant_4_losing_offers_are_gone_when_the_alternative_has_chosen_or_was_dropped() {
    for drops in [false, true] {
        let names = ["in", "out", "buffer"].map(|name| format!("{name} {drops} of invariant 4"));
        let (one, from_one) = channel::<u32>();
        let one = one.named(&names[0]);
        let (two, from_two) = channel::<u32>();
        let two = two.named(&names[1]);
        let (three, from_three) = buffered::<u32>(Buffer::fifo(1));
        let three = three.named(&names[2]);
        three.try_send(0).unwrap();
        let mut alternative = Box::pin(async {
            alt! {
                value = from_one.recv() => value.unwrap(),
                sent = two.send(2) => sent.map(|()| 2).unwrap(),
                sent = three.send(3) => sent.map(|()| 3).unwrap(),
            }
        });
        pending(&mut alternative);
        assert_eq!([0, 1, 2].map(|n| waiting(&names[n])), [1, 1, 1]);
        if drops {
            drop(alternative);
            assert!(one.try_send(1).unwrap_err().is_full());
        } else {
            assert_eq!(one.try_send(1), Ok(()));
            assert_eq!(ready(&mut alternative), 1);
        }
        assert_eq!([0, 1, 2].map(|n| waiting(&names[n])), [0, 0, 0]);
        assert_eq!(from_two.try_recv(), Err(TryRecvError::Empty));
        // The room of the buffer goes to no sender.
        assert_eq!(from_three.try_recv(), Ok(0));
        assert_eq!(from_three.try_recv(), Err(TryRecvError::Empty));
    }
}

#[test]
fn invariant_5_a_value_that_was_not_chosen_is_never_seen_by_anyone_else() {
    let ledger = Ledger::new(3);
    let (one, from_one) = channel();
    let (two, from_two) = channel();
    let (_three, from_three) = channel::<()>();
    let made = Arc::new(AtomicBool::new(false));
    let (is_made, of_made) = (made.clone(), ledger.clone());
    let make = move || {
        is_made.store(true, Ordering::SeqCst);
        of_made.token(2)
    };
    let mut slot = Some(ledger.token(1));
    let mut alternative = Box::pin(async {
        alt! {
            sent = one.send(ledger.token(0)) => sent.is_ok(),
            sent = two.send_from(&mut slot) => sent.is_ok(),
            sent = two.send_with(make) => sent.is_ok(),
            over = from_three.recv() => over.is_ok(),
        }
    });
    pending(&mut alternative);
    from_three.poison();
    // Chosen, and not polled yet: the other offers cannot be had any more.
    assert_eq!(from_one.try_recv().unwrap_err(), TryRecvError::Empty);
    assert_eq!(from_two.try_recv().unwrap_err(), TryRecvError::Empty);
    assert!(!ready(&mut alternative));
    drop(alternative);
    assert_eq!(ledger.dropped(), [0], "a value offered with `send` goes");
    assert_eq!(slot.map(|token| token.id), Some(1));
    assert!(!made.load(Ordering::SeqCst));
    drop(ledger.token(2));
    ledger.assert_all_dropped_once();
}

#[test]
fn invariant_6_two_processes_with_opposite_alternatives_make_progress() {
    let _watchdog = Watchdog::new();
    // Step by step, in all four combinations of preferences.
    for (left_sends_first, right_sends_first) in
        [(false, false), (false, true), (true, false), (true, true)]
    {
        let ((to_right, from_left), (to_left, from_right)) = (channel(), channel());
        let offer = |sends_first, to: Sender<u8>, from: Receiver<u8>| async move {
            if sends_first {
                pri_alt! {
                    sent = to.send(1) => { sent.unwrap(); "sent" }
                    value = from.recv() => { value.unwrap(); "received" }
                }
            } else {
                pri_alt! {
                    value = from.recv() => { value.unwrap(); "received" }
                    sent = to.send(1) => { sent.unwrap(); "sent" }
                }
            }
        };
        let mut left = Box::pin(offer(left_sends_first, to_right, from_right));
        let mut right = Box::pin(offer(right_sends_first, to_left, from_left));
        pending(&mut left);
        // The second to come decides.
        let (first, second) = match ready(&mut right) {
            "sent" => ("sent", "received"),
            other => (other, "sent"),
        };
        assert_eq!(first == "sent", right_sends_first);
        assert_eq!(ready(&mut left), second);
    }
}

#[test]
fn invariant_7_one_channel_twice_is_two_offers_of_which_the_first_is_taken_first() {
    let (sender, receiver) = channel();
    let other = receiver.clone();
    let offer = || {
        Box::pin(async {
            pri_alt! {
                value = receiver.recv() => (1, value),
                value = other.recv() => (2, value),
            }
        })
    };
    // Waiting, and ready at once.
    let mut waits = offer();
    pending(&mut waits);
    assert_eq!(sender.try_send(5), Ok(()));
    assert!(
        sender.try_send(6).unwrap_err().is_full(),
        "one offer in all"
    );
    assert_eq!(ready(&mut waits), (1, Ok(5)));
    let mut send = Box::pin(sender.send(7));
    pending(&mut send);
    assert_eq!(ready(&mut offer()), (1, Ok(7)));
    assert_eq!(ready(&mut send), Ok(()));
    // Twice the same end, as senders.
    let mut sends = Box::pin(async {
        pri_alt! {
            sent = sender.send(1) => (1, sent),
            sent = sender.send(2) => (2, sent),
        }
    });
    pending(&mut sends);
    assert_eq!(receiver.try_recv(), Ok(1));
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    assert_eq!(ready(&mut sends), (1, Ok(())));
}

#[test]
fn invariant_7_both_ends_of_one_channel_never_communicate_with_themselves() {
    for starts_sending in [false, true] {
        let (sender, receiver) = channel();
        let both = |value: u8| {
            let (sender, receiver) = (&sender, &receiver);
            Box::pin(async move {
                pri_alt! {
                    sent = sender.send(value), if starts_sending => sent.map(|()| None).unwrap(),
                    value = receiver.recv() => Some(value.unwrap()),
                    sent = sender.send(value), if !starts_sending => sent.map(|()| None).unwrap(),
                }
            })
        };
        let mut alone = both(1);
        pending(&mut alone);
        pending(&mut alone);
        // Two that offer each other both ends: one sends, the other receives, as the second
        // prefers.
        let mut opposite = both(2);
        let (first, second) = (ready(&mut opposite), ready(&mut alone));
        let expected = if starts_sending {
            (None, Some(2))
        } else {
            (Some(1), None)
        };
        assert_eq!((first, second), expected);
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    }
    // Through a buffer it may send to itself, and receive that the next time.
    let (sender, receiver) = buffered(Buffer::fifo(1));
    let both = || async {
        pri_alt! {
            sent = sender.send(3) => sent.map(|()| None).unwrap(),
            value = receiver.recv() => Some(value.unwrap()),
        }
    };
    assert_eq!(block_on(both()), None);
    assert_eq!(block_on(both()), Some(3));
}

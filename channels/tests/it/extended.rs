//! Extended rendezvous: the sender is held until the receiver is done, and is never held for
//! longer, whatever happens meanwhile.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Wakes, Watchdog, pending, poll_with, ready};
use futures_lite::future::block_on;
use luna_channels::inspect::{self, Role};
use luna_channels::{Buffer, ChannelEnd, RecvError, TryRecvError, alt, buffered, channel, pri_alt};
use luna_core::current;
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::thread;

#[test]
fn the_sender_is_held_until_the_value_is_finished_or_dropped() {
    for finishes in [false, true] {
        for sender_first in [false, true] {
            let (sender, receiver) = channel();
            let (wakes, waker) = Wakes::new();
            let mut send = Box::pin(sender.send(5));
            let mut recv = Box::pin(receiver.recv_extended());
            let extended = if sender_first {
                assert!(poll_with(&mut send, &waker).is_pending());
                ready(&mut recv).unwrap()
            } else {
                pending(&mut recv);
                assert!(poll_with(&mut send, &waker).is_pending());
                ready(&mut recv).unwrap()
            };
            assert!(poll_with(&mut send, &waker).is_pending());
            assert_eq!((*extended, wakes.count()), (5, 0));
            // Meanwhile the channel is free for others.
            let mut other = Box::pin(sender.send(6));
            pending(&mut other);
            assert_eq!(receiver.try_recv(), Ok(6));
            assert_eq!(ready(&mut other), Ok(()));
            pending(&mut send);
            assert!(poll_with(&mut send, &waker).is_pending());
            if finishes {
                assert_eq!(extended.finish(), 5);
            } else {
                drop(extended);
            }
            assert_eq!(wakes.count(), 1);
            assert_eq!(ready(&mut send), Ok(()));
        }
    }
}

#[test]
fn the_sender_is_held_after_the_value_was_taken_out() {
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(5));
    pending(&mut send);
    let (value, held) = ready(&mut Box::pin(receiver.recv_extended()))
        .unwrap()
        .hold();
    assert_eq!(value, 5);
    pending(&mut send);
    drop(held);
    assert_eq!(ready(&mut send), Ok(()));
}

#[test]
fn the_value_is_dropped_before_the_sender_goes_on() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(ledger.token(0)));
    pending(&mut send);
    let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    assert_eq!(ledger.dropped(), []);
    drop(extended);
    assert!(ready(&mut send).is_ok());
    ledger.assert_all_dropped_once();
}

#[test]
fn several_are_held_and_released_in_any_order() {
    let (sender, receiver) = channel();
    let mut sends: Vec<_> = (0..3).map(|n| Box::pin(sender.send(n))).collect();
    sends.iter_mut().for_each(pending);
    let mut held: Vec<_> = (0..3)
        .map(|_| Some(ready(&mut Box::pin(receiver.recv_extended())).unwrap()))
        .collect();
    for n in [1, 2, 0] {
        sends.iter_mut().skip(n).take(1).for_each(pending);
        assert_eq!(held[n].take().unwrap().finish(), n);
        assert_eq!(ready(&mut sends[n]), Ok(()));
    }
}

#[test]
fn poisoned_meanwhile_the_sender_is_done_and_not_poisoned() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let mut send = Box::pin(sender.send(5));
    assert!(poll_with(&mut send, &waker).is_pending());
    let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    let mut waits = Box::pin(sender.send(6));
    pending(&mut waits);
    sender.poison();
    assert_eq!(wakes.count(), 1);
    assert_eq!(ready(&mut send), Ok(()));
    assert!(ready(&mut waits).unwrap_err().is_poisoned());
    // The receiver still has its value, and releases no other sender.
    assert_eq!(extended.finish(), 5);
}

#[test]
fn a_failed_sibling_does_not_take_a_held_communication_back() {
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(5));
    pending(&mut send);
    let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    current::with_branch_below(true, 0, 0, || pending(&mut send));
    assert_eq!(extended.finish(), 5);
    assert_eq!(
        current::with_branch_below(true, 0, 0, || ready(&mut send)),
        Ok(())
    );
}

#[test]
fn a_forgotten_value_holds_its_sender_until_the_channel_ends() {
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(5));
    pending(&mut send);
    std::mem::forget(ready(&mut Box::pin(receiver.recv_extended())).unwrap());
    pending(&mut send);
    drop(receiver);
    assert_eq!(ready(&mut send), Ok(()));
}

#[test]
fn the_senders_future_is_dropped_while_it_is_held() {
    let ledger = Ledger::new(2);
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(ledger.token(0)));
    pending(&mut send);
    let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    drop(send);
    // Another one at the same address, most likely: it is not the one that was held.
    let mut next = Box::pin(sender.send(ledger.token(1)));
    pending(&mut next);
    let second = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    assert_eq!(extended.finish().id, 0);
    pending(&mut next);
    assert_eq!(second.finish().id, 1);
    assert!(ready(&mut next).is_ok());
    ledger.assert_all_dropped_once();
}

#[test]
fn the_receivers_future_is_dropped_after_it_got_the_value() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let mut recv = Box::pin(receiver.recv_extended());
    pending(&mut recv);
    let mut send = Box::pin(sender.send(5));
    assert!(poll_with(&mut send, &waker).is_pending());
    drop(recv);
    // The value is back, and the sender goes on.
    assert_eq!(wakes.count(), 1);
    assert_eq!(ready(&mut send), Ok(()));
    let back = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    assert_eq!(back.finish(), 5);
}

#[test]
fn a_value_that_comes_back_is_received_by_extended_rendezvous_too() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let mut first = Box::pin(receiver.recv());
    pending(&mut first);
    let mut waits = Box::pin(receiver.recv_extended());
    assert!(poll_with(&mut waits, &waker).is_pending());
    sender.try_send(5).unwrap();
    drop(first);
    assert_eq!(wakes.count(), 1);
    assert_eq!(ready(&mut waits).unwrap().finish(), 5);
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
}

#[test]
fn a_try_send_does_not_find_it_on_a_rendezvous() {
    let (sender, receiver) = channel();
    let mut extended = Box::pin(receiver.recv_extended());
    pending(&mut extended);
    assert!(sender.try_send(1).unwrap_err().is_full());
    // But it finds the waiter behind it.
    let mut plain = Box::pin(receiver.recv());
    pending(&mut plain);
    assert_eq!(sender.try_send(2), Ok(()));
    assert_eq!(ready(&mut plain), Ok(2));
    pending(&mut extended);
}

#[test]
fn a_buffer_holds_nobody() {
    for buffer in [
        Buffer::fifo(1),
        Buffer::overwrite_oldest(1),
        Buffer::overwrite_newest(1),
        Buffer::allocating_unbounded(),
    ] {
        let (sender, receiver) = buffered(buffer);
        // Buffered already, or handed over as it waits, by a send or by a try_send.
        sender.try_send(1).unwrap();
        let first = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
        let mut waits = Box::pin(receiver.recv_extended());
        pending(&mut waits);
        assert_eq!(ready(&mut Box::pin(sender.send(2))), Ok(()));
        let second = ready(&mut waits).unwrap();
        let mut waits = Box::pin(receiver.recv_extended());
        pending(&mut waits);
        assert_eq!(sender.try_send(3), Ok(()));
        let third = ready(&mut waits).unwrap();
        assert_eq!(
            [first.finish(), second.finish(), third.finish()],
            [1, 2, 3],
            "{buffer:?}"
        );
        assert_eq!(receiver.buffered(), 0);
    }
}

#[test]
fn as_a_guard_on_the_receivers_side() {
    for sender_first in [false, true] {
        let ((one, from_one), (_two, from_two)) = (channel::<u8>(), channel::<u8>());
        let mut alternative = Box::pin(async {
            alt! {
                value = from_one.recv_extended() => value.unwrap(),
                value = from_two.recv_extended() => value.unwrap(),
            }
        });
        let mut send = Box::pin(one.send(5));
        if sender_first {
            pending(&mut send);
        } else {
            pending(&mut alternative);
            assert!(one.try_send(4).unwrap_err().is_full(), "it cannot be held");
            pending(&mut send);
        }
        let extended = ready(&mut alternative);
        pending(&mut send);
        assert_eq!(extended.finish(), 5);
        assert_eq!(ready(&mut send), Ok(()));
    }
}

/// Roles of the waiters on the channel of this name.
fn roles(name: &str) -> Vec<Role> {
    let places = inspect::wait_points();
    let place = places
        .iter()
        .find(|place| place.name.as_deref() == Some(name));
    let waiting = &place.expect("a channel of this name").waiting;
    waiting.iter().map(|waiting| waiting.role).collect()
}

#[test]
fn an_output_guard_is_held_too() {
    for guard_first in [false, true] {
        let ((one, from_one), (two, from_two)) = (channel::<u8>(), channel::<u8>());
        let (one, two) = (
            one.named("an output guard that is held"),
            two.named("not chosen as it is held"),
        );
        let (wakes, waker) = Wakes::new();
        let mut alternative = Box::pin(async {
            alt! {
                sent = one.send(1) => sent,
                value = from_two.recv() => unreachable!("{value:?}"),
            }
        });
        let mut recv = Box::pin(from_one.recv_extended());
        if guard_first {
            assert!(poll_with(&mut alternative, &waker).is_pending());
        } else {
            pending(&mut recv);
            assert!(poll_with(&mut alternative, &waker).is_pending());
        }
        let extended = ready(&mut recv).unwrap();
        // It may know what was chosen, but it is held, and offers nothing else.
        assert!(poll_with(&mut alternative, &waker).is_pending());
        assert_eq!(roles("an output guard that is held"), [Role::Held]);
        assert_eq!(roles("not chosen as it is held"), []);
        assert!(two.try_send(2).unwrap_err().is_full());
        let before = wakes.count();
        assert_eq!(extended.finish(), 1);
        assert_eq!(wakes.count(), before + 1);
        assert_eq!(ready(&mut alternative), Ok(()));
    }
}

#[test]
fn a_held_alternative_is_dropped_poisoned_or_its_receiver_goes() {
    let ledger = Ledger::new(3);
    for (n, what) in ["dropped", "poisoned", "receiver goes"].iter().enumerate() {
        let ((one, from_one), (_two, from_two)) = (channel(), channel::<u8>());
        let mut alternative = Box::pin(async {
            pri_alt! {
                value = from_two.recv() => unreachable!("{value:?}"),
                sent = one.send(ledger.token(n)) => assert!(sent.is_ok()),
            }
        });
        pending(&mut alternative);
        match *what {
            "dropped" => {
                let extended = ready(&mut Box::pin(from_one.recv_extended())).unwrap();
                pending(&mut alternative);
                drop(alternative);
                assert_eq!(extended.finish().id, n);
            }
            "poisoned" => {
                let extended = ready(&mut Box::pin(from_one.recv_extended())).unwrap();
                from_one.poison();
                ready(&mut alternative);
                assert_eq!(extended.finish().id, n);
            }
            _ => {
                let mut recv = Box::pin(from_one.recv_extended());
                drop(alternative);
                let mut alternative = Box::pin(one.send(ledger.token(n)));
                pending(&mut recv);
                pending(&mut alternative);
                drop(recv);
                assert!(ready(&mut alternative).is_ok());
            }
        }
    }
    assert_eq!(ledger.drops(0), 1);
    assert_eq!(ledger.drops(1), 1);
    assert_eq!(ledger.drops(2), 2, "one was never sent, one came back");
}

#[test]
fn both_sides_are_alternatives() {
    let ((one, from_one), (two, from_two)) = (channel::<u8>(), channel::<u8>());
    let mut offers = Box::pin(async {
        alt! {
            sent = one.send(1) => sent,
            sent = two.send(2) => sent,
        }
    });
    pending(&mut offers);
    let extended = block_on(async {
        pri_alt! {
            value = from_two.recv_extended() => value.unwrap(),
            value = from_one.recv_extended() => value.unwrap(),
        }
    });
    assert_eq!(*extended, 2);
    pending(&mut offers);
    assert_eq!(from_one.try_recv(), Err(TryRecvError::Empty));
    drop(extended);
    assert_eq!(ready(&mut offers), Ok(()));
}

#[test]
fn one_that_is_held_is_known_by_name() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("held")).unwrap();
    let (sender, receiver) = channel::<u8>();
    let sender = sender.named("holds its sender");
    let client = executor.spawn(ProcessSpec::new("client"), move || async move {
        sender.send(1).await.unwrap();
    });
    let server = executor.spawn(ProcessSpec::new("server"), move || async move {
        let request = receiver.recv_extended().await.unwrap();
        let places = inspect::wait_points();
        let place = places
            .iter()
            .find(|place| place.name.as_deref() == Some("holds its sender"))
            .unwrap();
        assert_eq!(place.waiting.len(), 1);
        assert_eq!(place.waiting[0].role, Role::Held);
        assert_eq!(Some(place.waiting[0].user), place.sender);
        assert_ne!(place.sender, place.receiver);
        drop(request);
    });
    executor.release();
    assert_eq!(server.wait(), Exit::Completed);
    assert_eq!(client.wait(), Exit::Completed);
}

#[test]
fn across_threads_the_sender_sees_what_the_receiver_did() {
    let _watchdog = Watchdog::new();
    // What is done before the release is visible after the send: a plain cell, shared by a lock
    // without waiters.
    let (sender, receiver) = channel::<usize>();
    let done = std::sync::Mutex::new(0);
    thread::scope(|scope| {
        scope.spawn(|| {
            block_on(async {
                loop {
                    match receiver.recv_extended().await {
                        Ok(request) => *done.try_lock().expect("the sender is held") = *request,
                        Err(error) => return assert_eq!(error, RecvError::Closed),
                    }
                }
            })
        });
        for n in 1..=2_000 {
            sender.blocking_send(n).unwrap();
            assert_eq!(*done.try_lock().expect("the receiver is done"), n);
        }
        drop(sender);
    });
}

#[test]
fn a_refused_value_goes_back_to_its_sender() {
    let (sender, receiver) = channel();
    let (wakes, waker) = Wakes::new();
    let ends = [ChannelEnd::Closed, ChannelEnd::Poisoned];
    for (is_chosen, end) in [false, true].into_iter().zip(ends) {
        let mut send = Box::pin(async {
            match is_chosen {
                false => sender.send(5).await,
                true => alt! { sent = sender.send(5) => sent },
            }
        });
        assert!(poll_with(&mut send, &waker).is_pending());
        let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
        assert!(poll_with(&mut send, &waker).is_pending());
        let before = wakes.count();
        assert_eq!(extended.refuse(end), None);
        assert_eq!(wakes.count(), before + 1);
        let error = ready(&mut send).unwrap_err();
        assert_eq!(error.is_poisoned(), end == ChannelEnd::Poisoned);
        assert_eq!(error.into_inner(), 5);
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    }
    // The channel goes on.
    let mut send = Box::pin(sender.send(6));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(6));
    assert_eq!(ready(&mut send), Ok(()));
}

#[test]
fn a_refused_value_without_a_sender_stays_with_the_receiver() {
    let ledger = Ledger::new(2);
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(ledger.token(0)));
    pending(&mut send);
    let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    drop(send); // cancelled
    assert!(extended.refuse(ChannelEnd::Closed).is_some());
    let token = ledger.token(1);
    let mut send = Box::pin(sender.send_with(move || token));
    pending(&mut send);
    let extended = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
    assert!(extended.refuse(ChannelEnd::Poisoned).is_none());
    assert!(ready(&mut send).unwrap_err().is_poisoned());
    drop(send);
    assert_eq!(ledger.dropped(), [0, 1]);
}

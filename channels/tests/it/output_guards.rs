//! Output guards in their three forms (`send`, `send_from`, `send_with`), in every way that an
//! offer can end.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Token, Watchdog, pending, poll, ready};
use futures_lite::future::block_on;
use luna_channels::{Buffer, Receiver, Sender, TryRecvError, alt, buffered, channel, pri_alt};
use luna_core::current;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Which guard an offer of the three forms chose, and how it ended.
#[derive(Debug, PartialEq, Eq)]
enum Chosen {
    Send(Result<(), Option<usize>>),
    From(Result<(), bool>),
    With(Result<(), bool>),
    Other,
}

/// Offers token 0 by `send` on the first, 1 out of a slot on the second, 2 made on the third; or
/// receives from the fourth.
async fn offer(
    to: &[Sender<Token>; 3],
    slot: &mut Option<Token>,
    ledger: &Ledger,
    made: &Arc<AtomicUsize>,
    other: &Receiver<()>,
) -> Chosen {
    let (made, of_made) = (made.clone(), ledger.clone());
    alt! {
        sent = to[0].send(ledger.token(0)) => Chosen::Send(sent.map_err(|error| {
            Some(error.into_inner().id)
        })),
        sent = to[1].send_from(slot) => Chosen::From(sent.map_err(|error| error.is_poisoned())),
        sent = to[2].send_with(move || {
            made.fetch_add(1, Ordering::SeqCst);
            of_made.token(2)
        }) => Chosen::With(sent.map_err(|error| error.is_poisoned())),
        _ = other.recv() => Chosen::Other,
    }
}

/// Offers, and does `meanwhile` before (`false`) or after (`true`) the offer waits; gives what was
/// chosen, which tokens were dropped by then, and what is left in the slot and how many were made.
fn after_each(
    waits: bool,
    meanwhile: impl Fn(&mut [Receiver<Token>; 3], &mut Vec<Token>),
) -> (Chosen, Vec<usize>, bool, usize) {
    let ledger = Ledger::new(3);
    let mut received = Vec::new();
    let [(s0, r0), (s1, r1), (s2, r2)] = [channel(), channel(), channel()];
    let (to, mut from) = ([s0, s1, s2], [r0, r1, r2]);
    let (_other, from_other) = channel();
    let mut slot = Some(ledger.token(1));
    let made = Arc::new(AtomicUsize::new(0));
    let chosen = {
        let mut offer = Box::pin(offer(&to, &mut slot, &ledger, &made, &from_other));
        if waits {
            pending(&mut offer);
            meanwhile(&mut from, &mut received);
            ready(&mut offer)
        } else {
            meanwhile(&mut from, &mut received);
            ready(&mut offer)
        }
    };
    let dropped = ledger.dropped();
    let made = made.load(Ordering::SeqCst);
    (chosen, dropped, slot.is_some(), made)
}

#[test]
fn each_form_is_chosen_and_leaves_the_others() {
    let take = |n: usize| {
        move |from: &mut [Receiver<Token>; 3], received: &mut Vec<Token>| {
            let token = from[n].try_recv().unwrap();
            assert_eq!(token.id, n);
            received.push(token);
        }
    };
    assert_eq!(
        after_each(true, take(0)),
        (Chosen::Send(Ok(())), vec![], true, 0)
    );
    assert_eq!(
        after_each(true, take(1)),
        (Chosen::From(Ok(())), vec![0], false, 0)
    );
    assert_eq!(
        after_each(true, take(2)),
        (Chosen::With(Ok(())), vec![0], true, 1)
    );
}

#[test]
fn an_ended_or_poisoned_channel_gives_back_what_it_was_to_send() {
    for waits in [false, true] {
        for poisons in [false, true] {
            let end = |n: usize| {
                move |from: &mut [Receiver<Token>; 3], _: &mut Vec<Token>| {
                    if poisons {
                        from[n].poison();
                    } else {
                        // Another channel's end in its place.
                        from[n] = channel().1;
                    }
                }
            };
            let (chosen, dropped, in_slot, made) = after_each(waits, end(0));
            assert_eq!(chosen, Chosen::Send(Err(Some(0))));
            assert_eq!((dropped, in_slot, made), (vec![0], true, 0));
            let (chosen, dropped, in_slot, made) = after_each(waits, end(1));
            assert_eq!(chosen, Chosen::From(Err(poisons)));
            assert_eq!((dropped, in_slot, made), (vec![0], true, 0));
            let (chosen, dropped, in_slot, made) = after_each(waits, end(2));
            assert_eq!(chosen, Chosen::With(Err(poisons)));
            assert_eq!((dropped, in_slot, made), (vec![0], true, 0));
        }
    }
}

#[test]
fn a_failed_sibling_makes_the_first_guard_fail_and_touches_no_other() {
    for waits in [false, true] {
        let ledger = Ledger::new(3);
        let [(s0, r0), (s1, r1), (s2, r2)] = [channel(), channel(), channel()];
        let (to, (_other, from_other)) = ([s0, s1, s2], channel());
        let mut slot = Some(ledger.token(1));
        let made = Arc::new(AtomicUsize::new(0));
        let mut offer = Box::pin(offer(&to, &mut slot, &ledger, &made, &from_other));
        if waits {
            pending(&mut offer);
        }
        let chosen = current::with_branch_below(true, 0, 0, || ready(&mut offer));
        assert_eq!(chosen, Chosen::Send(Err(Some(0))));
        drop(offer);
        assert_eq!(ledger.dropped(), [0]);
        assert!(slot.is_some() && made.load(Ordering::SeqCst) == 0);
        for from in [r0, r1, r2] {
            assert_eq!(from.try_recv().unwrap_err(), TryRecvError::Empty);
        }
    }
}

#[test]
fn dropped_before_a_poll_while_it_waits_and_after_it_was_chosen() {
    for polls in [0, 1] {
        for takes in [None, Some(0), Some(1), Some(2)] {
            let ledger = Ledger::new(3);
            let [(s0, r0), (s1, r1), (s2, r2)] = [channel(), channel(), channel()];
            let (to, from, (_other, from_other)) = ([s0, s1, s2], [r0, r1, r2], channel());
            let mut slot = Some(ledger.token(1));
            let made = Arc::new(AtomicUsize::new(0));
            let mut offer = Box::pin(offer(&to, &mut slot, &ledger, &made, &from_other));
            if polls == 1 {
                pending(&mut offer);
            }
            let taken = takes.and_then(|n| from[n].try_recv().ok());
            assert_eq!(taken.is_some(), polls == 1 && takes.is_some());
            drop(offer);
            // What was sent stays sent; what was not, is where it was.
            let sent = taken.as_ref().map(|token| token.id);
            assert_eq!(slot.is_some(), sent != Some(1));
            assert_eq!(made.load(Ordering::SeqCst), usize::from(sent == Some(2)));
            assert_eq!(
                ledger.drops(0),
                usize::from(polls == 1 && sent != Some(0)),
                "`send` is given its value as the guard is evaluated, and keeps nothing"
            );
            drop((taken, slot));
            for n in ledger.dropped() {
                assert_eq!(ledger.drops(n), 1);
            }
        }
    }
}

#[test]
fn the_three_forms_awaited_alone() {
    let ledger = Ledger::new(3);
    let (sender, receiver) = channel();
    let mut slot = Some(ledger.token(0));
    // Dropped as it waits, and after it was taken.
    let mut send = Box::pin(sender.send_from(&mut slot));
    pending(&mut send);
    drop(send);
    assert!(slot.is_some());
    let mut send = Box::pin(sender.send_from(&mut slot));
    pending(&mut send);
    assert_eq!(receiver.try_recv().unwrap().id, 0);
    drop(send);
    assert!(slot.is_none());
    // An empty slot offers nothing.
    let mut send = Box::pin(sender.send_from(&mut slot));
    pending(&mut send);
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
    let failed = current::with_branch_below(true, 0, 0, || ready(&mut send)).unwrap_err();
    assert!(failed.is_poisoned());
    drop(send);
    // A maker that is not called, and one that is.
    let make = |id| {
        let ledger = ledger.clone();
        move || ledger.token(id)
    };
    let mut send = Box::pin(sender.send_with(make(1)));
    pending(&mut send);
    drop(send);
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    assert!(ready(&mut Box::pin(sender.send_with(make(1)))).is_ok());
    assert_eq!(ready(&mut recv).unwrap().id, 1);
    drop(recv);
    drop(receiver);
    let mut slot = Some(ledger.token(2));
    assert!(ready(&mut Box::pin(sender.send_from(&mut slot))).is_err());
    assert!(ready(&mut Box::pin(sender.send_with(make(2)))).is_err());
    drop(slot);
    ledger.assert_all_dropped_once();
}

#[test]
fn an_empty_slot_is_never_ready_as_a_guard() {
    let (sender, receiver) = channel::<u8>();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    let mut slot = None;
    let chosen = block_on(async {
        pri_alt! {
            sent = sender.send_from(&mut slot) => sent.is_ok(),
            skip => false,
        }
    });
    assert!(!chosen);
    pending(&mut recv);
    slot = Some(4);
    assert!(block_on(async {
        pri_alt! {
            sent = sender.send_from(&mut slot) => sent.is_ok(),
            skip => false,
        }
    }));
    assert_eq!((ready(&mut recv), slot), (Ok(4), None));
}

/// A closure for `send_with` that panics.
fn broken() -> u8 {
    panic!("the maker of a value")
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "a panic ends the program")]
fn a_maker_panics_on_its_own_side() {
    let _watchdog = Watchdog::new();
    for in_alternative in [false, true] {
        let (sender, receiver) = channel::<u8>();
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        let mut send: std::pin::Pin<Box<dyn Future<Output = ()>>> = if in_alternative {
            let (_never, other) = channel::<u8>();
            let sender = sender.clone();
            Box::pin(async move {
                pri_alt! {
                    _ = sender.send_with(broken) => unreachable!(),
                    _ = other.recv() => unreachable!(),
                }
            })
        } else {
            let sender = sender.clone();
            Box::pin(async move { assert!(sender.send_with(broken).await.is_ok()) })
        };
        assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut send))).is_err());
        drop(send);
        // Nothing hangs: the receiver fails, and so do all operations that come.
        assert!(ready(&mut recv).unwrap_err().is_poisoned());
        assert!(sender.try_send(1).unwrap_err().is_poisoned());
    }
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "a panic ends the program")]
fn a_maker_panics_on_its_partners_side() {
    let _watchdog = Watchdog::new();
    for in_alternative in [false, true] {
        for receives_in_alternative in [false, true] {
            for is_polled in [false, true] {
                let (sender, receiver) = channel::<u8>();
                let (never, other) = channel::<u8>();
                let mut send: std::pin::Pin<Box<dyn Future<Output = ()>>> = if in_alternative {
                    let (sender, other) = (sender.clone(), other.clone());
                    Box::pin(async move {
                        pri_alt! {
                            _ = other.recv() => unreachable!(),
                            _ = sender.send_with(broken) => unreachable!(),
                        }
                    })
                } else {
                    let sender = sender.clone();
                    Box::pin(async move { assert!(sender.send_with(broken).await.is_ok()) })
                };
                pending(&mut send);
                let mut waits = Box::pin(sender.send(1));
                pending(&mut waits);
                // The receiver does not panic: it gets an error.
                let received = if receives_in_alternative {
                    block_on(async {
                        alt! {
                            value = receiver.recv() => value,
                            value = other.recv() => value,
                        }
                    })
                } else {
                    block_on(receiver.recv())
                };
                assert!(received.unwrap_err().is_poisoned());
                assert!(ready(&mut waits).unwrap_err().is_poisoned());
                assert!(receiver.try_recv().unwrap_err().is_poisoned());
                if is_polled {
                    // The offering process panics.
                    assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut send))).is_err());
                }
                drop(send);
                assert!(never.try_send(1).unwrap_err().is_full(), "withdrawn");
            }
        }
    }
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "a panic ends the program")]
fn a_maker_panics_as_it_is_moved_up_into_a_buffer() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = buffered::<u8>(Buffer::fifo(1));
    sender.try_send(1).unwrap();
    let mut send = Box::pin(sender.send_with(broken));
    pending(&mut send);
    // What was received is received.
    assert_eq!(receiver.try_recv(), Ok(1));
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut send))).is_err());
    assert!(ready(&mut recv).unwrap_err().is_poisoned());
    // And on the way into one that has room.
    let (sender, receiver) = buffered::<u8>(Buffer::fifo(1));
    let mut send = Box::pin(sender.send_with(broken));
    assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut send))).is_err());
    assert!(receiver.try_recv().unwrap_err().is_poisoned());
}

#[test]
fn guards_of_buffered_channels_and_the_value_that_is_overwritten() {
    let ledger = Ledger::new(4);
    for (buffer, ids) in [
        (Buffer::overwrite_oldest(1), [0, 1]),
        (Buffer::overwrite_newest(1), [2, 3]),
    ] {
        let (sender, receiver) = buffered(buffer);
        let (_never, other) = channel::<()>();
        for (n, id) in ids.into_iter().enumerate() {
            block_on(async {
                alt! {
                    _ = other.recv() => unreachable!(),
                    sent = sender.send(ledger.token(id)) => assert!(sent.is_ok()),
                }
            });
            assert_eq!(ledger.drops(ids[0]), n);
        }
        assert_eq!(receiver.try_recv().unwrap().id, ids[1]);
    }
    ledger.assert_all_dropped_once();
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn across_threads_each_offer_is_taken_once_or_still_there() {
    let _watchdog = Watchdog::new();
    // Two receivers compete for an offer of two values out of slots: one gets one, and the other
    // slot stays full.
    for round in 0..1_000 {
        let ((one, from_one), (two, from_two)) = (channel(), channel());
        let (mut first, mut second) = (Some(1), Some(2));
        let received = thread::scope(|scope| {
            let receivers =
                [from_one, from_two].map(|from| scope.spawn(move || from.blocking_recv()));
            block_on(async {
                alt! {
                    sent = one.send_from(&mut first) => sent.unwrap(),
                    sent = two.send_from(&mut second) => sent.unwrap(),
                }
            });
            drop((one, two));
            receivers.map(|receiver| receiver.join().unwrap().ok())
        });
        match received {
            [Some(1), None] => assert_eq!((first, second), (None, Some(2)), "round {round}"),
            [None, Some(2)] => assert_eq!((first, second), (Some(1), None), "round {round}"),
            other => panic!("round {round}: {other:?}"),
        }
    }
}

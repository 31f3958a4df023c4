//! Poison: all operations that wait and all that come fail; what was communicated stays
//! communicated.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Wakes, Watchdog, pending, poll_with, ready};
use futures_lite::StreamExt;
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, RecvError, RecvTimeoutError, Sender, TryRecvError, TrySendError, buffered, channel,
};
use luna_core::current;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

#[test]
fn all_forms_fail_on_both_ends_whichever_poisoned() {
    let _watchdog = Watchdog::new();
    for by_sender in [true, false] {
        for (sender, receiver) in [
            channel(),
            buffered(Buffer::fifo(2)),
            buffered(Buffer::overwrite_oldest(2)),
        ] {
            if by_sender {
                sender.poison();
            } else {
                receiver.poison();
            }
            receiver.poison(); // again: nothing more
            let hour = Duration::from_secs(3600);
            assert_eq!(sender.try_send(1), Err(TrySendError::Poisoned(1)));
            let error = block_on(sender.send(2)).unwrap_err();
            assert!(error.is_poisoned() && !error.is_closed() && error.into_inner() == 2);
            assert!(sender.blocking_send(3).unwrap_err().is_poisoned());
            assert!(
                block_on(sender.send_timeout(4, hour))
                    .unwrap_err()
                    .is_poisoned()
            );
            assert!(
                sender
                    .blocking_send_timeout(5, hour)
                    .unwrap_err()
                    .is_poisoned()
            );

            assert_eq!(receiver.try_recv(), Err(TryRecvError::Poisoned));
            assert_eq!(block_on(receiver.recv()), Err(RecvError::Poisoned));
            assert_eq!(receiver.blocking_recv(), Err(RecvError::Poisoned));
            assert_eq!(
                block_on(receiver.recv_timeout(hour)),
                Err(RecvTimeoutError::Poisoned)
            );
            assert_eq!(
                receiver.blocking_recv_timeout(hour),
                Err(RecvTimeoutError::Poisoned)
            );
            assert_eq!(block_on(receiver.stream().count()), 0);
        }
    }
}

#[test]
fn all_that_wait_are_woken_once() {
    let (sender, receiver) = channel::<u8>();
    let (wakes, waker) = Wakes::new();
    let mut recvs: Vec<_> = (0..3).map(|_| Box::pin(receiver.recv())).collect();
    for recv in &mut recvs {
        assert!(poll_with(recv, &waker).is_pending());
    }
    sender.poison();
    assert_eq!(wakes.count(), 3);
    assert!(
        recvs
            .iter_mut()
            .all(|recv| ready(recv) == Err(RecvError::Poisoned))
    );

    let (sender, receiver) = channel();
    let ledger = Ledger::new(3);
    let mut sends: Vec<_> = (0..3)
        .map(|n| Box::pin(sender.send(ledger.token(n))))
        .collect();
    for send in &mut sends {
        assert!(poll_with(send, &waker).is_pending());
    }
    receiver.poison();
    assert_eq!(wakes.count(), 6);
    for (n, send) in sends.iter_mut().enumerate() {
        let error = ready(send).unwrap_err();
        assert!(error.is_poisoned());
        assert_eq!(error.into_inner().id, n);
    }
    ledger.assert_all_dropped_once();
}

#[test]
fn what_was_communicated_is_not_reported_as_poisoned() {
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(1).unwrap();
    sender.poison();
    assert_eq!(ready(&mut recv), Ok(1));

    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(1));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(1));
    receiver.poison();
    assert_eq!(ready(&mut send), Ok(()));
}

#[test]
fn what_was_buffered_is_dropped_and_not_received() {
    let ledger = Ledger::new(3);
    let (sender, receiver) = buffered(Buffer::fifo(3));
    for n in 0..3 {
        sender.try_send(ledger.token(n)).unwrap();
    }
    sender.poison();
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Poisoned);
    ledger.assert_all_dropped_once();
}

#[test]
fn a_value_that_comes_back_to_a_poisoned_channel_is_dropped() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(ledger.token(0)).unwrap();
    sender.poison();
    assert_eq!(ledger.dropped(), []);
    drop(recv);
    ledger.assert_all_dropped_once();
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Poisoned);
}

#[test]
fn a_request_in_a_poisoned_channel_lets_its_client_go() {
    let _watchdog = Watchdog::new();
    let (requests, server) = buffered::<Sender<u32>>(Buffer::fifo(1));
    let (reply, answer) = channel::<u32>();
    requests.try_send(reply).unwrap();
    server.poison();
    assert_eq!(answer.blocking_recv(), Err(RecvError::Closed));
}

#[test]
fn poison_outlasts_the_close() {
    let (sender, receiver) = channel::<u8>();
    sender.poison();
    drop(sender);
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Poisoned));

    let (sender, receiver) = buffered(Buffer::fifo(1));
    sender.try_send(1).unwrap();
    drop(sender);
    receiver.poison(); // after the close
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Poisoned));
}

#[test]
fn a_failed_sibling_branch_makes_pending_and_later_operations_fail_as_poisoned() {
    // What `par!` does to the siblings of a branch that has failed.
    let (sender, receiver) = channel();
    let mut send = Box::pin(sender.send(1));
    pending(&mut send);
    current::with_branch_below(true, 0, 0, || {
        let error = ready(&mut send).unwrap_err();
        assert!(error.is_poisoned() && error.into_inner() == 1);
        assert_eq!(
            ready(&mut Box::pin(receiver.recv())),
            Err(RecvError::Poisoned)
        );
        assert!(
            ready(&mut Box::pin(sender.send(2)))
                .unwrap_err()
                .is_poisoned()
        );
    });
    assert_eq!(
        receiver.try_recv(),
        Err(TryRecvError::Empty),
        "the offer of the failed branch is gone"
    );

    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    current::with_branch_below(true, 0, 0, || {
        assert_eq!(ready(&mut recv), Err(RecvError::Poisoned))
    });
    assert!(
        sender.try_send(3).unwrap_err().is_full(),
        "and so is its request"
    );
}

#[test]
fn a_failed_sibling_branch_does_not_take_back_what_was_communicated() {
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(1).unwrap();
    current::with_branch_below(true, 0, 0, || assert_eq!(ready(&mut recv), Ok(1)));
    drop(recv);

    let mut send = Box::pin(sender.send(2));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(2));
    current::with_branch_below(true, 0, 0, || assert_eq!(ready(&mut send), Ok(())));
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn poison_races_with_many_that_communicate() {
    let _watchdog = Watchdog::new();
    let values = 40;
    for _ in 0..100 {
        let ledger = Ledger::new(3 * values);
        let (sender, receiver) = channel();
        let (sent, received) = (AtomicUsize::new(0), AtomicUsize::new(0));
        thread::scope(|scope| {
            for part in 0..3 {
                let (sender, receiver, ledger) = (sender.clone(), receiver.clone(), ledger.clone());
                let (sent, received) = (&sent, &received);
                scope.spawn(move || {
                    for n in 0..values {
                        match sender.blocking_send(ledger.token(part * values + n)) {
                            Ok(()) => sent.fetch_add(1, Ordering::Relaxed),
                            Err(error) => {
                                assert!(error.is_poisoned());
                                0
                            }
                        };
                    }
                });
                scope.spawn(move || {
                    while receiver.blocking_recv().is_ok() {
                        if received.fetch_add(1, Ordering::Relaxed) == 30 {
                            receiver.poison();
                        }
                    }
                });
            }
        });
        assert_eq!(
            sent.into_inner(),
            received.into_inner(),
            "each send that succeeded was received"
        );
        ledger.assert_all_dropped_once();
    }
}

#[test]
fn ends_that_go_with_a_culprit_poison_also_if_others_are_left() {
    let _watchdog = Watchdog::new();
    for by_sender in [true, false] {
        for (sender, receiver) in [channel(), buffered(Buffer::fifo(2))] {
            let (other_sender, other_receiver) = (sender.clone(), receiver.clone());
            current::poison_dropped_ends(|| match by_sender {
                true => drop(sender),
                false => drop(receiver),
            });
            assert_eq!(other_sender.try_send(1), Err(TrySendError::Poisoned(1)));
            assert_eq!(other_receiver.try_recv(), Err(TryRecvError::Poisoned));
        }
        // Whatever happens in between, ends that are dropped afterwards merely count as less again.
        let panics = || current::poison_dropped_ends(|| panic!("in a drop"));
        assert!(std::panic::catch_unwind(panics).is_err());
        let (sender, receiver) = channel::<u32>();
        match by_sender {
            true => {
                drop(sender);
                assert_eq!(receiver.try_recv(), Err(TryRecvError::Closed));
            }
            false => {
                drop(receiver);
                assert_eq!(sender.try_send(1), Err(TrySendError::Closed(1)));
            }
        }
    }
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn one_that_waits_is_told_that_the_other_end_went_with_a_culprit() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel::<u32>();
    let waiting = thread::spawn(move || receiver.blocking_recv());
    current::poison_dropped_ends(|| drop(sender));
    assert_eq!(waiting.join().unwrap(), Err(RecvError::Poisoned));
}

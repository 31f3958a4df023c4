//! Channels with a buffer: first in, first out; and the two that overwrite.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Wakes, pending, poll_with, ready};
use luna_channels::{
    Buffer, BufferError, TryRecvError, TrySendError, buffered, channel, try_buffered,
};
use std::task::Poll;

#[test]
fn holds_as_many_as_its_capacity() {
    for capacity in [1, 2, 3, 64] {
        let (sender, receiver) = buffered(Buffer::fifo(capacity));
        for round in 0..3 {
            for n in 0..capacity {
                assert_eq!(receiver.buffered(), n);
                assert_eq!(sender.try_send(round * 100 + n), Ok(()));
            }
            assert_eq!(sender.try_send(7), Err(TrySendError::Full(7)));
            for n in 0..capacity {
                assert_eq!(receiver.try_recv(), Ok(round * 100 + n));
            }
            assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
        }
    }
}

#[test]
fn a_send_into_room_completes_at_once_and_one_into_a_full_buffer_waits() {
    let (sender, receiver) = buffered(Buffer::fifo(1));
    assert_eq!(ready(&mut Box::pin(sender.send(1))), Ok(()));
    let (wakes, waker) = Wakes::new();
    let mut second = Box::pin(sender.send(2));
    assert!(poll_with(&mut second, &waker).is_pending());
    assert_eq!(
        receiver.buffered(),
        1,
        "the waiting sender's value is not in the buffer"
    );
    assert_eq!(receiver.try_recv(), Ok(1));
    // The buffer has taken it: that ends a buffered send.
    assert_eq!((wakes.count(), receiver.buffered()), (1, 1));
    assert_eq!(poll_with(&mut second, &waker), Poll::Ready(Ok(())));
    assert_eq!(receiver.try_recv(), Ok(2));
}

#[test]
fn one_that_waited_for_room_comes_before_the_one_that_comes_later() {
    let (sender, receiver) = buffered(Buffer::fifo(2));
    for n in 0..2 {
        sender.try_send(n).unwrap();
    }
    let mut waiting: Vec<_> = (2..5).map(|n| Box::pin(sender.send(n))).collect();
    waiting.iter_mut().for_each(pending);
    for n in 0..3 {
        assert!(sender.try_send(99).unwrap_err().is_full());
        assert_eq!(receiver.try_recv(), Ok(n));
        // A waiting send has moved up, into the room there was.
        assert_eq!(ready(&mut waiting[n]), Ok(()));
        waiting[n + 1..].iter_mut().for_each(pending);
    }
    assert_eq!(
        [
            receiver.try_recv(),
            receiver.try_recv(),
            receiver.try_recv()
        ],
        [Ok(3), Ok(4), Err(TryRecvError::Empty)]
    );
}

#[test]
fn a_receiver_that_waits_gets_the_value_past_the_buffer() {
    let (sender, receiver) = buffered(Buffer::fifo(2));
    let mut recv = Box::pin(receiver.recv());
    pending(&mut recv);
    sender.try_send(1).unwrap();
    assert_eq!(receiver.buffered(), 0);
    sender.try_send(2).unwrap();
    assert_eq!(ready(&mut recv), Ok(1));
    assert_eq!(receiver.try_recv(), Ok(2));
}

#[test]
fn overwrite_oldest_keeps_the_last_ones() {
    for capacity in [1, 2, 5] {
        let ledger = Ledger::new(12);
        let (sender, receiver) = buffered(Buffer::overwrite_oldest(capacity));
        for n in 0..12 {
            ready(&mut Box::pin(sender.send(ledger.token(n)))).unwrap();
            assert_eq!(receiver.buffered(), capacity.min(n + 1));
            let overwritten: Vec<usize> = (0..(n + 1).saturating_sub(capacity)).collect();
            assert_eq!(
                ledger.dropped(),
                overwritten,
                "what is overwritten is dropped then and there"
            );
        }
        for n in 12 - capacity..12 {
            assert_eq!(receiver.try_recv().unwrap().id, n);
        }
        assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
        ledger.assert_all_dropped_once();
    }
}

#[test]
fn overwrite_newest_keeps_the_first_ones_and_the_last() {
    for capacity in [1, 2, 5] {
        let ledger = Ledger::new(12);
        let (sender, receiver) = buffered(Buffer::overwrite_newest(capacity));
        for n in 0..12 {
            sender.try_send(ledger.token(n)).unwrap();
            assert_eq!(receiver.buffered(), capacity.min(n + 1));
        }
        assert_eq!(ledger.dropped(), (capacity - 1..11).collect::<Vec<usize>>());
        for n in (0..capacity - 1).chain([11]) {
            assert_eq!(receiver.try_recv().unwrap().id, n);
        }
        assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
        ledger.assert_all_dropped_once();
    }
}

#[test]
fn an_overwriting_buffer_hands_to_the_one_that_waits_before_it_buffers() {
    for buffer in [Buffer::overwrite_oldest(1), Buffer::overwrite_newest(1)] {
        let (sender, receiver) = buffered(buffer);
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        for n in 1..=3 {
            sender.try_send(n).unwrap();
        }
        assert_eq!(
            ready(&mut recv),
            Ok(1),
            "what was received is not overwritten"
        );
        assert_eq!(receiver.try_recv(), Ok(3));
    }
}

#[test]
fn values_without_size() {
    let (sender, receiver) = buffered::<()>(Buffer::fifo(2));
    assert_eq!(
        [
            sender.try_send(()).is_ok(),
            sender.try_send(()).is_ok(),
            sender.try_send(()).is_ok()
        ],
        [true, true, false]
    );
    assert_eq!(
        [
            receiver.try_recv().is_ok(),
            receiver.try_recv().is_ok(),
            receiver.try_recv().is_ok()
        ],
        [true, true, false]
    );
}

#[test]
fn big_values_are_held_side_by_side() {
    let (sender, receiver) = buffered(Buffer::fifo(3));
    for n in 0..3_u8 {
        sender.try_send([n; 20_000]).unwrap();
    }
    for n in 0..3_u8 {
        assert!(receiver.try_recv().unwrap().iter().all(|&byte| byte == n));
    }
}

#[test]
fn a_capacity_of_zero_is_refused_and_says_what_to_do() {
    for buffer in [
        Buffer::fifo(0),
        Buffer::overwrite_oldest(0),
        Buffer::overwrite_newest(0),
    ] {
        let error = try_buffered::<u8>(buffer).unwrap_err();
        assert_eq!(error, BufferError::ZeroCapacity);
        assert_eq!(
            error.to_string(),
            "a buffer of capacity 0 was asked for: give it at least 1, or make a rendezvous with `channel()`"
        );
        let panic = std::panic::catch_unwind(|| buffered::<u8>(buffer)).unwrap_err();
        assert_eq!(panic.downcast_ref::<String>(), Some(&error.to_string()));
    }
}

#[test]
#[should_panic(expected = "capacity overflow")]
fn a_capacity_that_no_memory_can_hold_is_not_taken_for_a_small_one() {
    let _ = buffered::<u64>(Buffer::fifo(usize::MAX));
}

#[test]
fn what_is_left_in_a_channel_is_dropped_with_it() {
    for buffer in [
        Buffer::fifo(4),
        Buffer::overwrite_oldest(4),
        Buffer::overwrite_newest(4),
    ] {
        let ledger = Ledger::new(4);
        let (sender, receiver) = buffered(buffer);
        for n in 0..4 {
            sender.try_send(ledger.token(n)).unwrap();
        }
        drop(receiver.try_recv());
        assert_eq!(ledger.dropped(), [0]);
        drop(sender);
        assert_eq!(ledger.dropped(), [0], "what was sent can still be received");
        drop(receiver);
        ledger.assert_all_dropped_once();
    }
}

#[test]
fn many_receivers_may_be_cloned_while_values_are_buffered() {
    let (sender, receiver) = buffered(Buffer::fifo(3));
    for n in 0..3 {
        sender.try_send(n).unwrap();
    }
    let receivers: Vec<_> = (0..50).map(|_| receiver.clone()).collect();
    assert_eq!(
        receivers
            .iter()
            .filter_map(|receiver| receiver.try_recv().ok())
            .collect::<Vec<_>>(),
        [0, 1, 2]
    );
}

#[test]
fn debug_output_names_what_it_is_and_needs_nothing_of_the_value() {
    struct Opaque;
    let (sender, receiver) = channel::<Opaque>();
    assert!(format!("{sender:?} {receiver:?}").starts_with("Sender { channel: 0x"));
    assert!(
        format!("{:?} {:?}", sender.send(Opaque), receiver.recv())
            .contains("Operation { direction: \"receive\", phase: New")
    );
    assert!(format!("{:?}", sender.try_send(Opaque).unwrap_err()).contains("no receiver waits"));
}

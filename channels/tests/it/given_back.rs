//! A value that comes back to an overwriting buffer which has become full: what would have been
//! overwritten goes.

#![cfg(not(loom))]

use luna_channels::{Buffer, buffered};
use std::future::Future;
use std::task::{Context, Waker};

/// What is received in the end, when a receive that was given 0 is dropped after `sent` were sent.
fn received(buffer: Buffer, sent: std::ops::Range<i32>) -> Vec<i32> {
    let (sender, receiver) = buffered(buffer);
    {
        let mut recv = Box::pin(receiver.recv());
        let mut cx = Context::from_waker(Waker::noop());
        assert!(recv.as_mut().poll(&mut cx).is_pending());
        for number in sent {
            assert!(sender.try_send(number).is_ok());
        }
    }
    // The buffer overwrites at its capacity again.
    let before = receiver.buffered();
    assert!(before <= buffer_capacity(buffer));
    std::iter::from_fn(|| receiver.try_recv().ok()).collect()
}

fn buffer_capacity(buffer: Buffer) -> usize {
    [1, 3]
        .into_iter()
        .find(|&n| buffer == Buffer::overwrite_oldest(n) || buffer == Buffer::overwrite_newest(n))
        .unwrap()
}

#[test]
fn the_oldest_is_the_one_that_came_back() {
    assert_eq!(received(Buffer::overwrite_oldest(1), 0..2), [1]);
    assert_eq!(received(Buffer::overwrite_oldest(3), 0..4), [1, 2, 3]);
}

#[test]
fn the_newest_stays() {
    assert_eq!(received(Buffer::overwrite_newest(1), 0..2), [1]);
    assert_eq!(received(Buffer::overwrite_newest(3), 0..4), [0, 1, 3]);
}

#[test]
fn there_is_room_for_it() {
    assert_eq!(received(Buffer::overwrite_oldest(3), 0..3), [0, 1, 2]);
    assert_eq!(received(Buffer::overwrite_newest(3), 0..3), [0, 1, 2]);
}

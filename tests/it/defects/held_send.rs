//! A send that completes notes its completion before it drops a waker. Otherwise a panic of that
//! waker left the value on both sides.

use crate::defects::waker::{panics, panics_in_drop};
use std::future::Future;
use std::task::{Context, Poll, Waker};

#[test]
fn a_value_is_received_once_though_the_senders_waker_panics_in_its_drop() {
    let (sender, receiver) = luna::channel::<Box<u64>>();
    let quiet = &mut Context::from_waker(Waker::noop());
    let mut plain = Box::pin(receiver.recv());
    let mut extended = Box::pin(receiver.recv_extended());
    assert!(plain.as_mut().poll(quiet).is_pending());
    assert!(extended.as_mut().poll(quiet).is_pending());
    let waker = panics_in_drop();
    let mut send = Box::pin(sender.send(Box::new(7)));
    let mut is_sent = false;
    // It may panic or not: a waker that is not needed need not be cloned.
    panics(|| {
        let polled = send.as_mut().poll(&mut Context::from_waker(&waker));
        is_sent = polled.is_ready();
    });
    drop(send);
    match plain.as_mut().poll(quiet) {
        Poll::Ready(Ok(value)) => assert_eq!(*value, 7),
        other => assert!(!is_sent && other.is_pending(), "{other:?}"),
    }
}

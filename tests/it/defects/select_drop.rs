//! An alternative that is dropped drops its waker last. Otherwise a panic of that waker left its
//! nodes in the channels' lists.

use crate::defects::waker::{panics, panics_in_drop};
use luna::prelude::*;
use std::future::Future;
use std::task::Context;

#[test]
fn a_dropped_alternative_is_in_no_list_though_its_wakers_drop_panics() {
    let (sender, receiver) = luna::channel::<[u64; 8]>();
    let mut choice = Box::pin(async {
        alt! {
            _ = receiver.recv() => (),
            _ = sender.send([1; 8]) => (),
        }
    });
    let waker = panics_in_drop();
    let polled = choice.as_mut().poll(&mut Context::from_waker(&waker));
    assert!(polled.is_pending());
    assert!(panics(|| drop(choice)));
    assert!(sender.try_send([7; 8]).is_err(), "nobody receives");
    assert!(receiver.try_recv().is_err(), "nobody sends");
}

//! Waiting for the end of a channel.

#![cfg(not(loom))]

use futures_lite::future::{self, block_on};
use luna_channels::{Buffer, ChannelEnd, buffered, channel};
use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::thread;

#[derive(Default)]
struct Count(AtomicUsize);

impl Wake for Count {
    fn wake(self: Arc<Self>) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

impl Count {
    fn get(&self) -> usize {
        self.0.load(Ordering::SeqCst)
    }
}

#[test]
fn what_ends_a_sender_and_what_a_receiver() {
    let (sender, receiver) = channel::<u32>();
    assert_eq!(block_on(future::poll_once(sender.ended())), None);
    assert_eq!(block_on(future::poll_once(receiver.poisoned())), None);
    drop(receiver);
    assert_eq!(block_on(sender.ended()), ChannelEnd::Closed);

    let (sender, receiver) = channel::<u32>();
    let again = sender.clone();
    drop(sender);
    assert_eq!(block_on(future::poll_once(again.ended())), None);
    again.poison();
    assert_eq!(block_on(again.ended()), ChannelEnd::Poisoned);
    assert_eq!(block_on(receiver.poisoned()), ChannelEnd::Poisoned);
}

#[test]
fn the_end_wakes_all_that_wait_for_it_and_nobody_twice() {
    let (sender, receiver) = channel::<u32>();
    let other = sender.clone();
    let count = Arc::new(Count::default());
    let waker = Waker::from(count.clone());
    let mut cx = Context::from_waker(&waker);
    let (mut one, mut two) = (pin!(sender.ended()), pin!(other.ended()));
    for _ in 0..3 {
        assert!(one.as_mut().poll(&mut cx).is_pending());
        assert!(two.as_mut().poll(&mut cx).is_pending());
    }
    // A communication is no end.
    assert!(receiver.try_recv().is_err());
    assert_eq!(count.get(), 0);
    receiver.poison();
    assert_eq!(count.get(), 2);
    drop(receiver);
    assert_eq!(count.get(), 2);
    let poisoned = Poll::Ready(ChannelEnd::Poisoned);
    assert_eq!(one.as_mut().poll(&mut cx), poisoned);
    assert_eq!(two.as_mut().poll(&mut cx), poisoned);
}

/// A process that waits for poison is not woken by a close, is by the poison after it, and what is
/// buffered is still received in between.
#[test]
fn poison_after_a_close() {
    let (sender, receiver) = buffered::<u32>(Buffer::fifo(2));
    let count = Arc::new(Count::default());
    let waker = Waker::from(count.clone());
    let mut cx = Context::from_waker(&waker);
    let mut end = pin!(receiver.poisoned());
    assert!(end.as_mut().poll(&mut cx).is_pending());
    sender.try_send(1).unwrap();
    drop(sender);
    assert_eq!(count.get(), 0);
    assert!(end.as_mut().poll(&mut cx).is_pending());
    assert_eq!(receiver.try_recv(), Ok(1));
    receiver.poison();
    assert_eq!(count.get(), 1);
    assert!(end.as_mut().poll(&mut cx).is_ready());
}

#[test]
fn a_dropped_wait_leaves_no_trace() {
    let (sender, receiver) = channel::<u32>();
    let count = Arc::new(Count::default());
    let waker = Waker::from(count.clone());
    {
        let mut end = pin!(sender.ended());
        let mut cx = Context::from_waker(&waker);
        assert!(end.as_mut().poll(&mut cx).is_pending());
        assert_eq!(Arc::strong_count(&count), 3);
    }
    assert_eq!(Arc::strong_count(&count), 2, "the waker is gone with it");
    drop(receiver);
    assert_eq!(count.get(), 0);
}

#[test]
fn whichever_polls_last_is_woken() {
    let (sender, receiver) = channel::<u32>();
    let (first, last) = (Arc::new(Count::default()), Arc::new(Count::default()));
    let mut end = pin!(sender.ended());
    for count in [&first, &last] {
        let waker = Waker::from(count.clone());
        let mut cx = Context::from_waker(&waker);
        assert!(end.as_mut().poll(&mut cx).is_pending());
    }
    drop(receiver);
    assert_eq!((first.get(), last.get()), (0, 1));
}

/// Ends and waits for it race: none is missed.
#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn ends_from_other_threads() {
    for round in 0..500 {
        let (sender, receiver) = channel::<u32>();
        let other = sender.clone();
        let threads = [sender, other].map(|sender| thread::spawn(move || block_on(sender.ended())));
        let expected = if round % 2 == 0 {
            receiver.poison();
            ChannelEnd::Poisoned
        } else {
            ChannelEnd::Closed
        };
        drop(receiver);
        for thread in threads {
            assert_eq!(thread.join().unwrap(), expected);
        }
    }
}

//! The user's code panics in the middle of an operation (a waker, a value's drop): nothing is
//! dropped twice, nothing is lost.

#![cfg(not(loom))]

use luna_channels::{Buffer, Receiver, alt, buffered, channel};
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Wake, Waker};

fn poll<F: Future>(future: &mut Pin<Box<F>>, waker: &Waker) -> bool {
    future
        .as_mut()
        .poll(&mut Context::from_waker(waker))
        .is_ready()
}

/// Counts its drops, and panics in them if it is to.
struct Counted {
    drops: Arc<AtomicUsize>,
    panics: bool,
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.drops.fetch_add(1, Ordering::SeqCst);
        if self.panics {
            panic!("the drop of a value");
        }
    }
}

struct PanickingWaker;

impl Wake for PanickingWaker {
    fn wake(self: Arc<Self>) {
        panic!("a waker");
    }
}

#[test]
fn the_partners_waker_panics() {
    let drops = Arc::new(AtomicUsize::new(0));
    let (sender, receiver) = channel();
    let mut recv = Box::pin(receiver.recv());
    assert!(!poll(&mut recv, &Waker::from(Arc::new(PanickingWaker))));
    let mut send = Box::pin(sender.send(Counted {
        drops: drops.clone(),
        panics: false,
    }));
    assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut send, Waker::noop()))).is_err());
    drop(send);
    assert_eq!(drops.load(Ordering::SeqCst), 0, "the receiver has it");
    drop(recv);
    drop((sender, receiver));
    assert_eq!(drops.load(Ordering::SeqCst), 1);
}

#[test]
fn the_overwritten_value_panics_in_its_drop() {
    let drops = Arc::new(AtomicUsize::new(0));
    let value = |panics| Counted {
        drops: drops.clone(),
        panics,
    };
    let (sender, receiver) = buffered(Buffer::overwrite_oldest(1));
    assert!(sender.try_send(value(true)).is_ok());
    let mut send = Box::pin(sender.send(value(false)));
    assert!(catch_unwind(AssertUnwindSafe(|| poll(&mut send, Waker::noop()))).is_err());
    drop(send);
    assert_eq!(drops.load(Ordering::SeqCst), 1);
    assert!(receiver.try_recv().is_ok());
    assert_eq!(drops.load(Ordering::SeqCst), 2);
}

#[test]
fn the_waker_of_the_sender_panics_and_the_value_goes_back() {
    // Received by each of the ways in which a sender that waits is found.
    let ways: [fn(&Receiver<Counted>); 3] = [
        |receiver| drop(receiver.try_recv()),
        |receiver| assert!(poll(&mut Box::pin(receiver.recv()), Waker::noop())),
        |receiver| {
            let alternative = async {
                alt! { value = receiver.recv() => drop(value) }
            };
            assert!(poll(&mut Box::pin(alternative), Waker::noop()));
        },
    ];
    for receive in ways {
        let drops = Arc::new(AtomicUsize::new(0));
        let (sender, receiver) = channel();
        let mut send = Box::pin(sender.send(Counted {
            drops: drops.clone(),
            panics: false,
        }));
        assert!(!poll(&mut send, &Waker::from(Arc::new(PanickingWaker))));
        assert!(catch_unwind(AssertUnwindSafe(|| receive(&receiver))).is_err());
        assert!(poll(&mut send, Waker::noop()), "it was received");
        assert_eq!(drops.load(Ordering::SeqCst), 0);
        assert!(receiver.try_recv().is_ok(), "and came back");
        assert_eq!(drops.load(Ordering::SeqCst), 1);
    }
}

#[test]
fn the_next_receivers_waker_panics_and_the_held_sender_goes_on() {
    let (sender, receiver) = channel();
    let mut first = Box::pin(receiver.recv_extended());
    assert!(!poll(&mut first, Waker::noop()));
    let mut send = Box::pin(sender.send(1));
    assert!(!poll(&mut send, Waker::noop()));
    let mut second = Box::pin(receiver.recv());
    assert!(!poll(&mut second, &Waker::from(Arc::new(PanickingWaker))));
    assert!(catch_unwind(AssertUnwindSafe(|| drop(first))).is_err());
    assert!(poll(&mut send, Waker::noop()));
    assert!(poll(&mut second, Waker::noop()));
}

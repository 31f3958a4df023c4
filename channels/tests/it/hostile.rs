//! Others' code at its worst: wakers that panic when woken, cloned or dropped, closures that panic,
//! futures that are forgotten.

#![cfg(not(loom))]

use luna_channels::{
    Alternative, Barrier, Buffer, CallError, RecvError, Server, SyncOp, buffered, call_channel,
    channel,
};
use luna_core::block_on;
use std::cell::RefCell;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::task::{Context, Poll, RawWaker, RawWakerVTable, Wake, Waker};

fn poll<F: Future + ?Sized>(future: &mut Pin<Box<F>>, waker: &Waker) -> Poll<F::Output> {
    future.as_mut().poll(&mut Context::from_waker(waker))
}

fn panics(f: impl FnOnce()) -> bool {
    catch_unwind(AssertUnwindSafe(f)).is_err()
}

/// Panics when woken for the first time.
struct Explosive(AtomicBool);
impl Wake for Explosive {
    fn wake(self: Arc<Self>) {
        assert!(!self.0.swap(false, Ordering::SeqCst), "a waker that panics");
    }
}

fn explosive() -> Waker {
    Waker::from(Arc::new(Explosive(AtomicBool::new(true))))
}

#[derive(Default)]
struct Count(AtomicUsize);
impl Wake for Count {
    fn wake(self: Arc<Self>) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }
}

/// Wakers of a thread. Their clones panic while this says so.
mod clones {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        pub(super) static PANIC: Cell<bool> = const { Cell::new(false) };
    }

    static TABLE: RawWakerVTable = RawWakerVTable::new(
        |data| {
            assert!(!PANIC.get(), "a waker whose clone panics");
            RawWaker::new(data, &TABLE)
        },
        |_| (),
        |_| (),
        |_| (),
    );

    pub(super) fn waker() -> Waker {
        // SAFETY: the functions use no data.
        unsafe { Waker::from_raw(RawWaker::new(std::ptr::null(), &TABLE)) }
    }
}

#[test]
fn a_closure_that_panics_poisons_a_registered_alternative() {
    let (sender, receiver) = channel::<String>();
    let receivers = [receiver];
    let mut inputs = Alternative::fair(&receivers);
    let mut recv = Box::pin(inputs.recv());
    assert!(poll(&mut recv, Waker::noop()).is_pending());
    let mut send = Box::pin(sender.send_with(|| panic!("no value")));
    assert!(panics(|| {
        let _ = poll(&mut send, Waker::noop());
    }));
    assert_eq!(
        poll(&mut recv, Waker::noop()),
        Poll::Ready((0, Err(RecvError::Poisoned)))
    );
}

#[test]
fn a_value_stays_in_its_channel_when_the_partners_waker_panics() {
    let (sender, receiver) = channel::<u32>();
    let receivers = [receiver];
    let mut send = Box::pin(sender.send(7));
    assert!(poll(&mut send, &explosive()).is_pending());
    let mut inputs = Alternative::fair(&receivers);
    assert!(panics(|| {
        let _ = poll(&mut Box::pin(inputs.recv()), Waker::noop());
    }));
    drop(inputs);
    assert!(poll(&mut send, Waker::noop()).is_ready(), "it was sent");
    assert_eq!(receivers[0].try_recv(), Ok(7));
}

#[test]
fn one_waker_that_panics_keeps_no_other_party_waiting() {
    let barrier = Barrier::new(3);
    let count = Arc::new(Count::default());
    let (mut first, mut second) = (Box::pin(barrier.sync()), Box::pin(barrier.sync()));
    assert!(poll(&mut first, &explosive()).is_pending());
    assert!(poll(&mut second, &Waker::from(count.clone())).is_pending());
    assert!(panics(|| {
        let _ = poll(&mut Box::pin(barrier.sync()), Waker::noop());
    }));
    assert_eq!(count.0.load(Ordering::SeqCst), 1);
}

#[test]
fn one_waker_that_panics_keeps_nobody_from_learning_of_the_end() {
    let (sender, receiver) = channel::<u32>();
    let count = Arc::new(Count::default());
    let (mut first, mut second) = (Box::pin(receiver.recv()), Box::pin(receiver.recv()));
    assert!(poll(&mut first, &explosive()).is_pending());
    assert!(poll(&mut second, &Waker::from(count.clone())).is_pending());
    assert!(panics(|| sender.poison()));
    assert_eq!(count.0.load(Ordering::SeqCst), 1);
}

#[test]
fn a_clone_that_panics_leaves_a_barrier_as_it_was() {
    let barrier = Barrier::new(2);
    let waker = clones::waker();
    clones::PANIC.set(true);
    let mut sync = Box::pin(barrier.sync());
    assert!(panics(|| {
        let _ = poll(&mut sync, &waker);
    }));
    clones::PANIC.set(false);
    drop(sync);
    assert!(poll(&mut Box::pin(barrier.sync()), &waker).is_pending());
}

#[test]
fn a_clone_that_panics_leaves_those_that_watch_an_end() {
    let (sender, receiver) = channel::<u32>();
    let count = Arc::new(Count::default());
    let mut ended = Box::pin(sender.ended());
    assert!(poll(&mut ended, &Waker::from(count.clone())).is_pending());
    let waker = clones::waker();
    let mut other = Box::pin(sender.ended());
    clones::PANIC.set(true);
    assert!(panics(|| {
        let _ = poll(&mut other, &waker);
    }));
    clones::PANIC.set(false);
    drop(other);
    drop(receiver);
    assert_eq!(count.0.load(Ordering::SeqCst), 1);
}

#[test]
fn a_receive_that_is_forgotten_hides_no_channel_that_is_added() {
    let (_sender, receiver) = channel::<u32>();
    let (filled, full) = buffered::<u32>(Buffer::fifo(1));
    filled.try_send(5).unwrap();
    let receivers = [receiver];
    let mut inputs = Alternative::fair(&receivers);
    let mut forgotten = inputs.recv();
    let polled = Pin::new(&mut forgotten).poll(&mut Context::from_waker(Waker::noop()));
    assert!(polled.is_pending());
    std::mem::forget(forgotten);
    let index = inputs.add(&full);
    let received = poll(&mut Box::pin(inputs.recv()), Waker::noop());
    assert_eq!(received, Poll::Ready((index, Ok(5))));
}

thread_local! {
    static LAST_MEMBER: RefCell<Option<Pin<Box<dyn Future<Output = ()>>>>> = const { RefCell::new(None) };
}

/// When dropped, lets the last member of a group come.
struct Reentrant(Arc<AtomicUsize>);
impl Wake for Reentrant {
    fn wake(self: Arc<Self>) {
        assert_eq!(self.0.load(Ordering::SeqCst), 0, "woken after its drop");
    }
}
impl Drop for Reentrant {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::SeqCst);
        if let Some(mut last) = LAST_MEMBER.with_borrow_mut(Option::take) {
            let _ = poll(&mut last, Waker::noop());
        }
    }
}

#[test]
fn a_wakers_drop_may_complete_the_group() {
    block_on(async {
        let barrier: &'static Barrier = Box::leak(Box::new(Barrier::new(1)));
        let group: &'static Barrier = Box::leak(Box::new(barrier.local(2)));
        let mut first = Box::pin(group.sync());
        LAST_MEMBER.set(Some(Box::pin(group.sync())));
        let drops = Arc::new(AtomicUsize::new(0));
        let waker = Waker::from(Arc::new(Reentrant(drops.clone())));
        assert!(poll(&mut first, &waker).is_pending());
        drop(waker);
        // The former waker goes, and with it comes the last member, which wakes this one.
        let count = Arc::new(Count::default());
        let _ = poll(&mut first, &Waker::from(count.clone()));
        assert_eq!(drops.load(Ordering::SeqCst), 1);
        assert_eq!(count.0.load(Ordering::SeqCst), 1);
        assert!(poll(&mut first, Waker::noop()).is_ready());
    })
    .unwrap();
}

thread_local! {
    /// A group, and the member that a waker is to drop.
    static MEMBER: RefCell<Option<(&'static Barrier, Member)>> = const { RefCell::new(None) };
}

type Member = Pin<Box<SyncOp<'static>>>;

/// When woken, drops a member of the group, and lets one come for the next round.
struct Replacing;
impl Wake for Replacing {
    fn wake(self: Arc<Self>) {
        let Some((group, dropped)) = MEMBER.with_borrow_mut(Option::take) else {
            return;
        };
        drop(dropped);
        let mut next = Box::pin(group.sync());
        assert!(poll(&mut next, Waker::noop()).is_pending());
        MEMBER.set(Some((group, next)));
    }
}

#[test]
fn a_member_that_is_dropped_in_the_barriers_wake_releases_no_second_round() {
    block_on(async {
        let barrier = Barrier::new(2);
        let group: &'static Barrier = Box::leak(Box::new(barrier.local(2)));
        let mut outsider = Box::pin(barrier.sync());
        assert!(poll(&mut outsider, &Waker::from(Arc::new(Replacing))).is_pending());
        let mut one = Box::pin(group.sync());
        assert!(poll(&mut one, Waker::noop()).is_pending());
        MEMBER.set(Some((group, one)));
        let mut two = Box::pin(group.sync());
        assert!(poll(&mut two, Waker::noop()).is_ready());
        assert!(poll(&mut outsider, Waker::noop()).is_ready());
        let (_, mut next) = MEMBER.take().expect("the waker ran");
        assert!(
            poll(&mut next, Waker::noop()).is_pending(),
            "it passed the next round alone"
        );
        // It passes with the others.
        let mut outsider = Box::pin(barrier.sync());
        assert!(poll(&mut outsider, Waker::noop()).is_pending());
        assert!(poll(&mut Box::pin(group.sync()), Waker::noop()).is_ready());
        assert!(poll(&mut next, Waker::noop()).is_ready());
        assert!(poll(&mut outsider, Waker::noop()).is_ready());
    })
    .unwrap();
}

thread_local! {
    /// The accept that a waker is to drop.
    static ACCEPT: RefCell<Option<Pin<Box<dyn Future<Output = ()>>>>> = const { RefCell::new(None) };
}

/// When woken, drops the accept.
struct DropsAccept;
impl Wake for DropsAccept {
    fn wake(self: Arc<Self>) {
        drop(ACCEPT.take());
    }
}

#[test]
fn an_accept_that_is_dropped_while_its_channel_is_poisoned_gives_no_call_back() {
    let (client, server) = call_channel::<u32, ()>();
    let server: &'static Server<u32, ()> = Box::leak(Box::new(server));
    // The first call is accepted: its client is held, and the accept is not polled again.
    let mut accept: Pin<Box<dyn Future<Output = ()>>> = Box::pin(async {
        drop(server.accept().await);
    });
    assert!(poll(&mut accept, Waker::noop()).is_pending());
    let mut accepted = Box::pin(client.call(1));
    assert!(poll(&mut accepted, Waker::noop()).is_pending());
    ACCEPT.set(Some(accept));
    // The second call waits. Its waker is called in the middle of the poisoning.
    let mut waits = Box::pin(client.call(2));
    assert!(poll(&mut waits, &Waker::from(Arc::new(DropsAccept))).is_pending());
    server.poison();
    assert!(ACCEPT.take().is_none(), "the waker was called");
    assert_eq!(
        poll(&mut accepted, Waker::noop()),
        Poll::Ready(Err(CallError::Interrupted))
    );
    assert_eq!(
        poll(&mut waits, Waker::noop()),
        Poll::Ready(Err(CallError::Poisoned(2)))
    );
}

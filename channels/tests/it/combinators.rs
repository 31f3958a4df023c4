//! Operations inside combinators of other crates, and of our own with wakers of their own: the
//! waker that polled is the one that is woken, also within a process of LUNA, which would else be
//! woken without it.

#![cfg(not(loom))]

use crate::common;
use common::Watchdog;
use futures_lite::future::{or, yield_now, zip};
use luna_channels::channel;
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Wake, Waker};

/// Polls each child with a waker of its own, and only when that was woken: as `FuturesUnordered`
/// and `join_all` of many do.
struct Fan<'a, T> {
    children: Vec<Option<Child<'a, T>>>,
    polls: Arc<AtomicUsize>,
}

struct Child<'a, T> {
    future: Pin<Box<dyn Future<Output = T> + 'a>>,
    woken: Arc<Woken>,
    waker: Waker,
}

/// Remembers that its child was woken, and wakes the poller of the whole.
struct Woken {
    woken: AtomicBool,
    parent: Mutex<Option<Waker>>,
}

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.woken.store(true, Ordering::SeqCst);
        if let Some(parent) = self.parent.lock().unwrap().take() {
            parent.wake();
        }
    }
}

impl<'a, T> Fan<'a, T> {
    fn new(polls: &Arc<AtomicUsize>) -> Self {
        Self {
            children: Vec::new(),
            polls: polls.clone(),
        }
    }

    fn add(mut self, future: impl Future<Output = T> + 'a) -> Self {
        let woken = Arc::new(Woken {
            woken: AtomicBool::new(true),
            parent: Mutex::new(None),
        });
        self.children.push(Some(Child {
            future: Box::pin(future),
            waker: woken.clone().into(),
            woken,
        }));
        self
    }
}

impl<T> Future for Fan<'_, T> {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.get_mut();
        for slot in &mut this.children {
            let Some(child) = slot else { continue };
            *child.woken.parent.lock().unwrap() = Some(cx.waker().clone());
            if child.woken.woken.swap(false, Ordering::SeqCst) {
                this.polls.fetch_add(1, Ordering::SeqCst);
                if child
                    .future
                    .as_mut()
                    .poll(&mut Context::from_waker(&child.waker))
                    .is_ready()
                {
                    *slot = None;
                }
            }
        }
        if this.children.iter().all(Option::is_none) {
            Poll::Ready(())
        } else {
            Poll::Pending
        }
    }
}

/// Runs the same body as a process of an executor, on a thread of its own, and outside of LUNA.
fn everywhere<F: Future<Output = ()> + 'static>(body: impl Fn() -> F + Send + Clone + 'static) {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("combinators")).unwrap();
    let process = executor.spawn(ProcessSpec::new("body"), body.clone());
    executor.release();
    assert_eq!(process.wait(), Exit::Completed);
    luna_core::block_on(body()).unwrap();
    futures_lite::future::block_on(body());
}

#[test]
fn each_child_is_woken_by_its_own_waker_and_no_other() {
    everywhere(|| async {
        let (sender, receiver) = channel();
        let sum = Mutex::new(0);
        let polls = Arc::new(AtomicUsize::new(0));
        let mut fan = Fan::new(&polls);
        for _ in 0..5 {
            fan = fan.add(async {
                let value: usize = receiver.recv().await.unwrap();
                *sum.lock().unwrap() += value;
            });
        }
        let feed = async {
            for n in 1..=5 {
                let before = polls.load(Ordering::SeqCst);
                sender.send(n).await.unwrap();
                while polls.load(Ordering::SeqCst) == before {
                    yield_now().await; // until the one child that has it was polled
                }
            }
        };
        zip(fan, feed).await;
        assert_eq!(*sum.lock().unwrap(), 15);
        assert_eq!(
            polls.load(Ordering::SeqCst),
            5 + 5,
            "each was polled at first, and once for its value"
        );
    });
}

#[test]
fn partners_within_one_combinator_find_each_other() {
    everywhere(|| async {
        let (sender, receiver) = channel();
        let polls = Arc::new(AtomicUsize::new(0));
        let (sender, receiver) = (&sender, &receiver);
        let mut fan = Fan::new(&polls);
        for n in 0..10 {
            fan = fan.add(async move { sender.send(n).await.unwrap() });
            fan = fan.add(async move { assert!(receiver.recv().await.unwrap() < 10) });
        }
        fan.await;
    });
}

#[test]
fn a_process_that_gives_way_inside_a_combinator_is_polled_again() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("combinators")).unwrap();
    let (sender, receiver) = channel::<usize>();
    let order = Arc::new(Mutex::new(Vec::new()));
    let (of_high, of_low) = (order.clone(), order.clone());
    let high = executor.spawn(ProcessSpec::new("high").level(20), move || async move {
        while let Ok(n) = receiver.recv().await {
            of_high.lock().unwrap().push(format!("received {n}"));
        }
    });
    let low = executor.spawn(ProcessSpec::new("low").level(5), move || async move {
        let polls = Arc::new(AtomicUsize::new(0));
        let (sender, order) = (&sender, &of_low);
        let send = |n| async move {
            sender.send(n).await.unwrap();
            order.lock().unwrap().push(format!("sent {n}"));
        };
        Fan::new(&polls).add(send(1)).await;
        or(send(2), std::future::pending()).await;
        zip(send(3), send(4)).await;
    });
    executor.release();
    assert_eq!(
        (low.wait(), high.wait()),
        (Exit::Completed, Exit::Completed)
    );
    let order = order.lock().unwrap();
    // 3 and 4 are branches of one poll: the second one has no receiver until the process returns
    // from it.
    assert_eq!(order[..4], ["received 1", "sent 1", "received 2", "sent 2"]);
    assert_eq!(order[4], "received 3");
    assert_eq!(order.len(), 8);
}

#[test]
fn a_loser_of_a_race_is_withdrawn() {
    everywhere(|| async {
        let ((left, from_left), (right, from_right)) = (channel(), channel());
        for n in 0..20 {
            let receive = or(async { from_left.recv().await.unwrap() }, async {
                from_right.recv().await.unwrap()
            });
            let side = if n % 2 == 0 { &left } else { &right };
            assert_eq!(zip(receive, side.send(n)).await, (n, Ok(())));
            assert!(left.try_send(99).unwrap_err().is_full());
            assert!(right.try_send(99).unwrap_err().is_full());
        }
    });
}

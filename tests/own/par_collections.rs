//! `par_all` and `par_for`: any number of branches, of which only those are polled that were woken.

use crate::ALLOCATOR;
use crate::common;

use common::{PLACEMENTS, SpawnOk};
use futures_lite::future;
use luna::prelude::*;
use luna::{Error, Result, par_all, par_for};
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Wake, Waker};
use std::time::Duration;

type Boxed<'a, T> = Pin<Box<dyn Future<Output = Result<T>> + 'a>>;

#[test]
fn values_come_in_order_whichever_ends_first() {
    own_process!();
    for count in [0, 1, 2, 63, 64, 65, 128, 200, 4096, 4097, 9000] {
        let ended = Cell::new(0);
        let values = luna::run(async {
            par_for(0..count, async |n: usize| {
                for _ in 0..(count - n) % 5 {
                    luna::yield_now().await;
                }
                ended.set(ended.get() + 1);
                Ok(n)
            })
            .await
        });
        assert_eq!(values, Ok((0..count).collect::<Vec<_>>()));
        assert_eq!(ended.get(), count);
    }
}

#[test]
fn branches_begin_in_order_and_may_borrow() {
    own_process!();
    let names: Vec<String> = (0..300).map(|n| n.to_string()).collect();
    let begun = RefCell::new(Vec::new());
    luna::run(async {
        par_for(&names, async |name| {
            begun.borrow_mut().push(name.as_str());
            Ok(())
        })
        .await
    })
    .unwrap();
    assert_eq!(*begun.borrow(), names);
}

/// Counts the polls of what it wraps.
struct Counted<'a, F>(F, &'a Cell<usize>);

impl<F: Future + Unpin> Future for Counted<'_, F> {
    type Output = F::Output;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        self.1.set(self.1.get() + 1);
        Pin::new(&mut self.0).poll(cx)
    }
}

#[test]
fn ten_thousand_pass_a_token_and_only_the_woken_are_polled() {
    own_process!();
    const STAGES: usize = 10_000;
    const ROUNDS: usize = 3;
    for place in PLACEMENTS {
        let body = move || async move {
            let ends: Vec<_> = (0..STAGES).map(|_| luna::channel::<usize>()).collect();
            let polls = Cell::new(0);
            let stages = (0..STAGES).map(|stage| -> Counted<'_, Boxed<'_, usize>> {
                let from = &ends[stage].1;
                let to = &ends[(stage + 1) % STAGES].0;
                let body = Box::pin(async move {
                    if stage == 0 {
                        to.send(1).await?;
                    }
                    let mut last = 0;
                    for round in 1..=ROUNDS {
                        last = from.recv().await?;
                        if stage > 0 || round < ROUNDS {
                            to.send(last + 1).await?;
                        }
                    }
                    Ok(last)
                });
                Counted(body, &polls)
            });
            let branches = par_all(stages);
            let before = ALLOCATOR.here();
            let mut branches = branches;
            let last = future::poll_fn(|cx| Pin::new(&mut branches).poll(cx)).await?;
            // The branches, each in a box of its own here, are freed as they end.
            let after = ALLOCATOR.here();
            assert_eq!(after.0, before.0, "allocations");
            assert_eq!(after.1, before.1 + STAGES as u64, "frees");
            assert_eq!(last[0], STAGES * ROUNDS);
            assert_eq!(last[STAGES - 1], STAGES * ROUNDS - 1);
            // Each branch begins once and is woken for each token. Yields, after many operations in
            // one turn, cost a few more polls.
            let least = STAGES * (ROUNDS + 1);
            assert!(
                (least..least + least / 4).contains(&polls.get()),
                "{polls:?}"
            );
            Ok(())
        };
        let mut system = System::new("ring");
        let ring = place.process(&mut system, "place", "ring");
        ring.spawn_ok(body);
        system.run().unwrap();
    }
}

#[test]
fn one_failure_ends_all_and_is_the_error_and_several_are_told_in_order() {
    own_process!();
    let (_open, never) = luna::channel::<()>();
    let fails_at = [3, 70, 199];
    let branch = async |n: usize| {
        if fails_at.contains(&n) {
            // The last one first.
            for _ in 0..200 - n {
                luna::yield_now().await;
            }
            return Err(Error::other(n.to_string()));
        }
        // Ends by its siblings' failure alone; every second one says so.
        let outcome = never.recv().await;
        assert!(outcome.unwrap_err().is_poisoned());
        if n.is_multiple_of(2) {
            Err(Error::Poisoned)
        } else {
            Ok(())
        }
    };
    let error = luna::run(async { par_for(0..200, branch).await }).unwrap_err();
    let expected: Vec<_> = (0..200)
        .filter(|n| n % 2 == 0 || fails_at.contains(n))
        .map(|n| {
            if fails_at.contains(&n) {
                n.to_string()
            } else {
                Error::Poisoned.to_string()
            }
        })
        .collect();
    assert!(error.errors().map(Error::to_string).eq(expected));

    let alone = async |n| {
        if n == 5 {
            return Err(Error::Full);
        }
        let _ = never.recv().await;
        Ok(())
    };
    let error = luna::run(async { par_for(0..100, alone).await });
    assert_eq!(error, Err(Error::Full));
}

#[test]
fn a_failure_outside_reaches_all_within_and_none_the_other_way() {
    own_process!();
    let (_open, never) = luna::channel::<()>();
    let error = luna::run(async {
        let within = par_for(0..100, async |_| {
            // Two deep.
            par_all([never.recv(), never.recv()].map(|wait| async { Ok(wait.await?) })).await
        });
        par!(within, async {
            luna::yield_now().await;
            Err::<(), _>(Error::Timeout)
        })
        .await
    })
    .unwrap_err();
    assert_eq!(error.errors().count(), 201);
    assert_eq!(
        error.errors().filter(|error| error.is_poisoned()).count(),
        200
    );

    let (sender, receiver) = luna::channel();
    let outcome = luna::run(async {
        par!(
            async {
                Ok::<_, Error>(
                    par_for(0..3, async |_| Err::<(), _>(Error::Full))
                        .await
                        .is_err(),
                )
            },
            sender.send(1),
            receiver.recv()
        )
        .await
    });
    assert_eq!(outcome, Ok((true, (), 1)));
}

#[test]
fn wakes_from_other_threads_are_not_lost() {
    own_process!();
    const STAGES: usize = 150;
    const MESSAGES: usize = 100;
    for place in PLACEMENTS {
        let mut system = System::new("threads");
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        for _ in 0..STAGES {
            let (sender, receiver) = luna::channel::<usize>();
            inputs.push(sender);
            outputs.push(receiver);
        }
        let receiving = place.process(&mut system, "receiving", "receiving");
        receiving.spawn_ok(async move {
            let sums = par_for(&outputs, async |receiver| {
                let mut sum = 0;
                for _ in 0..MESSAGES {
                    sum += receiver.recv().await?;
                }
                Ok(sum)
            });
            assert_eq!(sums.await?, [MESSAGES * (MESSAGES - 1) / 2; STAGES]);
            Ok(())
        });
        // From two threads at once.
        let odd = inputs.split_off(STAGES / 2);
        for (name, inputs) in [("one", inputs), ("two", odd)] {
            system.thread(name).process(name).spawn_ok(async move {
                for message in 0..MESSAGES {
                    for sender in &inputs {
                        sender.send(message).await?;
                    }
                }
                Ok(())
            });
        }
        system.run().unwrap();
    }
}

#[test]
fn it_lets_others_run() {
    own_process!();
    let mut system = System::new("fair");
    let executor = system.executor("one").build().unwrap();
    let stop = Arc::new(std::sync::atomic::AtomicBool::new(false));
    let stopped = stop.clone();
    let busy = move || async move {
        par_for(0..3, async |_| {
            while !stopped.load(std::sync::atomic::Ordering::SeqCst) {
                luna::yield_now().await;
            }
            Ok(())
        })
        .await?;
        Ok(())
    };
    executor.process("busy").spawn_ok(busy);
    // Of the same level: its turn comes only if the other one gives way.
    let stops = async move {
        luna::yield_now().await;
        stop.store(true, std::sync::atomic::Ordering::SeqCst);
        Ok(())
    };
    executor.process("stops").spawn_ok(stops);
    system.run().unwrap();
}

#[test]
fn a_busy_branch_does_not_starve_those_behind_it() {
    own_process!();
    let turns = Cell::new(0usize);
    let values = luna::run(async {
        let last_is_done = Cell::new(false);
        par_for(0..500, async |n| {
            if n == 499 {
                for _ in 0..10 {
                    luna::yield_now().await;
                }
                last_is_done.set(true);
            } else {
                while !last_is_done.get() {
                    turns.set(turns.get() + 1);
                    luna::yield_now().await;
                }
            }
            Ok(())
        })
        .await
    });
    assert!(values.is_ok());
    // The others had about as many turns each.
    assert!(turns.get() < 500 * 13, "{turns:?}");
}

#[test]
fn dropping_it_drops_all_branches_and_late_wakes_find_nobody() {
    own_process!();
    let alive = Arc::new(());
    let wakers = RefCell::new(Vec::new());
    let wait = async |n: usize| {
        let _alive = alive.clone();
        future::poll_fn(|cx| {
            wakers.borrow_mut().push(cx.waker().clone());
            if n.is_multiple_of(2) {
                Poll::Ready(())
            } else {
                Poll::Pending
            }
        })
        .await;
        Ok(())
    };
    luna::run(async {
        let mut branches = par_for(0..100, wait);
        let polled = future::poll_once(&mut branches).await;
        assert!(polled.is_none());
        // Those of branches that have ended among them.
        wakers.borrow().iter().for_each(Waker::wake_by_ref);
        assert!(future::poll_once(&mut branches).await.is_none());
        assert!(Arc::strong_count(&alive) > 1);
        drop(branches);
        assert_eq!(Arc::strong_count(&alive), 1);
        Ok(())
    })
    .unwrap();
    let elsewhere = wakers.take();
    assert!(elsewhere[0].will_wake(&elsewhere[0].clone()));
    assert!(!elsewhere[0].will_wake(&elsewhere[1]));
    std::thread::spawn(move || elsewhere.into_iter().for_each(Waker::wake))
        .join()
        .unwrap();
}

#[test]
fn any_executor_and_its_waker_changes() {
    own_process!();
    struct Counts(std::sync::atomic::AtomicUsize);
    impl Wake for Counts {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, std::sync::atomic::Ordering::SeqCst);
        }
    }
    let counts = [0; 2].map(|_| Arc::new(Counts(0.into())));
    let woken = |n: usize| counts[n].0.swap(0, std::sync::atomic::Ordering::SeqCst);
    let (sender, receiver) = luna::channel::<u8>();
    let mut branches = par_for(0..2, async |_| Ok(receiver.recv().await?));
    for n in [0, 1] {
        let waker = Waker::from(counts[n].clone());
        let polled = Pin::new(&mut branches).poll(&mut Context::from_waker(&waker));
        assert!(polled.is_pending());
    }
    sender.try_send(1).unwrap();
    assert_eq!((woken(0), woken(1)), (0, 1), "the last one that polled");
    // A foreign waker is not cloned under a lock, so the first wake takes it. The next poll brings
    // one.
    sender.try_send(2).unwrap();
    assert_eq!((woken(0), woken(1)), (0, 0));
    assert_eq!(future::block_on(branches), Ok(vec![1, 2]));
}

#[test]
#[should_panic(expected = "after it had ended")]
fn polling_it_after_its_end_panics() {
    let mut branches = par_all([std::future::ready(Ok(()))]);
    let _ = future::block_on(&mut branches);
    let _ = future::block_on(&mut branches);
}

#[test]
fn it_can_be_sent_if_its_branches_can() {
    own_process!();
    fn sends<T: Send>(_: &T) {}
    sends(&par_all([std::future::ready(Ok(1))]));
}

#[test]
fn timers_wake_their_branch() {
    own_process!();
    let order = RefCell::new(Vec::new());
    luna::run(async {
        let start = luna::now();
        par_for([30, 10, 20], async |millis| {
            luna::at(start + Duration::from_millis(millis)).await;
            order.borrow_mut().push(millis);
            Ok(())
        })
        .await
    })
    .unwrap();
    let mut sorted = order.borrow().clone();
    sorted.sort_unstable();
    assert_eq!(sorted, [10, 20, 30]);
}

#[test]
fn an_ordinary_end_of_thousands_allocates_nothing() {
    own_process!();
    luna::run(async {
        let (sender, receiver) = luna::channel::<u8>();
        // Neighbours differ, so the error is as long as it can be.
        let branches = par_for(0..5000, async |n| match n % 3 {
            0 => Ok(receiver.recv().await?),
            1 => Err(Error::Closed),
            _ => Err(Error::Timeout),
        });
        sender.poison();
        let before = ALLOCATOR.here();
        let mut branches = branches;
        let error = future::poll_fn(|cx| Pin::new(&mut branches).poll(cx))
            .await
            .unwrap_err();
        assert_eq!(ALLOCATOR.here().0, before.0);
        assert_eq!(error.errors().count(), 5000);
        Ok(())
    })
    .unwrap();
}

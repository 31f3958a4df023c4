//! Alternatives in combinators that change wakers, and under other executors than LUNA's.

#![cfg(not(loom))]

use crate::common;
use common::{Random, Wakes, Watchdog, poll_with};
use futures_lite::future::{block_on, or, yield_now, zip};
use luna_channels::{Receiver, Sender, alt, channel, pri_alt};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::task::{Context, Poll};
use std::thread;

/// Receives all from both, until both are closed.
async fn merge(one: Receiver<u64>, two: Receiver<u64>) -> u64 {
    let (mut open, mut sum) = ([true; 2], 0);
    while open.contains(&true) {
        alt! {
            value = one.recv(), if open[0] => match value {
                Ok(value) => sum += value,
                Err(_) => open[0] = false,
            },
            value = two.recv(), if open[1] => match value {
                Ok(value) => sum += value,
                Err(_) => open[1] = false,
            },
        }
    }
    sum
}

/// Offers each number to both; either may take it.
async fn split(one: Sender<u64>, two: Sender<u64>, count: u64) {
    for n in 1..=count {
        alt! {
            sent = one.send(n) => sent.unwrap(),
            sent = two.send_with(move || n) => sent.unwrap(),
        }
    }
}

const COUNT: u64 = 300;
const SUM: u64 = COUNT * (COUNT + 1) / 2;

/// The two against each other, through rendezvous, within one future.
async fn network() -> u64 {
    let ((to_one, one), (to_two, two)) = (channel(), channel());
    zip(split(to_one, to_two, COUNT), merge(one, two)).await.1
}

#[test]
fn under_every_executor() {
    let _watchdog = Watchdog::new();
    assert_eq!(block_on(network()), SUM);
    assert_eq!(luna_core::block_on(network()).unwrap(), SUM);
    for mut builder in [
        tokio::runtime::Builder::new_current_thread(),
        tokio::runtime::Builder::new_multi_thread(),
    ] {
        let runtime = builder.worker_threads(2).build().unwrap();
        assert_eq!(runtime.block_on(network()), SUM);
        // As tasks, which may move from thread to thread.
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        runtime.spawn(split(to_one, to_two, COUNT));
        let merged = runtime.spawn(merge(one, two));
        assert_eq!(runtime.block_on(merged).unwrap(), SUM);
    }
    let smol = async_executor::LocalExecutor::new();
    let ((to_one, one), (to_two, two)) = (channel(), channel());
    smol.spawn(split(to_one, to_two, COUNT)).detach();
    assert_eq!(block_on(smol.run(merge(one, two))), SUM);
}

#[test]
fn across_all_of_them() {
    let _watchdog = Watchdog::new();
    let ((to_one, one), (to_two, two)) = (channel(), channel());
    let (sums, from_all) = channel();
    let merge_into = move |sums: Sender<u64>, one, two| async move {
        sums.send(merge(one, two).await).await.unwrap();
    };
    let executor = Executor::start(Attributes::new("anywhere")).unwrap();
    executor.release();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .build()
        .unwrap();
    // Three processes that receive from both, and three that offer to both: each alternative
    // against any other.
    let mut ends = (0..3).map(|_| (sums.clone(), one.clone(), two.clone()));
    let mut next = || ends.next().unwrap();
    let (s, a, b) = next();
    executor.spawn(ProcessSpec::new("merge"), move || merge_into(s, a, b));
    let (s, a, b) = next();
    runtime.spawn(merge_into(s, a, b));
    let (s, a, b) = next();
    let plain = thread::spawn(move || block_on(merge_into(s, a, b)));
    let (s, t) = (to_one.clone(), to_two.clone());
    executor.spawn(ProcessSpec::new("split"), move || split(s, t, COUNT));
    runtime.spawn(split(to_one.clone(), to_two.clone(), COUNT));
    let smol = thread::spawn(move || {
        let executor = async_executor::LocalExecutor::new();
        block_on(executor.run(split(to_one, to_two, COUNT)));
    });
    drop((one, two, sums));
    let total: u64 = std::iter::from_fn(|| from_all.blocking_recv().ok()).sum();
    assert_eq!(total, 3 * SUM);
    plain.join().unwrap();
    smol.join().unwrap();
}

/// Waits for either of two.
async fn either(one: &Receiver<u64>, two: &Receiver<u64>) -> u64 {
    pri_alt! {
        value = one.recv() => value.unwrap(),
        value = two.recv() => value.unwrap(),
    }
}

#[test]
fn one_that_polled_last_is_woken_and_nobody_else() {
    let ((_one, from_one), (two, from_two)) = (channel(), channel());
    let mut alternative = Box::pin(either(&from_one, &from_two));
    let wakers = [Wakes::new(), Wakes::new(), Wakes::new()];
    for n in [0, 1, 1, 0, 2] {
        assert!(poll_with(&mut alternative, &wakers[n].1).is_pending());
    }
    two.try_send(5).unwrap();
    assert_eq!([0, 1, 2].map(|n| wakers[n].0.count()), [0, 0, 1]);
    // Polled by yet another one after it was chosen.
    assert_eq!(poll_with(&mut alternative, &wakers[0].1), Poll::Ready(5));
}

#[test]
fn a_waker_that_was_replaced_is_dropped_outside_of_the_locks() {
    /// Uses the channel when it is dropped, as the last waker of a task may that holds its ends.
    struct UsesOnDrop(Sender<u64>);
    impl std::task::Wake for UsesOnDrop {
        fn wake(self: std::sync::Arc<Self>) {}
    }
    impl Drop for UsesOnDrop {
        fn drop(&mut self) {
            assert!(self.0.try_send(1).is_ok(), "the alternative waits there");
        }
    }
    let _watchdog = Watchdog::new();
    let ((_one, from_one), (two, from_two)) = (channel(), channel());
    let mut alternative = Box::pin(either(&from_one, &from_two));
    let waker = std::sync::Arc::new(UsesOnDrop(two)).into();
    assert!(poll_with(&mut alternative, &waker).is_pending());
    drop(waker);
    let (wakes, waker) = Wakes::new();
    // It is replaced, dropped, and sends: which is seen at once.
    assert_eq!(poll_with(&mut alternative, &waker), Poll::Ready(1));
    assert_eq!(wakes.count(), 1);
}

#[test]
fn a_loser_of_a_race_is_withdrawn_within_processes_and_without() {
    let _watchdog = Watchdog::new();
    let body = || async {
        let [(s0, r0), (s1, r1), (s2, r2)] = [channel(), channel(), channel()];
        for n in 0..30 {
            let race = or(either(&r0, &r1), async {
                alt! {
                    value = r2.recv() => value.unwrap(),
                    value = r1.recv() => value.unwrap(),
                }
            });
            let sender = [&s0, &s1, &s2][n as usize % 3];
            assert_eq!(zip(race, sender.send(n)).await, (n, Ok(())));
            for sender in [&s0, &s1, &s2] {
                assert!(sender.try_send(0).unwrap_err().is_full());
            }
        }
    };
    block_on(body());
    luna_core::block_on(body()).unwrap();
    let executor = Executor::start(Attributes::new("race")).unwrap();
    executor.release();
    let process = executor.spawn(ProcessSpec::new("race"), body);
    assert_eq!(process.wait(), Exit::Completed);
}

/// Polls children with wakers of their own, each only when that was woken, as `FuturesUnordered`
/// does.
async fn each_with_its_waker<'a, T>(
    children: Vec<Pin<Box<dyn Future<Output = T> + 'a>>>,
) -> Vec<T> {
    let mut children: Vec<_> = children
        .into_iter()
        .map(|child| (Some(child), Wakes::new(), 0))
        .collect();
    let mut outputs = Vec::new();
    poll_fn(|cx| {
        for (slot, (wakes, waker), seen) in &mut children {
            let Some(child) = slot else { continue };
            let woken = wakes.count();
            // Polled once at first, then once for each wake.
            if *seen > woken {
                continue;
            }
            *seen = woken + 1;
            if let Poll::Ready(output) = child.as_mut().poll(&mut Context::from_waker(waker)) {
                outputs.push(output);
                *slot = None;
            }
        }
        if children.iter().all(|child| child.0.is_none()) {
            return Poll::Ready(());
        }
        // The children's wakers wake no task: this looks again.
        cx.waker().wake_by_ref();
        Poll::Pending
    })
    .await;
    outputs
}

#[test]
fn alternatives_with_wakers_of_their_own_within_one_process() {
    let _watchdog = Watchdog::new();
    let body = || async {
        let ((to_one, one), (to_two, two)) = (channel(), channel());
        let (to_one, to_two, one, two) = (&to_one, &to_two, &one, &two);
        let mut children: Vec<Pin<Box<dyn Future<Output = u64>>>> = Vec::new();
        for n in 1..=10 {
            children.push(Box::pin(either(one, two)));
            children.push(Box::pin(async move {
                let mut slot = Some(n);
                alt! {
                    sent = to_two.send_from(&mut slot) => sent.unwrap(),
                    sent = to_one.send(n) => sent.unwrap(),
                }
                0
            }));
        }
        let outputs = each_with_its_waker(children).await;
        assert_eq!(outputs.iter().sum::<u64>(), 55);
    };
    block_on(body());
    luna_core::block_on(body()).unwrap();
    let executor = Executor::start(Attributes::new("wakers")).unwrap();
    executor.release();
    let process = executor.spawn(ProcessSpec::new("wakers"), body);
    assert_eq!(process.wait(), Exit::Completed);
}

#[test]
fn random_drops_under_load_lose_and_double_nothing() {
    let _watchdog = Watchdog::new();
    let mut random = Random::seeded();
    // A process that receives from two channels, and drops each alternative after some polls; two
    // that send to them from threads.
    let ((to_one, one), (to_two, two)) = (channel::<u64>(), channel::<u64>());
    let senders = [to_one, to_two].map(|sender| {
        thread::spawn(move || {
            (1..=2_000)
                .filter(|&n| sender.blocking_send(n).is_ok())
                .count()
        })
    });
    let mut received = [0_u64; 2];
    let mut open = [true; 2];
    while open.contains(&true) {
        let polls = random.below(3);
        let alternative = async {
            alt! {
                value = one.recv(), if open[0] => (0, value.ok()),
                value = two.recv(), if open[1] => (1, value.ok()),
            }
        };
        let chosen = block_on(async {
            let mut alternative = pin!(alternative);
            for _ in 0..polls {
                let polled = poll_fn(|cx| Poll::Ready(alternative.as_mut().poll(cx))).await;
                if let Poll::Ready(chosen) = polled {
                    return Some(chosen);
                }
                yield_now().await;
            }
            None
        });
        match chosen {
            Some((n, Some(value))) => received[n] += value,
            Some((n, None)) => open[n] = false,
            None => {}
        }
    }
    // A value that came back may have changed places with the next, but each was received once.
    assert_eq!(received, [2_000 * 2_001 / 2; 2]);
    assert_eq!(senders.map(|sender| sender.join().unwrap()), [2_000; 2]);
}

//! The measured processes, each written once for all peers.
//!
//! A network ends by itself: the process that has measured enough drops its channel ends, and every
//! process ends when an end that it uses has no partner any more.

use std::{
    future::Future,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

use futures_lite::future;

use crate::channels::{Received, Receiving, Sending};

/// Operations before the clock starts, to warm up caches and branch predictors.
pub fn warm_up(operations: u64) -> u64 {
    operations / 16 + 1
}

/// Sends the numbers from zero until the receivers are gone.
pub async fn producer(mut output: impl Sending) {
    for number in 0.. {
        if output.send(number).await.is_err() {
            break;
        }
    }
}

/// Receives the numbers from zero, in sequence, and returns how long the last `operations` of them
/// took.
///
/// # Panics
///
/// A number is missing or wrong.
pub async fn consumer(mut input: impl Receiving, operations: u64) -> Duration {
    let warm_up = warm_up(operations);
    let mut start = Instant::now();
    for expected in 0..=warm_up + operations {
        assert_eq!(
            input.recv().await.value(),
            Some(expected),
            "out of sequence"
        );
        if expected == warm_up {
            start = Instant::now();
        }
    }
    start.elapsed()
}

/// Sends zero, then what it receives.
pub async fn prefix(mut input: impl Receiving, mut output: impl Sending) {
    let mut next = Some(0);
    while let Some(number) = next {
        if output.send(number).await.is_err() {
            break;
        }
        next = input.recv().await.value();
    }
}

/// Sends what it receives to the first output, then to the second.
pub async fn delta(mut input: impl Receiving, mut first: impl Sending, mut second: impl Sending) {
    while let Some(number) = input.recv().await.value() {
        if first.send(number).await.is_err() || second.send(number).await.is_err() {
            break;
        }
    }
}

/// Sends what it receives to both outputs at once.
pub async fn parallel_delta(
    mut input: impl Receiving,
    mut first: impl Sending,
    mut second: impl Sending,
) {
    while let Some(number) = input.recv().await.value() {
        let first = async { first.send(number).await.is_ok() };
        let second = async { second.send(number).await.is_ok() };
        if future::zip(first, second).await != (true, true) {
            break;
        }
    }
}

/// Sends one more than it receives.
pub async fn successor(mut input: impl Receiving, mut output: impl Sending) {
    while let Some(number) = input.recv().await.value() {
        if output.send(number + 1).await.is_err() {
            break;
        }
    }
}

/// Sends a number and waits for it to come back. Returns how long the last `operations` round trips
/// took.
///
/// # Panics
///
/// Another number comes back.
pub async fn ping(
    mut output: impl Sending,
    mut input: impl Receiving,
    operations: u64,
) -> Duration {
    let warm_up = warm_up(operations);
    let mut start = Instant::now();
    for number in 0..=warm_up + operations {
        assert!(output.send(number).await.is_ok(), "the partner has gone");
        assert_eq!(
            input.recv().await.value(),
            Some(number),
            "not the same number"
        );
        if number == warm_up {
            start = Instant::now();
        }
    }
    start.elapsed()
}

/// Sends back what it receives.
pub async fn pong(mut input: impl Receiving, mut output: impl Sending) {
    while let Some(number) = input.recv().await.value() {
        if output.send(number).await.is_err() {
            break;
        }
    }
}

/// One of two processes that yield to each other. Returns how long `switches` switches took, half
/// of them its own.
///
/// `mine` and `other` count how often the two processes yielded.
///
/// # Panics
///
/// The two did not take turns.
pub async fn yielding<Y: Future>(
    yield_now: impl Fn() -> Y,
    mine: Arc<AtomicU64>,
    other: Arc<AtomicU64>,
    switches: u64,
) -> Duration {
    let turns = switches / 2;
    let warm_up = warm_up(turns);
    let mut start = Instant::now();
    let mut other_at_start = 0;
    for turn in 0..=warm_up + turns {
        // Only the other process reads the count, after it has run in turn.
        mine.store(turn, Ordering::Relaxed);
        yield_now().await;
        if turn == warm_up {
            other_at_start = other.load(Ordering::Relaxed);
            start = Instant::now();
        }
    }
    let elapsed = start.elapsed();
    let others = other.load(Ordering::Relaxed) - other_at_start;
    assert!(
        others.abs_diff(turns) <= 1,
        "{others} turns of the other beside {turns}"
    );
    elapsed
}

/// Yields until `over`: an executor with such a process never sleeps.
pub async fn busy<Y: Future>(yield_now: impl Fn() -> Y, over: Arc<AtomicBool>) {
    while !over.load(Ordering::Relaxed) {
        yield_now().await;
    }
}

/// Receives any numbers. Returns how long the last `operations` of them took, after the first
/// `warm_up(operations)`.
///
/// # Panics
///
/// The senders are gone.
pub async fn counter(mut input: impl Receiving, operations: u64) -> Duration {
    for _ in 0..warm_up(operations) {
        assert!(input.recv().await.value().is_some(), "too few came");
    }
    let start = Instant::now();
    for _ in 0..operations {
        assert!(input.recv().await.value().is_some(), "too few came");
    }
    start.elapsed()
}

/// Receives until the senders are gone.
pub async fn sink(mut input: impl Receiving) {
    while input.recv().await.value().is_some() {}
}

/// Sends numbers. Returns how long the last `operations` of them took.
///
/// # Panics
///
/// The receivers are gone.
pub async fn source(mut output: impl Sending, operations: u64) -> Duration {
    for number in 0..warm_up(operations) {
        assert!(output.send(number).await.is_ok(), "the receivers are gone");
    }
    let start = Instant::now();
    for number in 0..operations {
        assert!(output.send(number).await.is_ok(), "the receivers are gone");
    }
    start.elapsed()
}

/// The process that a ring begins and ends with: sends a number round `laps` times, after one lap
/// to warm up, and returns how long that took.
///
/// The others are [`successor`]s, `others` of them.
///
/// # Panics
///
/// A number was not incremented by all the others.
pub async fn ring_head(
    mut output: impl Sending,
    mut input: impl Receiving,
    others: u64,
    laps: u64,
) -> Duration {
    let mut start = Instant::now();
    for lap in 0..=laps {
        assert!(output.send(lap).await.is_ok(), "the ring is open");
        assert_eq!(
            input.recv().await.value(),
            Some(lap + others),
            "a process was left out"
        );
        if lap == 0 {
            start = Instant::now();
        }
    }
    start.elapsed()
}

//! Timeouts that race with partners: what one side reports, the other side has seen.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Random, Watchdog, poll_with, ready};
use luna_channels::{Buffer, RecvTimeoutError, SendTimeoutError, buffered, channel};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Wake, Waker};
use std::thread;
use std::time::Duration;

const HOUR: Duration = Duration::from_secs(3600);

/// A waker that does something as it is dropped: here the partner's part, at the one moment between
/// the last look at the outcome and the withdrawal.
struct PartnerInBetween<F: Fn() + Send + Sync + 'static>(F);

impl<F: Fn() + Send + Sync + 'static> Wake for PartnerInBetween<F> {
    fn wake(self: Arc<Self>) {}
}

impl<F: Fn() + Send + Sync + 'static> Drop for PartnerInBetween<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// Polls `timed` so that its deadline has come and its partner comes during the poll.
fn time_out_as_the_partner_comes<F: Future>(
    mut timed: Pin<Box<F>>,
    partner: impl Fn() + Send + Sync + 'static,
) -> F::Output {
    luna_core::block_on(async {
        let waker = Waker::from(Arc::new(PartnerInBetween(partner)));
        assert!(poll_with(&mut timed, &waker).is_pending());
        drop(waker);
        luna_core::current::timers().unwrap().expire(Instant::NEVER);
        // Replaces the waker, which lets the partner come, finds that the deadline has come, and
        // withdraws.
        ready(&mut timed)
    })
    .unwrap()
}

#[test]
fn a_partner_that_comes_between_the_last_look_and_the_withdrawal_counts() {
    let (sender, receiver) = channel();
    let partner = move || sender.try_send(7).unwrap();
    assert_eq!(
        time_out_as_the_partner_comes(Box::pin(receiver.recv_timeout(HOUR)), partner),
        Ok(7)
    );

    let (sender, receiver) = channel();
    let partner = move || assert_eq!(receiver.try_recv(), Ok(8));
    assert_eq!(
        time_out_as_the_partner_comes(Box::pin(sender.send_timeout(8, HOUR)), partner),
        Ok(())
    );

    let (sender, receiver) = channel::<u8>();
    let (sender, partner) = (sender.clone(), move || sender.poison());
    let outcome = time_out_as_the_partner_comes(Box::pin(receiver.recv_timeout(HOUR)), partner);
    assert_eq!(outcome, Err(RecvTimeoutError::Poisoned));
    drop(sender);
}

#[test]
fn one_that_has_communicated_lets_the_more_urgent_run_though_its_time_is_over() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("gives way")).unwrap();
    let ((numbers, from_high), (to_high, received)) = (channel(), channel());
    let steps = Arc::new(AtomicUsize::new(0));
    let of_high = steps.clone();
    let high = executor.spawn(ProcessSpec::new("high").level(20), move || async move {
        numbers.send(1).await.unwrap();
        of_high.store(1, Ordering::Relaxed);
        assert_eq!(received.recv().await, Ok(2));
        of_high.store(2, Ordering::Relaxed);
    });
    let low = executor.spawn(ProcessSpec::new("low").level(5), move || async move {
        assert_eq!(from_high.recv_timeout(Duration::ZERO).await, Ok(1));
        assert_eq!(steps.load(Ordering::Relaxed), 1);
        assert_eq!(to_high.send_timeout(2, Duration::ZERO).await, Ok(()));
        assert_eq!(steps.load(Ordering::Relaxed), 2);
    });
    executor.release();
    assert_eq!(
        (high.wait(), low.wait()),
        (Exit::Completed, Exit::Completed)
    );
}

/// What both sides of a race between timeouts and partners report.
#[derive(Default)]
struct Tally {
    sent: AtomicUsize,
    timed_out: AtomicUsize,
    received: Mutex<Vec<usize>>,
}

impl Tally {
    fn sent(&self, outcome: Result<(), SendTimeoutError<common::Token>>, id: usize) {
        match outcome {
            Ok(()) => self.sent.fetch_add(1, Ordering::Relaxed),
            Err(error) => {
                assert!(error.is_timeout());
                assert_eq!(error.into_inner().id, id);
                self.timed_out.fetch_add(1, Ordering::Relaxed)
            }
        };
    }

    /// Returns whether to continue.
    fn received(&self, outcome: Result<common::Token, RecvTimeoutError>) -> bool {
        match outcome {
            Ok(token) => self.received.lock().unwrap().push(token.id),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Closed) => return false,
            Err(error) => panic!("{error}"),
        }
        true
    }

    fn check(self, ledger: &Ledger, values: usize) {
        let received = self.received.into_inner().unwrap();
        let sent = self.sent.into_inner();
        assert_eq!(sent + self.timed_out.into_inner(), values);
        assert_eq!(
            received.len(),
            sent,
            "what was reported as sent was received, and nothing else"
        );
        assert!(
            received.is_sorted_by(|a, b| a < b),
            "in order and none twice"
        );
        ledger.assert_all_dropped_once();
        println!("{sent} of {values} were sent, the others timed out");
    }
}

fn some_time(random: &mut Random) -> Duration {
    Duration::from_nanos(random.below(60_000) as u64)
}

#[test]
fn the_race_of_timeout_and_partner_between_threads() {
    const VALUES: usize = 3000;
    let _watchdog = Watchdog::new();
    let mut random = Random::seeded();
    for (sender, receiver) in [channel(), buffered(Buffer::fifo(1))] {
        let ledger = Ledger::new(VALUES);
        let tally = Tally::default();
        let mut own = random.split();
        thread::scope(|scope| {
            scope.spawn(|| {
                let sender = sender;
                for id in 0..VALUES {
                    tally.sent(
                        sender.blocking_send_timeout(ledger.token(id), some_time(&mut random)),
                        id,
                    );
                }
            });
            while tally.received(receiver.blocking_recv_timeout(some_time(&mut own))) {}
        });
        tally.check(&ledger, VALUES);
    }
}

#[test]
fn the_race_of_timeout_and_partner_between_executors_and_on_one() {
    const VALUES: usize = 1500;
    let _watchdog = Watchdog::new();
    let mut random = Random::seeded();
    for executors in [1, 2] {
        let executors: Vec<_> = (0..executors)
            .map(|n| Executor::start(Attributes::new(format!("race {n}"))).unwrap())
            .collect();
        let ledger = Ledger::new(VALUES);
        let tally = Arc::new(Tally::default());
        let (sender, receiver) = channel();
        let send = {
            let (tally, ledger, mut random) = (tally.clone(), ledger.clone(), random.split());
            executors[0].spawn(ProcessSpec::new("sender").level(10), move || async move {
                for id in 0..VALUES {
                    tally.sent(
                        sender
                            .send_timeout(ledger.token(id), some_time(&mut random))
                            .await,
                        id,
                    );
                }
            })
        };
        let recv = {
            let (tally, mut random) = (tally.clone(), random.split());
            executors.last().unwrap().spawn(
                ProcessSpec::new("receiver").level(11),
                move || async move {
                    while tally.received(receiver.recv_timeout(some_time(&mut random)).await) {}
                },
            )
        };
        executors.iter().for_each(Executor::release);
        assert_eq!(
            (send.wait(), recv.wait()),
            (Exit::Completed, Exit::Completed)
        );
        drop(executors);
        drop((send, recv));
        Arc::into_inner(tally).unwrap().check(&ledger, VALUES);
    }
}

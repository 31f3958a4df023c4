//! Many threads on one channel: nothing is lost, nothing doubled, and what one sender sent arrives
//! in order.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Random, Token, Watchdog, poll};
use luna_channels::{Buffer, Receiver, Sender, buffered, channel};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::thread::Attributes;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

fn buffers() -> [Option<Buffer>; 3] {
    [None, Some(Buffer::fifo(1)), Some(Buffer::fifo(7))]
}

fn make<T: Send>(buffer: Option<Buffer>) -> (Sender<T>, Receiver<T>) {
    buffer.map_or_else(channel, buffered)
}

/// The numbers that one receiver got rise for each sender; the numbers of senders are `values`
/// apart.
#[track_caller]
fn assert_in_order(received: &[usize], values: usize, senders: usize) {
    for sender in 0..senders {
        let of_sender = received.iter().filter(|&&id| id / values == sender);
        assert!(
            of_sender.is_sorted_by(|a, b| a < b),
            "the values of sender {sender} came out of order"
        );
    }
}

#[test]
fn any_to_any_with_blocking_ends() {
    const VALUES: usize = 400;
    let _watchdog = Watchdog::new();
    for buffer in buffers() {
        for (senders, receivers) in [(1, 1), (1, 4), (4, 1), (4, 4)] {
            let ledger = Ledger::new(senders * VALUES);
            let (sender, receiver) = make(buffer);
            let total = AtomicUsize::new(0);
            thread::scope(|scope| {
                for part in 0..senders {
                    let (sender, ledger) = (sender.clone(), ledger.clone());
                    scope.spawn(move || {
                        for n in 0..VALUES {
                            sender
                                .blocking_send(ledger.token(part * VALUES + n))
                                .unwrap();
                        }
                    });
                }
                for _ in 0..receivers {
                    let (receiver, total) = (receiver.clone(), &total);
                    scope.spawn(move || {
                        let received: Vec<usize> =
                            std::iter::from_fn(|| receiver.blocking_recv().ok())
                                .map(|token| token.id)
                                .collect();
                        assert_in_order(&received, VALUES, senders);
                        total.fetch_add(received.len(), Ordering::Relaxed);
                    });
                }
                drop((sender, receiver));
            });
            assert_eq!(total.into_inner(), senders * VALUES);
            ledger.assert_all_dropped_once();
        }
    }
}

#[test]
fn any_to_any_between_executors_of_many_levels() {
    const VALUES: usize = 500;
    let _watchdog = Watchdog::new();
    for buffer in buffers() {
        let ledger = Ledger::new(4 * VALUES);
        let executors =
            ["first", "second"].map(|name| Executor::start(Attributes::new(name)).unwrap());
        let (sender, receiver) = make(buffer);
        let (report, reports) = channel();
        let mut processes = Vec::new();
        for part in 0..4 {
            let (sender, ledger) = (sender.clone(), ledger.clone());
            let spec = ProcessSpec::new("sender").level(part as u8 * 3);
            processes.push(executors[part % 2].spawn(spec, move || async move {
                for n in 0..VALUES {
                    sender.send(ledger.token(part * VALUES + n)).await.unwrap();
                }
            }));
            let (receiver, report) = (receiver.clone(), report.clone());
            let spec = ProcessSpec::new("receiver").level(part as u8 * 4);
            processes.push(executors[part / 2].spawn(spec, move || async move {
                let mut received = Vec::new();
                while let Ok(token) = receiver.recv().await {
                    received.push(token.id);
                }
                report.send(received).await.unwrap();
            }));
        }
        drop((sender, receiver, report));
        executors.iter().for_each(Executor::release);
        let mut total = 0;
        while let Ok(received) = reports.blocking_recv() {
            assert_in_order(&received, VALUES, 4);
            total += received.len();
        }
        assert_eq!(total, 4 * VALUES);
        assert!(
            processes
                .iter()
                .all(|process| process.wait() == Exit::Completed)
        );
        ledger.assert_all_dropped_once();
    }
}

/// What a thread of the test below knows of the values that passed through it.
#[derive(Default)]
struct Known {
    /// Reported as sent.
    sent: Vec<usize>,
    received: Vec<usize>,
    /// Dropped with a future: it cannot be known whether it was sent.
    unknown: usize,
}

/// Sends in whatever form; some are given up half way.
fn send_somehow(sender: &Sender<Token>, random: &mut Random, token: Token, known: &mut Known) {
    let id = token.id;
    let sent = match random.below(5) {
        0 => sender.try_send(token).is_ok(),
        1 => sender
            .blocking_send_timeout(token, Duration::from_nanos(random.below(30_000) as u64))
            .is_ok(),
        2 => {
            let mut send = Box::pin(sender.send(token));
            for _ in 0..1 + random.below(3) {
                match poll(&mut send) {
                    std::task::Poll::Ready(outcome) => {
                        known.sent.extend(outcome.is_ok().then_some(id));
                        return;
                    }
                    std::task::Poll::Pending => thread::yield_now(),
                }
            }
            known.unknown += 1;
            return;
        }
        _ => sender.blocking_send(token).is_ok(),
    };
    known.sent.extend(sent.then_some(id));
}

/// Receives in any form; returns whether to continue.
fn receive_somehow(receiver: &Receiver<Token>, random: &mut Random, known: &mut Known) -> bool {
    let received = match random.below(5) {
        0 => receiver.try_recv().map_err(|error| error.is_closed()),
        1 => {
            let time = Duration::from_nanos(random.below(30_000) as u64);
            receiver
                .blocking_recv_timeout(time)
                .map_err(|error| error.is_closed())
        }
        2 => {
            let mut recv = Box::pin(receiver.recv());
            match poll(&mut recv) {
                std::task::Poll::Ready(outcome) => outcome.map_err(|error| error.is_closed()),
                std::task::Poll::Pending => {
                    thread::yield_now();
                    Err(false)
                }
            }
        }
        _ => receiver.blocking_recv().map_err(|error| error.is_closed()),
    };
    match received {
        Ok(token) => known.received.push(token.id),
        Err(closed) => return !closed,
    }
    true
}

#[test]
fn all_forms_at_once_and_futures_given_up_half_way() {
    const VALUES: usize = 700;
    let _watchdog = Watchdog::new();
    let mut random = Random::seeded();
    for buffer in buffers() {
        let ledger = Ledger::new(3 * VALUES);
        let (sender, receiver) = make(buffer);
        let all = Mutex::new(Known::default());
        let add = |known: Known| {
            let mut all = all.lock().unwrap();
            all.sent.extend(known.sent);
            all.received.extend(known.received);
            all.unknown += known.unknown;
        };
        thread::scope(|scope| {
            for part in 0..3 {
                let (sender, ledger, mut own) = (sender.clone(), ledger.clone(), random.split());
                scope.spawn(move || {
                    let mut known = Known::default();
                    for n in 0..VALUES {
                        send_somehow(
                            &sender,
                            &mut own,
                            ledger.token(part * VALUES + n),
                            &mut known,
                        );
                    }
                    add(known);
                });
                let (receiver, mut own) = (receiver.clone(), random.split());
                scope.spawn(move || {
                    let mut known = Known::default();
                    while receive_somehow(&receiver, &mut own, &mut known) {}
                    add(known);
                });
            }
            drop(sender);
        });
        // A receiver that came to the close before another gave a value back has left it.
        let mut left = Known::default();
        while receive_somehow(&receiver, &mut random, &mut left) {}
        let mut all = all.into_inner().unwrap();
        all.received.extend(left.received);
        drop(receiver);
        ledger.assert_all_dropped_once();

        all.received.sort_unstable();
        assert!(
            all.received.is_sorted_by(|a, b| a < b),
            "one was received twice"
        );
        assert!(
            all.sent
                .iter()
                .all(|id| all.received.binary_search(id).is_ok()),
            "one was sent and not received"
        );
        assert!(all.received.len() <= all.sent.len() + all.unknown);
        println!(
            "sent {}, received {}, unknown {}",
            all.sent.len(),
            all.received.len(),
            all.unknown
        );
    }
}

#[test]
fn overwriting_buffers_between_threads_lose_only_what_they_overwrite() {
    const VALUES: usize = 4000;
    let _watchdog = Watchdog::new();
    for buffer in [Buffer::overwrite_oldest(2), Buffer::overwrite_newest(2)] {
        let ledger = Ledger::new(VALUES);
        let (sender, receiver) = buffered(buffer);
        thread::scope(|scope| {
            let ledger = &ledger;
            scope.spawn(move || {
                (0..VALUES).for_each(|n| sender.blocking_send(ledger.token(n)).unwrap())
            });
            let received: Vec<usize> = std::iter::from_fn(|| receiver.blocking_recv().ok())
                .map(|token| token.id)
                .collect();
            assert_in_order(&received, VALUES, 1);
            assert_eq!(
                received.last(),
                Some(&(VALUES - 1)),
                "the last one is never overwritten"
            );
        });
        ledger.assert_all_dropped_once();
    }
}

#[test]
fn ends_come_and_go_while_values_pass() {
    const VALUES: usize = 1000;
    let _watchdog = Watchdog::new();
    for buffer in buffers() {
        let ledger = Ledger::new(2 * VALUES);
        let (sender, receiver) = make(buffer);
        thread::scope(|scope| {
            for part in 0..2 {
                let (mut sender, mut receiver, ledger) =
                    (sender.clone(), receiver.clone(), ledger.clone());
                scope.spawn(move || {
                    for n in 0..VALUES {
                        sender
                            .blocking_send(ledger.token(part * VALUES + n))
                            .unwrap();
                        sender = sender.clone();
                    }
                });
                scope.spawn(move || {
                    while receiver.blocking_recv().is_ok() {
                        receiver = receiver.clone();
                    }
                });
            }
            drop((sender, receiver));
        });
        ledger.assert_all_dropped_once();
    }
}

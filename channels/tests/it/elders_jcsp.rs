//! Situations that JCSP's own tests and demonstrations cover, in tests of our own. Each says which
//! one it is in JCSP.

#![cfg(not(loom))]

use crate::common;
use common::{Watchdog, pending, ready};
use futures_lite::future::block_on;
use luna_channels::{Buffer, Receiver, Sender, after, alt, at, buffered, channel, pri_alt};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::thread;
use std::time::Duration;

/// JCSP: `TestExtendedRendezvous`, `testNormal…Channel` in its four shapes: one or more writers,
/// one or more readers. A writer ends its write when the extended read of its value ends, and not
/// before.
#[test]
fn extended_rendezvous_in_four_shapes() {
    for (writers, readers) in [(1, 1), (3, 1), (1, 3), (3, 3)] {
        let (sender, receiver) = channel();
        let senders: Vec<Sender<usize>> = (0..writers).map(|_| sender.clone()).collect();
        let receivers: Vec<Receiver<usize>> = (0..readers).map(|_| receiver.clone()).collect();
        for round in 0..3 {
            let mut sends: Vec<_> = senders
                .iter()
                .enumerate()
                .map(|(n, sender)| Box::pin(sender.send(n)))
                .collect();
            sends.iter_mut().for_each(pending);
            for n in 0..writers {
                let reader = &receivers[(n + round) % readers];
                let read = ready(&mut Box::pin(reader.recv_extended())).unwrap();
                sends[n..].iter_mut().for_each(pending);
                assert_eq!(read.finish(), n);
                assert_eq!(ready(&mut sends[n]), Ok(()));
            }
        }
    }
}

/// JCSP: `testFIFO_…Channel`. A writer into a FIFO buffer waits while that is full, and never for
/// the extended read. (There, what is read keeps its place in the buffer until the read ends; here
/// it leaves it at once.)
#[test]
fn extended_reads_of_a_fifo_buffer() {
    for capacity in [1, 4] {
        let (sender, receiver) = buffered(Buffer::fifo(capacity));
        (0..capacity).for_each(|n| sender.try_send(n).unwrap());
        let mut waits = Box::pin(sender.send(capacity));
        pending(&mut waits);
        let read = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
        assert_eq!(
            ready(&mut waits),
            Ok(()),
            "there is room, though the read goes on"
        );
        let mut next = Box::pin(sender.send(capacity + 1));
        pending(&mut next);
        assert_eq!(read.finish(), 0);
        pending(&mut next);
        for n in 1..=capacity + 1 {
            assert_eq!(
                ready(&mut Box::pin(receiver.recv_extended()))
                    .unwrap()
                    .finish(),
                n
            );
        }
        assert_eq!(ready(&mut next), Ok(()));
    }
}

/// JCSP: `testOverflowingFIFO…` and `testOverwritingOldest…`. What is being read is not overwritten
/// by what is written meanwhile.
#[test]
fn extended_reads_of_overwriting_buffers() {
    for (buffer, expected) in [
        (Buffer::overwrite_oldest(2), [3, 4]),
        (Buffer::overwrite_newest(2), [2, 4]),
    ] {
        let (sender, receiver) = buffered(buffer);
        sender.try_send(1).unwrap();
        sender.try_send(2).unwrap();
        let read = ready(&mut Box::pin(receiver.recv_extended())).unwrap();
        sender.try_send(3).unwrap();
        sender.try_send(4).unwrap();
        assert_eq!(read.finish(), 1);
        assert_eq!([(); 2].map(|()| receiver.try_recv().unwrap()), expected);
    }
}

/// JCSP: `AltTest` (extended rendezvous). Three sources pass through delays that their writers do
/// not notice, and are merged by an alternative.
#[test]
fn three_sources_through_extended_delays_into_one_alternative() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("alt test")).unwrap();
    let mut ends = Vec::new();
    for n in 0..3_u32 {
        let (numbers, to_delay) = channel();
        let (delayed, end) = channel();
        ends.push(end);
        executor.spawn(
            ProcessSpec::new(format!("numbers {n}")),
            move || async move {
                for i in 0..20 {
                    numbers.send(100 * n + i).await.unwrap();
                }
            },
        );
        executor.spawn(ProcessSpec::new(format!("delay {n}")), move || async move {
            while let Ok(value) = to_delay.recv_extended().await {
                after(Duration::from_micros(100 * u64::from(n + 1))).await;
                delayed.send(*value).await.unwrap();
            }
        });
    }
    let merge = executor.spawn(ProcessSpec::new("merge"), move || async move {
        let (mut next, mut open) = ([0, 100, 200], [true; 3]);
        while open.contains(&true) {
            let (n, value) = alt! {
                value = ends[0].recv(), if open[0] => (0, value),
                value = ends[1].recv(), if open[1] => (1, value),
                value = ends[2].recv(), if open[2] => (2, value),
            };
            match value {
                Ok(value) => {
                    assert_eq!(value, next[n]);
                    next[n] += 1;
                }
                Err(_) => open[n] = false,
            }
        }
        assert_eq!(next, [20, 120, 220]);
    });
    executor.release();
    assert_eq!(merge.wait(), Exit::Completed);
}

/// Eight writers, each of which always has a value, into one alternative; how often each was served
/// in `rounds` selections.
async fn stressed(rounds: usize, fair: bool) -> [usize; 8] {
    let ends: [_; 8] = std::array::from_fn(|_| buffered::<u8>(Buffer::allocating_unbounded()));
    for (sender, _) in &ends {
        (0..rounds).for_each(|_| sender.try_send(0).unwrap());
    }
    let r = |n: usize| ends[n].1.recv();
    let mut served = [0; 8];
    for _ in 0..rounds {
        let n = if fair {
            alt! {
                _ = r(0) => 0, _ = r(1) => 1, _ = r(2) => 2, _ = r(3) => 3,
                _ = r(4) => 4, _ = r(5) => 5, _ = r(6) => 6, _ = r(7) => 7,
            }
        } else {
            pri_alt! {
                _ = r(0) => 0, _ = r(1) => 1, _ = r(2) => 2, _ = r(3) => 3,
                _ = r(4) => 4, _ = r(5) => 5, _ = r(6) => 6, _ = r(7) => 7,
            }
        };
        served[n] += 1;
    }
    served
}

/// JCSP: `StressedAlt` with `fairSelect`, and with `priSelect`: each is served equally often; or
/// the first alone.
#[test]
fn stressed_alternatives() {
    assert_eq!(block_on(stressed(800, true)), [100; 8]);
    assert_eq!(block_on(stressed(800, false)), [800, 0, 0, 0, 0, 0, 0, 0]);
}

/// JCSP: `StressedAlt`, with eight writers of each of eight channels as processes.
#[test]
fn many_writers_of_many_channels() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("stressed")).unwrap();
    let (ends, receivers): (Vec<_>, Vec<_>) = (0..8).map(|_| channel::<(usize, usize)>()).unzip();
    for (c, sender) in ends.into_iter().enumerate() {
        for w in 0..8 {
            let sender = sender.clone();
            executor.spawn(ProcessSpec::new(format!("{c} {w}")), move || async move {
                for n in 0..10 {
                    sender.send((w, n)).await.unwrap();
                }
            });
        }
    }
    let reader = executor.spawn(ProcessSpec::new("reader"), move || async move {
        let mut next = [[0; 8]; 8];
        let r = |n: usize| receivers[n].recv();
        for _ in 0..8 * 8 * 10 {
            let (c, value) = alt! {
                v = r(0) => (0, v), v = r(1) => (1, v), v = r(2) => (2, v), v = r(3) => (3, v),
                v = r(4) => (4, v), v = r(5) => (5, v), v = r(6) => (6, v), v = r(7) => (7, v),
            };
            let (w, n) = value.unwrap();
            assert_eq!(n, next[c][w], "each writer's values in order");
            next[c][w] += 1;
        }
        assert_eq!(next, [[10; 8]; 8]);
    });
    executor.release();
    assert_eq!(reader.wait(), Exit::Completed);
}

/// JCSP: `FairPlexTime`. Fair among inputs that are always ready, until a timeout, which is a guard
/// too: it is neither starved nor early.
#[test]
fn fair_plexing_until_a_timeout() {
    let _watchdog = Watchdog::new();
    luna_core::block_on(async {
        let (a, b) = (
            buffered(Buffer::allocating_unbounded()),
            buffered(Buffer::allocating_unbounded()),
        );
        let deadline = Instant::now() + Duration::from_millis(5);
        let mut counts = [0_i64; 2];
        loop {
            // Always something there.
            a.0.try_send(0).unwrap();
            b.0.try_send(0).unwrap();
            alt! {
                _ = a.1.recv() => counts[0] += 1,
                _ = b.1.recv() => counts[1] += 1,
                _ = at(deadline) => break,
            }
        }
        assert!(Instant::now() >= deadline);
        assert!((counts[0] - counts[1]).abs() <= 1, "{counts:?}");
    })
    .unwrap();
}

/// JCSP: `PriPlexTime`. By priority the timeout, written first, ends it though inputs are always
/// ready.
#[test]
fn prioritized_plexing_until_a_timeout() {
    let _watchdog = Watchdog::new();
    luna_core::block_on(async {
        let (sender, receiver) = buffered(Buffer::allocating_unbounded());
        let deadline = Instant::now() + Duration::from_millis(5);
        loop {
            sender.try_send(0).unwrap();
            pri_alt! {
                _ = at(deadline) => break,
                value = receiver.recv() => value.unwrap(),
            };
        }
        assert!(Instant::now() >= deadline);
    })
    .unwrap();
}

/// JCSP: `Regulate`. Inputs come when they like; the latest goes out at each tick of absolute
/// deadlines; a reset changes the period.
#[test]
fn a_regulator() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("regulate")).unwrap();
    let (input, from_input) = channel::<u32>();
    let (reset, from_reset) = channel::<Duration>();
    let (output, regulated) = channel::<(u32, Instant)>();
    executor.spawn(ProcessSpec::new("regulate"), move || async move {
        let (mut latest, mut period) = (0, Duration::from_millis(2));
        let mut tick = Instant::now() + period;
        loop {
            pri_alt! {
                new = from_reset.recv() => match new {
                    Ok(new) => { period = new; tick = Instant::now() + period; }
                    Err(_) => return,
                },
                _ = at(tick) => {
                    output.send((latest, tick)).await.unwrap();
                    tick += period;
                }
                value = from_input.recv() => latest = value.unwrap(),
            }
        }
    });
    executor.release();
    let user = executor.spawn(ProcessSpec::new("user"), move || async move {
        // The regulator may be at its output, so this takes that too.
        let mut n = 1;
        while n <= 5 {
            alt! {
                sent = input.send(n) => { sent.unwrap(); n += 1; }
                early = regulated.recv() => assert!(early.unwrap().0 < n),
            }
        }
        let (value, first) = regulated.recv().await.unwrap();
        assert_eq!(value, 5);
        let (_, second) = regulated.recv().await.unwrap();
        assert_eq!(
            first + Duration::from_millis(2),
            second,
            "a tick does not drift"
        );
        loop {
            alt! {
                sent = reset.send(Duration::from_millis(1)) => break sent.unwrap(),
                more = regulated.recv() => assert!(more.is_ok()),
            }
        }
        let ticks = [
            regulated.recv().await.unwrap().1,
            regulated.recv().await.unwrap().1,
        ];
        assert_eq!(ticks[0] + Duration::from_millis(1), ticks[1]);
        drop(reset);
        assert!(regulated.recv().await.is_err() || regulated.recv().await.is_err());
        drop(input);
    });
    assert_eq!(user.wait(), Exit::Completed);
}

/// JCSP: `Polling`. A process polls its inputs by `priSelect` with a skip guard, and does other
/// work in between.
#[test]
fn polling_with_a_skip_guard() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel();
    let thread = thread::spawn(move || {
        for n in 0..50 {
            sender.blocking_send(n).unwrap();
        }
    });
    let (mut next, mut work) = (0, 0_u64);
    block_on(async {
        loop {
            pri_alt! {
                value = receiver.recv() => match value {
                    Ok(n) => { assert_eq!(n, next); next += 1; }
                    Err(_) => break,
                },
                skip => { work += 1; thread::yield_now(); }
            }
        }
    });
    assert_eq!(next, 50);
    thread.join().unwrap();
}

/// JCSP: `CommsTimeSymmetric` and the tests of `One2OneChannelSymmetric`: both ends of a channel in
/// alternatives, which there takes channels of their own kind.
#[test]
fn both_ends_of_each_channel_in_alternatives() {
    let _watchdog = Watchdog::new();
    let body = || async {
        let ((a, from_a), (b, from_b), (never, other)) = (channel(), channel(), channel::<u32>());
        let pass = async {
            for n in 0..200_u32 {
                let value = alt! {
                    value = from_a.recv() => value.unwrap(),
                    value = other.recv() => value.unwrap(),
                };
                assert_eq!(value, n);
                alt! {
                    sent = b.send(value + 1) => sent.unwrap(),
                    value = other.recv() => unreachable!("{value:?}"),
                }
            }
        };
        let drive = async {
            for n in 0..200 {
                alt! {
                    sent = never.send(0), if false => sent.unwrap(),
                    sent = a.send(n) => sent.unwrap(),
                }
                let value = alt! {
                    value = from_b.recv() => value.unwrap(),
                    value = from_a.recv(), if n > 1_000 => value.unwrap(),
                };
                assert_eq!(value, n + 1);
            }
        };
        futures_lite::future::zip(pass, drive).await;
    };
    block_on(body());
    luna_core::block_on(body()).unwrap();
}

/// JCSP: `Alternative.select(boolean[])`. Preconditions choose the guards anew at each selection,
/// here a buffer that is never over- nor underrun.
#[test]
fn preconditions_of_a_bounded_buffer() {
    let _watchdog = Watchdog::new();
    let ((put, puts), (get, gets)) = (channel(), channel());
    let buffer = thread::spawn(move || {
        block_on(async {
            let mut held = std::collections::VecDeque::new();
            let mut open = true;
            while open || !held.is_empty() {
                let next = held.front().copied();
                alt! {
                    value = puts.recv(), if open && held.len() < 3 => match value {
                        Ok(value) => held.push_back(value),
                        Err(_) => open = false,
                    },
                    sent = get.send(next.unwrap()), if next.is_some() => {
                        sent.unwrap();
                        held.pop_front();
                    }
                }
                assert!(held.len() <= 3);
            }
        })
    });
    let feeder = thread::spawn(move || (0..1_000).for_each(|n| put.blocking_send(n).unwrap()));
    for n in 0..1_000 {
        assert_eq!(gets.blocking_recv(), Ok(n));
    }
    assert!(gets.blocking_recv().unwrap_err().is_closed());
    feeder.join().unwrap();
    buffer.join().unwrap();
}

/// JCSP: poison (Sputh and Allen). An alternative with a poisoned channel gives the poison; passed
/// on, it ends a network of alternatives in a ring.
#[test]
fn poison_ends_a_ring_of_alternatives() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("poison")).unwrap();
    let (first, mut last) = channel::<u32>();
    let killer = last.clone();
    let mut processes = Vec::new();
    for n in 0..5 {
        let (to, from) = if n == 4 {
            (first.clone(), std::mem::replace(&mut last, channel().1))
        } else {
            let (to, next) = channel();
            (to, std::mem::replace(&mut last, next))
        };
        processes.push(
            executor.spawn(ProcessSpec::new(format!("{n}")), move || async move {
                let (_quiet, other) = channel::<u32>();
                let error = loop {
                    alt! {
                        value = from.recv() => match value {
                            Ok(value) => if to.send(value + 1).await.is_err() { break true },
                            Err(error) => break error.is_poisoned(),
                        },
                        value = other.recv() => unreachable!("{value:?}"),
                    }
                };
                from.poison();
                to.poison();
                assert!(error);
            }),
        );
    }
    executor.release();
    first.blocking_send(0).unwrap();
    killer.poison();
    for process in processes {
        assert_eq!(process.wait(), Exit::Completed);
    }
}

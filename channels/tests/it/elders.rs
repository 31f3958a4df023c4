//! Situations that the tests of other systems cover, and no other test here: crossbeam-channel's
//! suites of selection (`select.rs`, `select_macro.rs`, `same_channel.rs`, `ready.rs`), Go's
//! (`runtime/chan_test.go`, `test/chan`), and JCSP's tests and demonstrations. Each says which one
//! it is there.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Watchdog, pending, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, Receiver, RecvError, Sender, TryRecvError, after, alt, at, buffered, channel,
};
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::any::Any;
use std::sync::Barrier;
use std::thread;
use std::time::Duration;

fn unbounded<T: Send>() -> (Sender<T>, Receiver<T>) {
    buffered(Buffer::allocating_unbounded())
}

/// With a buffer, or for 0 without one.
fn of_capacity<T: Send>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    match capacity {
        0 => channel(),
        capacity => buffered(Buffer::fifo(capacity)),
    }
}

/// crossbeam: `disconnected`, `default`, `default_when_disconnected`. An ended channel is ready,
/// even if no other is, and rather than `skip` or a delay; before its end it is not.
#[test]
fn an_end_is_ready_rather_than_skip_or_a_delay() {
    let _watchdog = Watchdog::new();
    luna_core::block_on(async {
        let ((s1, r1), (_s2, r2)) = (unbounded::<u8>(), unbounded::<u8>());
        let (to_nobody, nobody) = channel::<u8>();
        let nothing = alt! {
            _ = r1.recv() => false,
            _ = r2.recv() => false,
            _ = to_nobody.send(1) => false,
            skip => true,
        };
        assert!(nothing);
        drop((s1, nobody));
        let far = Duration::from_secs(3600);
        for _ in 0..3 {
            assert_eq!(
                alt! { value = r2.recv() => value, value = r1.recv() => value, skip => Ok(0) },
                Err(RecvError::Closed)
            );
            assert_eq!(
                alt! { value = r1.recv() => value, _ = after(far) => Ok(0) },
                Err(RecvError::Closed)
            );
            assert!(alt! { sent = to_nobody.send(1) => sent.is_err(), skip => false });
            assert!(alt! { sent = to_nobody.send(1) => sent.is_err(), _ = after(far) => false });
        }
    })
    .unwrap();
}

/// crossbeam: `loop_try`. Two processes that try without waiting, against one that waits for either
/// of them.
#[test]
fn two_that_try_against_one_that_waits() {
    let _watchdog = Watchdog::new();
    for _ in 0..50 {
        let ((s1, r1), (s2, r2), (end, ended)) = (channel(), channel(), channel::<()>());
        let done: Vec<bool> = thread::scope(|scope| {
            let (s1, r2, other) = (&s1, &r2, ended.clone());
            let sends = scope.spawn(move || {
                loop {
                    let sent = block_on(async {
                        alt! { sent = s1.send(1) => Some(sent), skip => None }
                    });
                    match sent {
                        Some(sent) => return sent.is_ok(),
                        None if other.try_recv().unwrap_err().is_closed() => return false,
                        None => thread::yield_now(),
                    }
                }
            });
            let receives = scope.spawn(move || {
                loop {
                    match r2.try_recv() {
                        Ok(value) => return value == 2,
                        Err(_) if ended.try_recv().unwrap_err().is_closed() => return false,
                        Err(_) => thread::yield_now(),
                    }
                }
            });
            let waits = scope.spawn(move || {
                block_on(async {
                    alt! {
                        value = r1.recv() => assert_eq!(value, Ok(1)),
                        sent = s2.send(2) => sent.unwrap(),
                    }
                });
                drop(end);
            });
            waits.join().unwrap();
            [sends, receives]
                .map(|thread| thread.join().unwrap())
                .into()
        });
        assert_eq!(done.iter().filter(|&&done| done).count(), 1, "exactly one");
    }
}

/// crossbeam: `duplicate_operations`, `same_channel.rs`. Each guard twice, and both ends of each
/// channel, in two processes that meet each other alone.
#[test]
fn each_guard_twice() {
    let _watchdog = Watchdog::new();
    let ((s1, r1), (s2, r2)) = (channel(), channel());
    let meet = |me: u32| {
        let (s1, r1, s2, r2) = (&s1, &r1, &s2, &r2);
        move || {
            block_on(async move {
                let mut balance = 0_i32;
                for _ in 0..1_000 {
                    balance += alt! {
                        sent = s1.send(me) => { sent.unwrap(); 1 }
                        value = r1.recv() => { assert_ne!(value, Ok(me)); -1 }
                        sent = s1.send(me) => { sent.unwrap(); 1 }
                        value = r2.recv() => { assert_ne!(value, Ok(me)); -1 }
                        sent = s2.send(me) => { sent.unwrap(); 1 }
                        value = r1.recv() => { assert_ne!(value, Ok(me)); -1 }
                    };
                }
                balance
            })
        }
    };
    thread::scope(|scope| {
        let other = scope.spawn(meet(1));
        assert_eq!(
            meet(2)() + other.join().unwrap(),
            0,
            "as many sent as received"
        );
    });
}

/// crossbeam: `nesting`. An alternative in the body of another, three deep, on the same channels.
#[test]
fn one_in_the_body_of_another() {
    let (sender, receiver) = unbounded();
    let reached = block_on(async {
        alt! {
            sent = sender.send(0) => { sent.unwrap(); alt! {
                value = receiver.recv() => { assert_eq!(value, Ok(0)); alt! {
                    sent = sender.send(1) => { sent.unwrap(); alt! {
                        value = receiver.recv() => value,
                    } }
                } }
            } }
        }
    });
    assert_eq!(reached, Ok(1));
}

/// crossbeam: `matching`, `matching_with_leftover`, `sync_and_clone`. Many processes offer both
/// ends of one channel: they pair off, none with itself, and of an odd number one is left.
#[test]
fn many_pair_off() {
    let _watchdog = Watchdog::new();
    for leftover in [false, true] {
        let (sender, receiver) = channel();
        thread::scope(|scope| {
            for me in 0..8 - usize::from(leftover) {
                let (sender, receiver) = (&sender, &receiver);
                scope.spawn(move || {
                    block_on(async {
                        alt! {
                            value = receiver.recv() => assert_ne!(value.unwrap(), me),
                            sent = sender.send(me) => sent.unwrap(),
                        }
                    })
                });
            }
            if leftover {
                // Takes one of the seven, so that the others are even.
                sender.blocking_send(usize::MAX).unwrap();
            }
        });
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    }
}

/// crossbeam: `channel_through_channel`. A channel is sent through itself, again and again, in
/// alternatives.
#[test]
fn a_channel_through_a_channel() {
    type Anything = Box<dyn Any + Send>;
    let _watchdog = Watchdog::new();
    for capacity in [0, 1, 2] {
        let make = move || match capacity {
            0 => channel::<Anything>(),
            capacity => buffered::<Anything>(Buffer::fifo(capacity)),
        };
        let (mut sender, mut receiver) = make();
        let thread = thread::spawn(move || {
            block_on(async {
                for _ in 0..200 {
                    let (next, end) = make();
                    let end: Anything = Box::new(end);
                    alt! { sent = sender.send(end) => assert!(sent.is_ok()) }
                    sender = next;
                }
            })
        });
        block_on(async {
            for _ in 0..200 {
                let next = alt! { value = receiver.recv() => value.unwrap() };
                receiver = *next.downcast::<Receiver<Anything>>().unwrap();
            }
        });
        thread.join().unwrap();
    }
}

/// crossbeam: `fairness2`, `fairness_recv`, `fairness_send`. Of a rendezvous, a buffer of one and
/// one that grows, whichever are ready take turns.
#[test]
fn rendezvous_and_buffers_take_turns() {
    let ((s1, r1), (s2, r2), (s3, r3)) = (unbounded(), buffered(Buffer::fifo(1)), channel());
    let mut hits = [0; 3];
    for _ in 0..300 {
        // All ready.
        let _ = (s1.try_send(()), s2.try_send(()));
        let mut send = Box::pin(s3.send(()));
        pending(&mut send);
        let n = block_on(async {
            alt! { _ = r1.recv() => 0, _ = r2.recv() => 1, _ = r3.recv() => 2 }
        });
        hits[n] += 1;
    }
    assert_eq!(hits, [100; 3]);
}

/// crossbeam: `references`, `handles_on_heap`, `once_receiver`, `infer_types`, `case_blocks`,
/// `same_variable_name` of `select_macro.rs`. What may stand for an end, a pattern and a body.
#[test]
fn what_may_stand_for_an_end_a_pattern_and_a_body() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = unbounded();
    let (boxed, list) = (Box::new(sender.clone()), [Box::new(receiver.clone())]);
    let value = block_on(async {
        alt! { sent = (*boxed).send(Some(ledger.token(0))) => { sent.unwrap(); } }
        alt! { value = list[0].recv() => value.unwrap() }
    });
    assert_eq!(value.map(|token| token.id), Some(0));
    ledger.assert_all_dropped_once();
    let r = &receiver;
    sender.try_send(None).unwrap();
    let nothing = block_on(async {
        alt! { r = r.recv() => r.unwrap().is_none() }
    });
    assert!(nothing);
}

/// Go: `TestNonblockRecvRace`. What was buffered before the close is there for a non-blocking
/// receive that races with the close.
#[test]
fn a_non_blocking_receive_races_with_the_close() {
    let _watchdog = Watchdog::new();
    for _ in 0..1_000 {
        let (sender, receiver) = buffered(Buffer::fifo(1));
        sender.try_send(1).unwrap();
        thread::scope(|scope| {
            scope.spawn(move || drop(sender));
            let value = block_on(async {
                alt! { value = receiver.recv() => value, skip => unreachable!("it is there") }
            });
            assert_eq!(value, Ok(1));
        });
    }
}

/// Go: `TestNonblockSelectRace2`. One channel is ready until after the other one is closed, so a
/// look at both always finds one. (The first of the two is invariant 8.)
#[test]
fn a_non_blocking_choice_races_with_a_close() {
    let _watchdog = Watchdog::new();
    for _ in 0..1_000 {
        let ((one, from_one), (two, from_two)) = (buffered(Buffer::fifo(1)), channel::<u8>());
        one.try_send(1).unwrap();
        let start = Barrier::new(2);
        thread::scope(|scope| {
            scope.spawn(|| {
                start.wait();
                block_on(async {
                    alt! {
                        value = from_one.recv() => assert_eq!(value, Ok(1)),
                        value = from_two.recv() => assert_eq!(value, Err(RecvError::Closed)),
                        skip => panic!("one of them is ready at any time"),
                    }
                });
            });
            start.wait();
            drop(two);
            let _ = from_one.try_recv();
        });
    }
}

/// Go: `TestSelectStress`. Plain operations and alternatives, on rendezvous and buffers, all
/// against each other; as many sends as receives.
#[test]
fn plain_operations_and_alternatives_against_each_other() {
    const COUNT: usize = 1_000;
    let _watchdog = Watchdog::new();
    let [(s0, r0), (s1, r1), (s2, r2), (s3, r3)] = [0, 0, 2, 3].map(of_capacity);
    let (senders, receivers) = ([s0, s1, s2, s3], [r0, r1, r2, r3]);
    thread::scope(|scope| {
        for sender in &senders {
            scope.spawn(|| (0..COUNT).for_each(|n| sender.blocking_send(n).unwrap()));
        }
        for receiver in &receivers {
            scope.spawn(|| (0..COUNT).for_each(|_| assert!(receiver.blocking_recv().is_ok())));
        }
        let s = &senders;
        scope.spawn(move || {
            block_on(async {
                let mut left = [COUNT; 4];
                while left != [0; 4] {
                    let n = alt! {
                        sent = s[3].send(3), if left[3] > 0 => { sent.unwrap(); 3 }
                        sent = s[2].send(2), if left[2] > 0 => { sent.unwrap(); 2 }
                        sent = s[0].send(0), if left[0] > 0 => { sent.unwrap(); 0 }
                        sent = s[1].send(1), if left[1] > 0 => { sent.unwrap(); 1 }
                    };
                    left[n] -= 1;
                }
            })
        });
        let r = &receivers;
        scope.spawn(move || {
            block_on(async {
                let mut left = [COUNT; 4];
                while left != [0; 4] {
                    let n = alt! {
                        value = r[0].recv(), if left[0] > 0 => { value.unwrap(); 0 }
                        value = r[1].recv(), if left[1] > 0 => { value.unwrap(); 1 }
                        value = r[2].recv(), if left[2] > 0 => { value.unwrap(); 2 }
                        value = r[3].recv(), if left[3] > 0 => { value.unwrap(); 3 }
                    };
                    left[n] -= 1;
                }
            })
        });
    });
    for receiver in receivers {
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
    }
}

/// Go: `TestSelectDuplicateChannel`. One waits twice on a channel, another behind it; the first is
/// chosen elsewhere; the other must be found.
#[test]
fn one_channel_twice_before_another_that_waits() {
    let ((c, from_c), (d, from_d)) = (channel(), channel());
    let mut twice = Box::pin(async {
        alt! {
            value = from_c.recv() => ('c', value),
            value = from_c.recv() => ('c', value),
            value = from_d.recv() => ('d', value),
        }
    });
    pending(&mut twice);
    let mut behind = Box::pin(from_c.recv());
    pending(&mut behind);
    assert_eq!(d.try_send(7), Ok(()));
    assert_eq!(ready(&mut twice), ('d', Ok(7)));
    assert_eq!(c.try_send(8), Ok(()));
    assert_eq!(ready(&mut behind), Ok(8));
    assert!(c.try_send(9).unwrap_err().is_full());
}

/// Go: `test/chan/select6.go` (issue 2075). A loser that is the last in a queue is taken out, and a
/// later waiter is still found.
#[test]
fn a_loser_at_the_end_of_a_queue() {
    let ((c, from_c), (d, from_d)) = (channel(), channel());
    let mut first = Box::pin(from_c.recv());
    pending(&mut first);
    let mut last = Box::pin(async {
        alt! {
            value = from_c.recv() => unreachable!("{value:?}"),
            value = from_d.recv() => value.unwrap(),
        };
        from_c.recv().await
    });
    pending(&mut last);
    assert_eq!(d.try_send(0), Ok(()));
    pending(&mut last);
    assert_eq!([c.try_send(1), c.try_send(2)], [Ok(()), Ok(())]);
    assert_eq!((ready(&mut first), ready(&mut last)), (Ok(1), Ok(2)));
}

/// Go: `test/chan/select5.go`. Channels and values of guards are evaluated once, in the order
/// written, also of those that are not chosen; the preconditions, which Go has not, before them.
#[test]
fn guards_are_evaluated_once_in_the_order_written() {
    let order = std::cell::RefCell::new(Vec::new());
    let note = |what| order.borrow_mut().push(what);
    let ((one, from_one), (two, from_two)) = (buffered(Buffer::fifo(1)), channel::<u8>());
    block_on(async {
        alt! {
            _ = { note("channel two"); &from_two }.recv() => note("two"),
            _ = { note("not this"); &from_two }.recv(), if { note("condition"); false } => note("never"),
            _ = { note("channel one"); &one }.send({ note("value"); 1 }) => note("one"),
        }
    });
    assert_eq!(
        *order.borrow(),
        ["condition", "channel two", "channel one", "value", "one"]
    );
    assert_eq!(from_one.try_recv(), Ok(1));
    drop(two);
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

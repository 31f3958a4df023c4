//! Situations that Go's own tests cover (`runtime/chan_test.go`, `runtime/chanbarrier_test.go`,
//! `test/chan`), in tests of our own. Each says which one it is in Go.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Watchdog, pending, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, Receiver, RecvError, Sender, TryRecvError, alt, buffered, channel, pri_alt,
};
use std::collections::HashSet;
use std::sync::{Arc, Barrier};
use std::thread;

/// With a buffer, or for 0 without one.
fn of_capacity<T: Send>(capacity: usize) -> (Sender<T>, Receiver<T>) {
    match capacity {
        0 => channel(),
        capacity => buffered(Buffer::fifo(capacity)),
    }
}

/// Go: `TestChan`, the basic properties at many capacities.
#[test]
fn basic_properties_at_many_capacities() {
    let _watchdog = Watchdog::new();
    for capacity in 0..20 {
        let (sender, receiver) = of_capacity(capacity);
        // Empty: a receive waits, a non-blocking one does not.
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
        let skips = block_on(async {
            pri_alt! { value = receiver.recv() => value.is_err(), skip => true }
        });
        assert!(skips);
        sender.try_send(0).unwrap();
        assert_eq!(ready(&mut recv), Ok(0));
        // Full: a send waits, a non-blocking one does not.
        (0..capacity).for_each(|n| sender.try_send(n).unwrap());
        assert_eq!(receiver.buffered(), capacity);
        let mut send = Box::pin(sender.send(capacity));
        pending(&mut send);
        assert!(sender.try_send(99).unwrap_err().is_full());
        // All in order, and what was buffered after the end.
        assert_eq!(receiver.try_recv(), Ok(0));
        assert_eq!(ready(&mut send), Ok(()));
        drop(send);
        drop(sender);
        for n in 1..=capacity {
            assert_eq!(receiver.try_recv(), Ok(n));
        }
        assert_eq!(block_on(receiver.recv()), Err(RecvError::Closed));
        assert_eq!(receiver.try_recv(), Err(TryRecvError::Closed));
    }
}

/// Go: `TestChan`, four senders and four receivers.
#[test]
fn four_that_send_and_four_that_receive() {
    let _watchdog = Watchdog::new();
    for capacity in [0, 1, 7] {
        let (sender, receiver) = of_capacity(capacity);
        let received: Vec<usize> = thread::scope(|scope| {
            for _ in 0..4 {
                let sender = sender.clone();
                scope.spawn(move || (0..500).for_each(|n| sender.blocking_send(n).unwrap()));
            }
            drop(sender);
            let receivers: Vec<_> = (0..4)
                .map(|_| {
                    let receiver = receiver.clone();
                    scope.spawn(move || {
                        std::iter::from_fn(|| receiver.blocking_recv().ok()).collect::<Vec<_>>()
                    })
                })
                .collect();
            receivers
                .into_iter()
                .flat_map(|receiver| receiver.join().unwrap())
                .collect()
        });
        let mut counts = [0; 500];
        received.into_iter().for_each(|n| counts[n] += 1);
        assert_eq!(counts, [4; 500]);
    }
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

/// Go: `TestSelfSelect`. Two processes that offer both ends of one channel, in both orders: neither
/// receives its own value.
#[test]
fn both_ends_of_one_channel_in_two_processes() {
    let _watchdog = Watchdog::new();
    for capacity in [0, 10] {
        let (sender, receiver) = of_capacity(capacity);
        let partner = |me: usize| {
            let (sender, receiver) = (sender.clone(), receiver.clone());
            move || {
                block_on(async {
                    for n in 0..1_000 {
                        let received = if me == 0 || n % 2 == 0 {
                            pri_alt! {
                                sent = sender.send(me) => sent.map(|()| None).unwrap(),
                                value = receiver.recv() => Some(value.unwrap()),
                            }
                        } else {
                            pri_alt! {
                                value = receiver.recv() => Some(value.unwrap()),
                                sent = sender.send(me) => sent.map(|()| None).unwrap(),
                            }
                        };
                        assert!(capacity > 0 || received != Some(me), "its own value");
                    }
                })
            }
        };
        // A rendezvous always finds the other one: both make as many steps.
        let other = thread::spawn(partner(0));
        partner(1)();
        other.join().unwrap();
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

/// Go: `TestPseudoRandomSend`. Two sends on one channel: both happen. Here in turns, as each clone
/// of an end has its own.
#[test]
fn two_sends_on_one_channel_both_happen() {
    let _watchdog = Watchdog::new();
    for capacity in [0, 100] {
        let (sender, receiver) = of_capacity(capacity);
        let thread = thread::spawn(move || {
            (0..100)
                .map(|_| receiver.blocking_recv().unwrap())
                .sum::<usize>()
        });
        let other = sender.clone();
        block_on(async {
            for _ in 0..100 {
                alt! {
                    sent = sender.send(1) => sent.unwrap(),
                    sent = other.send(0) => sent.unwrap(),
                }
            }
        });
        assert_eq!(thread.join().unwrap(), 50, "capacity {capacity}");
    }
}

/// Go: `TestMultiConsumer`. A feeder, many workers, one collector; closed one after the other.
#[test]
fn a_feeder_many_workers_and_one_that_collects() {
    let _watchdog = Watchdog::new();
    let (feed, work) = buffered::<u64>(Buffer::fifo(24));
    let (results, collected) = buffered::<u64>(Buffer::fifo(24));
    let feeder = thread::spawn(move || (0..5_000).for_each(|n| feed.blocking_send(n).unwrap()));
    for worker in 0..8 {
        let (work, results) = (work.clone(), results.clone());
        thread::spawn(move || {
            while let Ok(n) = work.blocking_recv() {
                if n % 8 == worker {
                    thread::yield_now();
                }
                results.blocking_send(n).unwrap();
            }
        });
    }
    drop((work, results));
    let all: Vec<u64> = std::iter::from_fn(|| collected.blocking_recv().ok()).collect();
    assert_eq!((all.len(), all.iter().sum::<u64>()), (5_000, 4_999 * 2_500));
    feeder.join().unwrap();
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

/// Go: `TestChanSendSelectBarrier` and `TestChanSendBarrier`: values that lie on the heap, sent
/// from where the sender forgets them at once.
#[test]
fn values_on_the_heap_through_many_hands() {
    let _watchdog = Watchdog::new();
    let ledger = Ledger::new(400);
    let (to_filter, filter) = channel::<Box<common::Token>>();
    let (to_end, end) = channel();
    thread::scope(|scope| {
        for part in 0..4 {
            let (filter, to_end, ledger, to_filter) =
                (filter.clone(), to_end.clone(), &ledger, to_filter.clone());
            scope.spawn(move || {
                block_on(async {
                    while let Ok(token) = filter.recv().await {
                        let (_never, other) = channel::<()>();
                        alt! {
                            sent = to_end.send(token) => assert!(sent.is_ok()),
                            _ = other.recv() => unreachable!(),
                        }
                    }
                })
            });
            scope.spawn(move || {
                for n in 0..100 {
                    let token = Box::new(ledger.token(100 * part + n));
                    assert!(to_filter.blocking_send(token).is_ok());
                }
            });
        }
        drop((filter, to_filter, to_end));
        let ids: HashSet<_> = std::iter::from_fn(|| end.blocking_recv().ok())
            .map(|token| token.id)
            .collect();
        assert_eq!(ids.len(), 400);
    });
    ledger.assert_all_dropped_once();
}

/// Go: `test/chan/doubleselect.go`. A counter is offered to four processes at once, which pass on
/// what they get: no number comes twice, and none is missing.
#[test]
fn no_two_guards_of_one_alternative_happen() {
    let _watchdog = Watchdog::new();
    let (out, all) = channel();
    let mut senders = Vec::new();
    for _ in 0..4 {
        let (sender, receiver) = channel::<usize>();
        senders.push(sender);
        let out = out.clone();
        thread::spawn(move || {
            while let Ok(n) = receiver.blocking_recv() {
                out.blocking_send(n).unwrap();
            }
        });
    }
    drop(out);
    let counter = thread::spawn(move || {
        block_on(async {
            for n in 0..3_000 {
                alt! {
                    sent = senders[0].send(n) => sent.unwrap(),
                    sent = senders[1].send(n) => sent.unwrap(),
                    sent = senders[2].send(n) => sent.unwrap(),
                    sent = senders[3].send(n) => sent.unwrap(),
                }
            }
        })
    });
    let mut seen = HashSet::new();
    while let Ok(n) = all.blocking_recv() {
        assert!(seen.insert(n), "{n} came twice");
    }
    assert_eq!(seen.len(), 3_000);
    counter.join().unwrap();
}

/// Go: `test/chan/select3.go`. What is and is not ready, case by case. A nil channel there is a
/// false precondition here.
#[test]
fn what_is_ready_case_by_case() {
    let never = || channel::<u8>();
    let (_s, r) = never();
    let (s, _r) = never();
    assert_eq!(
        block_on(async {
            alt! { skip => 1 }
        }),
        1
    );
    assert_eq!(
        block_on(async {
            alt! { _ = r.recv(), if false => 0, skip => 1 }
        }),
        1
    );
    assert_eq!(
        block_on(async {
            alt! { _ = s.send(7), if false => 0, skip => 1 }
        }),
        1
    );
    pending(&mut Box::pin(async {
        alt! { _ = r.recv(), if false => {}, _ = s.send(7), if false => {} }
    }));
    pending(&mut Box::pin(async {
        alt! { _ = r.recv() => {} }
    }));
    pending(&mut Box::pin(async {
        alt! { _ = s.send(7) => {} }
    }));
    // Room in a buffer, and a value in it.
    let (s, r) = buffered(Buffer::fifo(1));
    block_on(async {
        alt! { sent = s.send(7) => sent.unwrap(), skip => unreachable!() }
    });
    let value = block_on(async {
        alt! { value = r.recv() => value, skip => unreachable!() }
    });
    assert_eq!(value, Ok(7));
    // Ended: as the plain operation, again and again.
    drop(s);
    for _ in 0..10 {
        assert_eq!(
            block_on(async {
                alt! { value = r.recv() => value }
            }),
            Err(RecvError::Closed)
        );
    }
    let (s, r) = never();
    drop(r);
    assert!(
        block_on(async {
            alt! { sent = s.send(7) => sent }
        })
        .unwrap_err()
        .is_closed()
    );
    // It does not meet itself.
    let (s, r) = never();
    pending(&mut Box::pin(async {
        alt! { _ = s.send(1) => {}, _ = r.recv() => {} }
    }));
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

/// Go: `test/chan/fifo.go`. A chain of processes each of which waits for its turn: first come,
/// first served.
#[test]
fn values_come_out_in_the_order_in_which_their_senders_came() {
    let (sender, receiver) = channel();
    let mut sends: Vec<_> = (0..50).map(|n| Box::pin(sender.send(n))).collect();
    sends.iter_mut().for_each(pending);
    let (_never, other) = channel();
    for n in 0..50 {
        let value = block_on(async {
            alt! { value = other.recv() => value, value = receiver.recv() => value }
        });
        assert_eq!(value, Ok(n));
    }
}

/// Go: `test/chan/nonblock.go`. A non-blocking send and receive find a partner that waits, of
/// values of several sizes; `test/chan/zerosize.go`.
#[test]
fn values_of_any_size_find_the_one_that_waits() {
    fn one<T: Send + Clone + PartialEq + std::fmt::Debug>(value: T) {
        let (sender, receiver) = channel();
        let mut recv = Box::pin(receiver.recv());
        pending(&mut recv);
        sender.try_send(value.clone()).unwrap();
        assert_eq!(ready(&mut recv), Ok(value.clone()));
        let mut send = Box::pin(sender.send(value.clone()));
        pending(&mut send);
        let received = block_on(async {
            pri_alt! { value = receiver.recv() => value.unwrap(), skip => unreachable!() }
        });
        assert_eq!((received, ready(&mut send)), (value, Ok(())));
    }
    one(());
    one(7_u8);
    one([1_u64; 100]);
    one(String::from("seven"));
    one(Arc::new([3_u16; 3]));
}

/// Go: `test/chan/goroutines.go`. A chain of many processes, each of which adds one.
#[test]
fn a_long_chain() {
    let (first, mut last) = channel::<u32>();
    let mut chain: Vec<std::pin::Pin<Box<dyn Future<Output = ()>>>> = Vec::new();
    for _ in 0..1_000 {
        let (to, next) = channel();
        let from = std::mem::replace(&mut last, next);
        chain.push(Box::pin(async move {
            while let Ok(n) = from.recv().await {
                to.send(n + 1).await.unwrap();
            }
        }));
    }
    let executor = async_executor::LocalExecutor::new();
    chain
        .into_iter()
        .for_each(|link| executor.spawn(link).detach());
    let received = block_on(executor.run(async {
        first.send(0).await.unwrap();
        drop(first);
        (last.recv().await, last.recv().await)
    }));
    assert_eq!(received, (Ok(1_000), Err(RecvError::Closed)));
}

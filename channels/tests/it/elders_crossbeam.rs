//! Situations that crossbeam-channel's own suites of selection cover (`select.rs`,
//! `select_macro.rs`, `same_channel.rs`, `ready.rs`), in tests of our own. Each says which one it
//! is in crossbeam.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Watchdog, pending, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, Receiver, RecvError, Sender, TryRecvError, after, alt, at, buffered, channel, pri_alt,
};
use luna_platform::clock::Instant;
use std::any::Any;
use std::sync::Barrier;
use std::thread;
use std::time::Duration;

fn unbounded<T: Send>() -> (Sender<T>, Receiver<T>) {
    buffered(Buffer::allocating_unbounded())
}

/// crossbeam: `smoke1`, `smoke2`. The one of five that has something.
#[test]
fn the_one_that_has_something() {
    let [(s1, r1), (s2, r2), (_s3, r3), (_s4, r4), (s5, r5)] = [(); 5].map(|()| unbounded());
    let choose = || {
        block_on(async {
            alt! {
                value = r1.recv() => (1, value),
                value = r2.recv() => (2, value),
                value = r3.recv() => (3, value),
                value = r4.recv() => (4, value),
                value = r5.recv() => (5, value),
            }
        })
    };
    for (n, sender) in [(5, &s5), (1, &s1), (2, &s2), (1, &s1)] {
        sender.try_send(10 * n).unwrap();
        assert_eq!(choose(), (n, Ok(10 * n)));
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

/// crossbeam: `disconnected`, its last part, and `unblocks`. What comes, or ends, while it waits in
/// another thread wakes it.
#[test]
fn what_comes_while_it_waits_wakes_it() {
    let _watchdog = Watchdog::new();
    for what in 0..3 {
        let ((s1, r1), (s2, r2)) = (channel::<u8>(), channel::<u8>());
        let waits = Barrier::new(2);
        thread::scope(|scope| {
            let (s1, s2, r1, r2, waits) = (&s1, &s2, &r1, &r2, &waits);
            let chooser = scope.spawn(move || {
                let mut alternative = Box::pin(async move {
                    alt! {
                        value = r1.recv() => (1, value.ok()),
                        sent = s2.send(7) => (2, sent.ok().map(|()| 0)),
                    }
                });
                pending(&mut alternative);
                waits.wait();
                block_on(alternative)
            });
            waits.wait();
            let expected = match what {
                0 => {
                    s1.blocking_send(5).unwrap();
                    (1, Some(5))
                }
                1 => {
                    assert_eq!(r2.blocking_recv(), Ok(7));
                    (2, Some(0))
                }
                _ => {
                    s1.poison();
                    (1, None)
                }
            };
            assert_eq!(chooser.join().unwrap(), expected);
        });
    }
}

/// crossbeam: `timeout`, `default_only`. A timeout comes when nothing else does, not before its
/// time, and what comes later is still received.
#[test]
fn a_timeout_and_what_comes_after_it() {
    let _watchdog = Watchdog::new();
    luna_core::block_on(async {
        let ((_s1, r1), (s2, r2)) = (channel::<u8>(), channel::<u8>());
        let start = Instant::now();
        let delay = Duration::from_millis(3);
        let late = alt! {
            _ = r1.recv() => false,
            _ = r2.recv() => false,
            _ = at(start + delay) => true,
        };
        assert!(late && Instant::now() >= start + delay);
        let thread = thread::spawn(move || s2.blocking_send(2));
        let value = alt! {
            value = r1.recv() => value,
            value = r2.recv() => value,
        };
        assert_eq!(value, Ok(2));
        thread.join().unwrap().unwrap();
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

/// crossbeam: `cloning1`, `cloning2`. An end that is cloned and dropped while an alternative waits
/// changes nothing.
#[test]
fn a_clone_that_goes_is_no_end() {
    let ((s1, r1), (s2, r2)) = (unbounded::<u8>(), unbounded::<u8>());
    let mut waits = Box::pin(async {
        alt! {
            value = r1.recv() => (1, value),
            value = r2.recv() => (2, value),
        }
    });
    pending(&mut waits);
    drop(s1.clone());
    drop(r1.clone());
    pending(&mut waits);
    s2.try_send(5).unwrap();
    assert_eq!(ready(&mut waits), (2, Ok(5)));
}

/// crossbeam: `preflight1` to `preflight3`. What was sent before the end is received before the
/// end.
#[test]
fn what_was_sent_before_the_end_comes_before_the_end() {
    let (sender, receiver) = unbounded();
    drop(sender.clone());
    sender.try_send(1).unwrap();
    drop(sender);
    let choose = || {
        block_on(async {
            alt! { value = receiver.recv() => value }
        })
    };
    assert_eq!(
        [choose(), choose(), choose()],
        [Ok(1), Err(RecvError::Closed), Err(RecvError::Closed)]
    );
    let (sender, receiver) = channel::<u8>();
    drop(sender);
    assert_eq!(
        block_on(async {
            alt! { value = receiver.recv() => value, skip => Ok(0) }
        }),
        Err(RecvError::Closed)
    );
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

/// crossbeam: `stress_mixed`, `stress_timeout`. A sends on one, B receives on another, the
/// alternative does both; and with a delay that comes again and again.
#[test]
fn mixed_and_with_delays_in_a_loop() {
    let _watchdog = Watchdog::new();
    let ((s1, r1), (s2, r2)) = (channel(), channel());
    let thread = thread::spawn(move || {
        for n in 0..1_000 {
            s1.blocking_send(n).unwrap();
            assert_eq!(r2.blocking_recv(), Ok(n));
        }
    });
    luna_core::block_on(async {
        for n in 0..1_000 {
            for _ in 0..2 {
                loop {
                    alt! {
                        value = r1.recv() => break assert_eq!(value, Ok(n)),
                        sent = s2.send(n) => break sent.unwrap(),
                        _ = after(Duration::from_micros(50)) => {}
                    }
                }
            }
        }
    })
    .unwrap();
    thread.join().unwrap();
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

/// crossbeam: `linearizable_try`, `linearizable_timeout`. One of two is ready at any time: neither
/// `skip` nor a delay that has passed is chosen. (A fair alternative takes a delay that has passed,
/// so the second is a `pri_alt`.)
#[test]
fn neither_skip_nor_a_passed_delay_while_something_is_ready() {
    let _watchdog = Watchdog::new();
    for growing in [false, true] {
        let make = || {
            if growing {
                unbounded()
            } else {
                buffered(Buffer::fifo(1))
            }
        };
        let ((s1, r1), (s2, r2)) = (make(), make());
        let (start, end) = (Barrier::new(2), Barrier::new(2));
        let past = Instant::now();
        thread::scope(|scope| {
            scope.spawn(|| {
                for n in 0..1_000 {
                    s1.try_send(1).unwrap();
                    start.wait();
                    let chosen = block_on(async {
                        if n % 2 == 0 {
                            alt! { v = r1.recv() => v, v = r2.recv() => v, skip => Err(RecvError::Closed) }
                        } else {
                            pri_alt! { v = r1.recv() => v, v = r2.recv() => v, _ = at(past) => Err(RecvError::Closed) }
                        }
                    });
                    assert_eq!(chosen, Ok(1));
                    end.wait();
                    while r1.try_recv().is_ok() {}
                    while r2.try_recv().is_ok() {}
                }
            });
            for _ in 0..1_000 {
                start.wait();
                s2.try_send(1).unwrap();
                let _ = r1.try_recv();
                end.wait();
            }
        });
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

/// crossbeam: `unfairness` of `select_biased!`. By priority the first that is ready, each time; and
/// the next when it is empty.
#[test]
fn by_priority_the_first_until_it_is_empty() {
    let [(s1, r1), (s2, r2), (s3, r3)] = [(); 3].map(|()| unbounded());
    for sender in [&s1, &s2, &s3] {
        (0..10).for_each(|_| sender.try_send(()).unwrap());
    }
    let order: Vec<_> = (0..30)
        .map(|_| {
            block_on(async {
                pri_alt! { _ = r1.recv() => 1, _ = r2.recv() => 2, _ = r3.recv() => 3 }
            })
        })
        .collect();
    assert_eq!(order, [[1; 10], [2; 10], [3; 10]].concat());
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

/// crossbeam: `reuse`, `both_ready`. The same guards, again and again, one that receives and one
/// that sends, against a partner that waits for each in an order of its own.
#[test]
fn again_and_again() {
    let _watchdog = Watchdog::new();
    let ((s1, r1), (s2, r2), (s3, r3)) = (channel(), channel(), buffered(Buffer::fifo(100)));
    let thread = thread::spawn(move || {
        for n in 0..1_000 {
            s1.blocking_send(n).unwrap();
            assert_eq!(r2.blocking_recv(), Ok(n));
            r3.blocking_recv().unwrap();
        }
    });
    block_on(async {
        for n in 0..1_000 {
            for _ in 0..2 {
                alt! { value = r1.recv() => assert_eq!(value, Ok(n)), sent = s2.send(n) => sent.unwrap() }
            }
            s3.send(()).await.unwrap();
        }
    });
    thread.join().unwrap();
}

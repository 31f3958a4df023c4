//! Alternatives alone: preconditions, skip, STOP, delays, many guards, ended channels, priorities,
//! failed branches, and being dropped.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Watchdog, pending, poll, ready};
use futures_lite::future::block_on;
use luna_channels::{
    Buffer, RecvError, TryRecvError, after, alt, at, buffered, channel, inspect, pri_alt,
};
use luna_core::current;
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::clock::Instant;
use luna_platform::thread::Attributes;
use std::cell::Cell;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

#[test]
fn a_guard_whose_precondition_is_false_is_not_even_evaluated() {
    let (sender, receiver) = buffered(Buffer::fifo(1));
    let (evaluated, none) = (Cell::new(0), None::<u8>);
    let guard = || {
        evaluated.set(evaluated.get() + 1);
        receiver.recv()
    };
    sender.try_send(1).unwrap();
    let chosen = block_on(async {
        pri_alt! {
            sent = sender.send(none.unwrap()), if none.is_some() => unreachable!("{sent:?}"),
            value = guard(), if false => unreachable!("{value:?}"),
            value = guard() => value,
        }
    });
    assert_eq!((chosen, evaluated.get()), (Ok(1), 1));
}

#[test]
fn with_no_guard_open_it_is_stop_or_skips() {
    let (_sender, receiver) = channel::<u8>();
    let mut stop = Box::pin(async {
        alt! {
            value = receiver.recv(), if false => unreachable!("{value:?}"),
        }
    });
    pending(&mut stop);
    receiver.poison();
    pending(&mut stop);
    let skipped = block_on(async {
        alt! {
            value = receiver.recv(), if false => unreachable!("{value:?}"),
            skip => 1,
        }
    });
    assert_eq!(skipped, 1);
}

#[test]
fn skip_leaves_no_trace() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    let (two, from_two) = channel::<u8>();
    let skipped = block_on(async {
        pri_alt! {
            sent = sender.send(ledger.token(0)) => unreachable!("{sent:?}"),
            value = from_two.recv() => unreachable!("{value:?}"),
            skip => true,
        }
    });
    assert!(skipped);
    ledger.assert_all_dropped_once();
    assert_eq!(receiver.try_recv().unwrap_err(), TryRecvError::Empty);
    assert!(two.try_send(1).unwrap_err().is_full());
}

#[test]
fn delays_and_deadlines() {
    let _watchdog = Watchdog::new();
    luna_core::block_on(async {
        let (sender, receiver) = channel::<u8>();
        // The earliest comes first, whatever the order; none comes early.
        let start = Instant::now();
        let (short, long) = (Duration::from_millis(5), Duration::from_secs(3600));
        let chosen = alt! {
            _ = after(long) => 1,
            value = receiver.recv() => unreachable!("{value:?}"),
            _ = at(start + short) => 2,
            _ = after(long) => 3,
        };
        assert_eq!(chosen, 2);
        assert!(Instant::now() >= start + short);
        // One that has passed is ready: `skip` is not taken, and a lower guard only in a `pri_alt`.
        let passed = pri_alt! {
            _ = at(start) => true,
            skip => false,
        };
        assert!(passed);
        // A delay alone.
        alt! { _ = after(Duration::from_millis(1)) => {} }
        // What waits is withdrawn with it.
        assert!(sender.try_send(1).unwrap_err().is_full());
        // By preference: the channel before the time, both ready.
        let (full, from_full) = buffered(Buffer::fifo(1));
        full.try_send(7).unwrap();
        let chosen = pri_alt! {
            value = from_full.recv() => value,
            _ = at(start) => unreachable!(),
        };
        assert_eq!(chosen, Ok(7));
    })
    .unwrap();
}

#[test]
fn a_delay_against_a_partner_on_another_thread_loses_nothing() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel::<u32>();
    let thread = thread::spawn(move || {
        let mut sent = 0;
        while sender.blocking_send(1).is_ok() {
            sent += 1;
        }
        sent
    });
    luna_core::block_on(async {
        let mut received = 0;
        for _ in 0..500 {
            pri_alt! {
                _ = after(Duration::from_micros(20)) => {}
                value = receiver.recv() => received += value.unwrap(),
            }
        }
        drop(receiver);
        assert_eq!(thread.join().unwrap(), received);
    })
    .unwrap();
}

/// Thirty-two guards, and the last is chosen; one more does not compile (see the macro's
/// documentation).
#[test]
fn thirty_two_guards() {
    let ends: Vec<_> = (0..31).map(|_| channel::<usize>()).collect();
    let (last, out) = channel();
    let offer = || {
        Box::pin(async {
            let r = |n: usize| ends[n].1.recv();
            alt! {
                v = r(0) => v, v = r(1) => v, v = r(2) => v, v = r(3) => v, v = r(4) => v, v = r(5) => v,
                v = r(6) => v, v = r(7) => v, v = r(8) => v, v = r(9) => v, v = r(10) => v, v = r(11) => v,
                v = r(12) => v, v = r(13) => v, v = r(14) => v, v = r(15) => v, v = r(16) => v, v = r(17) => v,
                v = r(18) => v, v = r(19) => v, v = r(20) => v, v = r(21) => v, v = r(22) => v, v = r(23) => v,
                v = r(24) => v, v = r(25) => v, v = r(26) => v, v = r(27) => v, v = r(28) => v, v = r(29) => v,
                v = r(30) => v,
                sent = last.send(31) => sent.map(|()| 31).map_err(|_| RecvError::Closed),
            }
        })
    };
    for (n, (sender, _)) in ends.iter().enumerate() {
        let mut alternative = offer();
        pending(&mut alternative);
        assert_eq!(sender.try_send(n), Ok(()));
        assert_eq!(ready(&mut alternative), Ok(n));
    }
    let mut alternative = offer();
    pending(&mut alternative);
    assert_eq!(out.try_recv(), Ok(31));
    assert_eq!(ready(&mut alternative), Ok(31));
    for (sender, _) in &ends {
        assert!(sender.try_send(0).unwrap_err().is_full());
    }
}

#[test]
fn rendezvous_and_buffers_in_one() {
    let (meet, from_meet) = channel();
    let (fill, from_fifo) = buffered(Buffer::fifo(2));
    let (grow, from_grow) = buffered(Buffer::allocating_unbounded());
    let choose = || {
        Box::pin(async {
            pri_alt! {
                value = from_meet.recv() => value.map(|value| ("meet", value)),
                value = from_fifo.recv() => value.map(|value| ("fifo", value)),
                value = from_grow.recv() => value.map(|value| ("grow", value)),
            }
        })
    };
    grow.try_send(1).unwrap();
    fill.try_send(2).unwrap();
    let mut send = Box::pin(meet.send(3));
    pending(&mut send);
    assert_eq!(ready(&mut choose()), Ok(("meet", 3)));
    assert_eq!(ready(&mut choose()), Ok(("fifo", 2)));
    assert_eq!(ready(&mut choose()), Ok(("grow", 1)));
    let mut waits = choose();
    pending(&mut waits);
    fill.try_send(4).unwrap();
    assert_eq!(
        (ready(&mut waits), from_fifo.buffered()),
        (Ok(("fifo", 4)), 0)
    );
    // An output guard of a full buffer waits for room.
    fill.try_send(5).unwrap();
    fill.try_send(6).unwrap();
    let mut waits = Box::pin(async {
        alt! {
            sent = fill.send(7) => sent.is_ok(),
            value = from_meet.recv() => value.is_err(),
        }
    });
    pending(&mut waits);
    assert_eq!(from_fifo.try_recv(), Ok(5));
    assert!(ready(&mut waits));
    assert_eq!([(); 2].map(|()| from_fifo.try_recv().unwrap()), [6, 7]);
}

#[test]
fn an_unbounded_buffer_never_makes_its_sender_wait() {
    let ledger = Ledger::new(1_000);
    let (sender, receiver) = buffered(Buffer::allocating_unbounded());
    for id in 0..500 {
        assert!(ready(&mut Box::pin(sender.send(ledger.token(id)))).is_ok());
    }
    for id in 500..1_000 {
        block_on(async {
            pri_alt! {
                sent = sender.send(ledger.token(id)) => assert!(sent.is_ok()),
                skip => unreachable!(),
            }
        });
    }
    assert_eq!(receiver.buffered(), 1_000);
    for id in 0..900 {
        assert_eq!(receiver.try_recv().unwrap().id, id);
    }
    drop(sender);
    assert_eq!(block_on(receiver.recv()).unwrap().id, 900);
    drop(receiver);
    ledger.assert_all_dropped_once();
}

#[test]
fn ended_and_poisoned_channels_are_ready_with_their_error() {
    for waits in [false, true] {
        let ((one, from_one), (two, from_two)) = (channel::<u8>(), channel::<u8>());
        let mut alternative = Box::pin(async {
            pri_alt! {
                value = from_one.recv() => value,
                value = from_two.recv() => value,
            }
        });
        if waits {
            pending(&mut alternative);
        }
        two.poison();
        drop(one);
        // Waiting: what happened first. Else what is written first.
        let expected = if waits {
            RecvError::Poisoned
        } else {
            RecvError::Closed
        };
        assert_eq!(ready(&mut alternative), Err(expected));
    }
}

#[test]
fn a_failed_branch_fails_its_alternative_unless_that_has_communicated() {
    let ((one, from_one), (_two, from_two)) = (channel::<u8>(), channel::<u8>());
    let choose = || {
        Box::pin(async {
            alt! {
                value = from_two.recv(), if false => (0, value),
                value = from_one.recv() => (1, value),
                value = from_two.recv() => (2, value),
                skip => (3, Ok(0)),
            }
        })
    };
    let waiting = || {
        Box::pin(async {
            alt! {
                value = from_one.recv() => (1, value),
                value = from_two.recv() => (2, value),
            }
        })
    };
    fn failed<T>(mut future: Pin<Box<impl Future<Output = T>>>) -> T {
        current::with_branch_below(true, 0, 0, || ready(&mut future))
    }
    // New, and while it waits: the first open guard fails, and nothing is taken.
    let mut send = Box::pin(one.send(5));
    pending(&mut send);
    assert_eq!(failed(choose()), (1, Err(RecvError::Poisoned)));
    pending(&mut send);
    drop(send);
    let mut waits = waiting();
    pending(&mut waits);
    assert_eq!(failed(waits), (1, Err(RecvError::Poisoned)));
    assert!(one.try_send(1).unwrap_err().is_full(), "withdrawn");
    // Chosen before: it has communicated.
    let mut waits = waiting();
    pending(&mut waits);
    one.try_send(6).unwrap();
    assert_eq!(failed(waits), (1, Ok(6)));
    // One of delays alone cannot fail; it ends by itself.
    luna_core::block_on(async {
        let mut delay = Box::pin(async {
            alt! { _ = after(Duration::from_millis(1)) => 1 }
        });
        let late = std::future::poll_fn(|cx| {
            current::with_branch_below(true, 0, 0, || delay.as_mut().poll(cx))
        });
        assert_eq!(late.await, 1);
    })
    .unwrap();
}

#[test]
fn dropped_at_any_await_nothing_is_lost_and_nothing_doubled() {
    // How far it gets before it is dropped: not polled; waiting; chosen as receiver; chosen as
    // sender; in its body.
    for stage in 0..5 {
        let ledger = Ledger::new(2);
        let ((one, from_one), (two, from_two)) = (channel(), channel());
        let (never, body) = channel::<u8>();
        let mut alternative = Box::pin(async {
            pri_alt! {
                token = from_one.recv() => { let _token = token; let _ = body.recv().await; }
                sent = two.send(ledger.token(1)) => { sent.unwrap(); let _ = body.recv().await; }
            }
        });
        if stage > 0 {
            pending(&mut alternative);
        }
        let mut taken = None;
        match stage {
            2 | 4 => assert!(one.try_send(ledger.token(0)).is_ok()),
            3 => taken = from_two.try_recv().ok(),
            _ => {}
        }
        if stage == 4 {
            pending(&mut alternative);
        }
        drop(alternative);
        let back = from_one.try_recv();
        assert_eq!(back.is_ok(), stage == 2, "it goes back to the head");
        assert_eq!(taken.is_some(), stage == 3, "what was sent stays sent");
        assert_eq!(ledger.drops(1), usize::from(!matches!(stage, 0 | 3)));
        assert_eq!(ledger.drops(0), usize::from(stage == 4));
        assert!(from_two.try_recv().is_err() && one.try_send(ledger.token(0)).is_err());
        assert!(never.try_send(0).unwrap_err().is_full());
    }
}

#[test]
fn a_value_that_comes_back_goes_to_the_alternative_that_waits_next() {
    let (sender, receiver) = channel();
    let (_never, other) = channel::<u8>();
    let choose = || {
        Box::pin(async {
            alt! {
                value = receiver.recv() => value,
                value = other.recv() => value,
            }
        })
    };
    let (mut first, mut second) = (choose(), choose());
    pending(&mut first);
    pending(&mut second);
    sender.try_send(3).unwrap();
    drop(first);
    assert_eq!(ready(&mut second), Ok(3));
    assert_eq!(receiver.try_recv(), Err(TryRecvError::Empty));
}

#[test]
fn among_alternatives_the_more_urgent_is_served_first() {
    let _watchdog = Watchdog::new();
    let executor = Executor::start(Attributes::new("urgent")).unwrap();
    let (sender, receiver) = channel::<u8>();
    let (_never, other) = channel::<u8>();
    let log = Arc::new(Mutex::new(Vec::new()));
    let mut processes = Vec::new();
    for level in [2, 9, 5] {
        let (receiver, other, log) = (receiver.clone(), other.clone(), log.clone());
        let spec = ProcessSpec::new(format!("at {level}")).level(level);
        processes.push(executor.spawn(spec, move || async move {
            alt! {
                value = other.recv() => unreachable!("{value:?}"),
                value = receiver.recv() => value.unwrap(),
            };
            log.lock().unwrap().push(level);
        }));
    }
    // The lowest: it runs when all of them wait.
    processes.push(
        executor.spawn(ProcessSpec::new("sends").level(0), move || async move {
            for n in 0..3 {
                sender.send(n).await.unwrap();
            }
        }),
    );
    executor.settle();
    executor.release();
    for process in &processes {
        assert_eq!(process.wait(), Exit::Completed, "{}", process.name());
    }
    assert_eq!(*log.lock().unwrap(), [9, 5, 2]);
}

#[test]
fn bodies_may_use_what_guards_borrowed_and_leave_the_function() {
    async fn first_even(from: &luna_channels::Receiver<u32>) -> Result<u32, RecvError> {
        let mut odd = 0;
        loop {
            alt! {
                value = from.recv() => {
                    let value = value?;
                    if value % 2 == 0 {
                        return Ok(value + odd);
                    }
                    odd += 1;
                    let _ = from.try_recv().map(|_| odd += 100);
                    continue;
                }
            }
        }
    }
    let (sender, receiver) = buffered(Buffer::fifo(4));
    for n in [1, 3, 8] {
        sender.try_send(n).unwrap();
    }
    assert_eq!(block_on(first_even(&receiver)), Ok(109));
    drop(sender);
    assert_eq!(block_on(first_even(&receiver)), Err(RecvError::Closed));
}

#[test]
fn nothing_is_left_of_it_for_a_report() {
    let (sender, receiver) = channel::<u8>();
    let sender = sender.named("of an alternative that goes");
    let count = || {
        let places = inspect::wait_points();
        let mut places = places.iter();
        let place =
            places.find(|place| place.name.as_deref() == Some("of an alternative that goes"));
        place.unwrap().waiting.len()
    };
    let mut both = Box::pin(async {
        alt! {
            _ = receiver.recv() => {}
            _ = sender.send(1) => {}
            _ = sender.send_from(&mut Some(1)) => {}
        }
    });
    assert_eq!(count(), 0);
    assert!(poll(&mut both).is_pending());
    assert_eq!(count(), 3);
    drop(both);
    assert_eq!(count(), 0);
}

#[test]
fn an_alternative_without_an_open_guard_is_reported_as_stop() {
    let stage = Executor::start(Attributes::new("stage")).unwrap();
    let (_sender, receiver) = channel::<u32>();
    let stops = stage.spawn(ProcessSpec::new("stops").level(2), move || async move {
        alt! {
            value = receiver.recv(), if receiver.buffered() > 0 => panic!("{value:?}"),
        }
    });
    let (stopped, other) = (stops.id(), stops.clone());
    let looks = stage.spawn(ProcessSpec::new("looks").level(1), move || async move {
        let points = inspect::wait_points();
        let waiting = points
            .iter()
            .filter(|point| point.kind == inspect::WaitPointKind::Stop);
        let mut users = waiting.flat_map(|point| &point.waiting).map(|one| one.user);
        let is_there = users.any(|user| user == current::User::Process(stopped));
        other.cancel();
        assert!(is_there);
    });
    stage.release();
    assert_eq!(
        (looks.wait(), stops.wait()),
        (Exit::Completed, Exit::Cancelled)
    );
}

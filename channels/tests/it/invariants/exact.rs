//! Invariants 8 and 9: a choice happens at one instant, and by priority it is exact, also across
//! cores.

use super::common::{Wakes, Watchdog, pending, poll, poll_with, ready};
use super::either;
use futures_lite::future::block_on;
use luna_channels::{Buffer, RecvError, Sender, alt, at, buffered, channel, pri_alt};
use luna_platform::clock::Instant;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Barrier, Mutex};
use std::thread;

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn invariant_8_a_non_blocking_choice_happens_at_one_instant() {
    let _watchdog = Watchdog::new();
    // One of the two is ready at any time: a look that were spread over time could miss both, and
    // take `skip` or a delay that has passed. (A fair alternative takes such a delay.)
    for growing in [false, true] {
        let make = || {
            if growing {
                buffered(Buffer::allocating_unbounded())
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

#[test]
fn invariant_9_pri_alt_is_exact_when_its_guards_become_ready_as_they_are_evaluated() {
    let ((one, from_one), (two, from_two)) = (channel(), channel());
    let sends = Mutex::new(Vec::new());
    let park = |sender: &Sender<u8>, value| {
        let sender = sender.clone();
        let mut send = Box::pin(async move { sender.send(value).await });
        pending(&mut send);
        sends.lock().unwrap().push(send);
    };
    // Guard 1 has been evaluated, and was not ready; a sender parks on channel 1, then another on
    // channel 2; guard 2 is evaluated.
    let taken = block_on(async {
        pri_alt! {
            value = from_one.recv() => value,
            value = { park(&one, 1); park(&two, 2); from_two.recv() } => value,
        }
    });
    assert_eq!(taken, Ok(1));
}

#[test]
#[cfg_attr(luna_one_cpu, ignore = "needs threads")]
fn invariant_9_pri_alt_is_exact_across_cores() {
    let _watchdog = Watchdog::new();
    // Parked on 1 strictly before on 2: whatever the instant of the choice, 2 is never taken. In
    // both orders of the channels' addresses.
    let taken = AtomicUsize::new(0);
    for round in 0..3_000 {
        let (mut a, mut b) = (channel(), channel());
        if round % 2 == 1 {
            std::mem::swap(&mut a, &mut b);
        }
        let ((one, from_one), (two, from_two)) = (a, b);
        let start = Barrier::new(2);
        thread::scope(|scope| {
            scope.spawn(|| {
                start.wait();
                let chosen = block_on(async {
                    if round % 3 == 0 {
                        either(&from_one, &from_two).await.0
                    } else {
                        pri_alt! {
                            value = from_one.recv() => { value.unwrap(); 1 }
                            value = from_two.recv() => { value.unwrap(); 2 }
                            skip => 0,
                        }
                    }
                });
                assert_ne!(chosen, 2, "round {round}");
                taken.fetch_add(usize::from(chosen), Ordering::Relaxed);
            });
            let mut first = Box::pin(one.send(1));
            let mut second = Box::pin(two.send(2));
            start.wait();
            let at_once = poll(&mut first).is_ready();
            // One that was served at once by a waiting alternative leaves it none for the second.
            pending(&mut second);
            if !at_once && round % 3 == 0 {
                assert_eq!(block_on(first), Ok(()));
            }
        });
    }
    assert!(taken.into_inner() >= 1_000, "each that waits takes one");
}

#[test]
fn invariant_9_a_partner_wakes_the_alternative_once() {
    let ((one, from_one), (two, from_two)) = (channel(), channel());
    let (wakes, waker) = Wakes::new();
    let mut alternative = Box::pin(either(&from_one, &from_two));
    assert!(poll_with(&mut alternative, &waker).is_pending());
    assert!(two.try_send(2).is_ok() && one.try_send(1).is_err());
    assert_eq!(wakes.count(), 1);
    assert_eq!(ready(&mut alternative), (2, Ok(2)));
}

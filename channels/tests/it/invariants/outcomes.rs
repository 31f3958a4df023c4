//! Invariants 1 and 2: no thread waits for another to get somewhere, and what was communicated
//! stays communicated.

use super::common::{Watchdog, pending, ready};
use super::either;
use luna_channels::{Receiver, Sender, alt, at, channel, pri_alt};
use luna_core::current;
use luna_platform::clock::Instant;
use std::future::Future;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

#[test]
fn invariant_1_nobody_waits_for_another_to_leave_an_intermediate_state() {
    let _watchdog = Watchdog::new();
    // An alternative that was chosen, or has been left without an offer, and does not run: as if
    // its thread were preempted there.
    let ((one, from_one), (two, from_two)) = (channel(), channel());
    let mut preempted = Box::pin(either(&from_one, &from_two));
    pending(&mut preempted);
    assert_eq!(one.try_send(10), Ok(()));
    // Its offer on the second channel is stale. No operation that comes there waits for it: each
    // poll below ends at once.
    assert!(two.try_send(20).unwrap_err().is_full());
    let mut behind = Box::pin(from_two.recv());
    pending(&mut behind);
    assert_eq!(two.try_send(21), Ok(()));
    assert_eq!(ready(&mut behind), Ok(21));
    let mut other = Box::pin(either(&from_one, &from_two));
    pending(&mut other);
    let mut opposite = Box::pin(async {
        pri_alt! {
            sent = two.send(22) => sent,
            sent = one.send(11) => sent,
        }
    });
    assert_eq!(ready(&mut opposite), Ok(()));
    assert_eq!(ready(&mut other), (2, Ok(22)));
    assert_eq!(ready(&mut preempted), (1, Ok(10)));
}

#[test]
fn invariant_1_a_stale_node_costs_whichever_finds_it_one_step_and_hides_nobody() {
    let _watchdog = Watchdog::new();
    let ((one, from_one), (two, from_two)) = (channel(), channel());
    // Many that were chosen on the first channel and have not run since; behind them on the second
    // one an operation that really waits.
    let mut stale: Vec<_> = (0..100)
        .map(|_| Box::pin(either(&from_one, &from_two)))
        .collect();
    stale.iter_mut().for_each(pending);
    let mut waits = Box::pin(from_two.recv());
    pending(&mut waits);
    for n in 0..100 {
        assert_eq!(one.try_send(n), Ok(()));
    }
    assert_eq!(two.try_send(1000), Ok(()));
    assert_eq!(ready(&mut waits), Ok(1000));
    for (n, alternative) in stale.iter_mut().enumerate() {
        assert_eq!(ready(alternative), (1, Ok(n)));
    }
}

#[test]
fn invariant_2_what_was_communicated_is_never_reported_as_poisoned_or_closed() {
    type AfterSend = fn(Sender<u32>, &Receiver<u32>);
    let afters: [AfterSend; 3] = [
        |sender, _| sender.poison(),
        |sender, _| drop(sender),
        |_, receiver| receiver.poison(),
    ];
    for after in afters {
        let ((one, from_one), (_two, from_two)) = (channel(), channel());
        let mut alternative = Box::pin(either(&from_one, &from_two));
        pending(&mut alternative);
        one.try_send(1).unwrap();
        after(one, &from_one);
        from_two.poison();
        assert_eq!(ready(&mut alternative), (1, Ok(1)));
    }
    type AfterReceive = fn(&Sender<u32>, Receiver<u32>);
    let afters: [AfterReceive; 3] = [
        |_, receiver| receiver.poison(),
        |_, receiver| drop(receiver),
        |sender, _| sender.poison(),
    ];
    for after in afters {
        let ((one, from_one), (two, _from_two)) = (channel(), channel());
        let mut alternative = Box::pin(async {
            alt! {
                sent = one.send(1) => sent,
                sent = two.send(2) => sent,
            }
        });
        pending(&mut alternative);
        assert_eq!(from_one.try_recv(), Ok(1));
        after(&one, from_one);
        assert_eq!(ready(&mut alternative), Ok(()));
    }
}

#[test]
fn invariant_2_what_was_communicated_is_never_reported_as_cancelled() {
    let _watchdog = Watchdog::new();
    // By a sibling's failure.
    let ((one, from_one), (_two, from_two)) = (channel(), channel());
    let mut alternative = Box::pin(either(&from_one, &from_two));
    pending(&mut alternative);
    one.try_send(1).unwrap();
    let received = current::with_branch_below(true, 0, 0, || ready(&mut alternative));
    assert_eq!(received, (1, Ok(1)));
    // By a deadline that comes before the process runs again.
    luna_core::block_on(async {
        let (sender, receiver) = channel();
        let deadline = Instant::now() + Duration::from_millis(20);
        let alternative = async {
            pri_alt! {
                _ = at(deadline) => None,
                value = receiver.recv() => Some(value),
            }
        };
        let mut alternative = Box::pin(alternative);
        let mut context = Context::from_waker(Waker::noop());
        match alternative.as_mut().poll(&mut context) {
            Poll::Pending => assert_eq!(sender.try_send(5), Ok(())),
            // The machine was so busy that the deadline came first.
            Poll::Ready(late) => return assert_eq!(late, None),
        }
        at(deadline).await;
        assert!(Instant::now() >= deadline);
        assert_eq!(alternative.await, Some(Ok(5)));
    })
    .unwrap();
}

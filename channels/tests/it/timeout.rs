//! Timeouts are exact: an operation times out only if it did not happen, and what happened is never
//! given back.

#![cfg(not(loom))]

use crate::common;
use common::{Ledger, Watchdog, pending, ready};
use luna_channels::{Buffer, RecvTimeoutError, SendTimeoutError, buffered, channel};
use luna_platform::clock::Instant;
use std::thread;
use std::time::Duration;

const SHORT: Duration = Duration::from_millis(2);
const HOUR: Duration = Duration::from_secs(3600);

#[test]
fn blocking_forms_give_up_at_their_time_and_not_before() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel();
    let start = Instant::now();
    assert_eq!(
        sender.blocking_send_timeout(1, SHORT),
        Err(SendTimeoutError::Timeout(1))
    );
    assert!(Instant::now() - start >= SHORT);
    let start = Instant::now();
    assert_eq!(
        receiver.blocking_recv_timeout(SHORT),
        Err(RecvTimeoutError::Timeout)
    );
    assert!(Instant::now() - start >= SHORT);
}

#[test]
fn a_receive_is_given_up_for_something_else_and_takes_what_was_there_before() {
    let (sender, receiver) = channel();
    let (stop, stopped) = channel::<()>();
    let at_once = || std::future::ready(());
    // Both are there: the value comes first.
    let mut send = Box::pin(sender.send(1));
    pending(&mut send);
    assert_eq!(ready(&mut Box::pin(receiver.recv_unless(at_once()))), Ok(1));
    assert_eq!(ready(&mut send), Ok(()));
    // None is: it is given up, and leaves no offer.
    assert_eq!(
        ready(&mut Box::pin(receiver.recv_unless(at_once()))),
        Err(RecvTimeoutError::Timeout)
    );
    assert!(sender.try_send(2).is_err());
    // What ends it may come while it waits, and live longer than one receive.
    let mut over = Box::pin(async {
        let _ = stopped.recv().await;
    });
    {
        let mut receive = Box::pin(receiver.recv_unless(over.as_mut()));
        pending(&mut receive);
        assert!(sender.try_send(3).is_ok());
        assert_eq!(ready(&mut receive), Ok(3));
    }
    let mut receive = Box::pin(receiver.recv_unless(over.as_mut()));
    pending(&mut receive);
    drop(stop);
    assert_eq!(ready(&mut receive), Err(RecvTimeoutError::Timeout));
    drop(receive);
    assert!(sender.try_send(4).is_err());
}

#[test]
fn a_send_is_given_up_for_something_else_and_was_taken_or_withdrawn() {
    let (sender, receiver) = channel();
    let (stop, stopped) = channel::<()>();
    let at_once = || std::future::ready(());
    // A receiver waits for it: to send comes first.
    let mut receive = Box::pin(receiver.recv());
    pending(&mut receive);
    assert_eq!(
        ready(&mut Box::pin(sender.send_unless(1, at_once()))),
        Ok(())
    );
    assert_eq!(ready(&mut receive), Ok(1));
    // No receiver does: it is given up, gives the value back, and leaves none.
    assert_eq!(
        ready(&mut Box::pin(sender.send_unless(2, at_once()))),
        Err(SendTimeoutError::Timeout(2))
    );
    assert!(receiver.try_recv().is_err());
    // What ends it may come while it waits, and live longer than one send.
    let mut over = Box::pin(async {
        let _ = stopped.recv().await;
    });
    {
        let mut send = Box::pin(sender.send_unless(3, over.as_mut()));
        pending(&mut send);
        assert_eq!(receiver.try_recv(), Ok(3));
        assert_eq!(ready(&mut send), Ok(()));
    }
    // Taken before it is given up, and seen afterwards: it has sent.
    let mut send = Box::pin(sender.send_unless(4, over.as_mut()));
    pending(&mut send);
    assert_eq!(receiver.try_recv(), Ok(4));
    drop(stop);
    assert_eq!(ready(&mut send), Ok(()));
    drop(send);
    assert_eq!(
        ready(&mut Box::pin(sender.send_unless(5, over.as_mut()))),
        Err(SendTimeoutError::Timeout(5))
    );
    assert!(receiver.try_recv().is_err());
}

#[test]
fn async_forms_give_up_at_their_time_and_not_before() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel();
    luna_core::block_on(async {
        let start = Instant::now();
        assert_eq!(
            sender.send_timeout(1, SHORT).await,
            Err(SendTimeoutError::Timeout(1))
        );
        assert!(Instant::now() - start >= SHORT);
        let start = Instant::now();
        assert_eq!(
            receiver.recv_timeout(SHORT).await,
            Err(RecvTimeoutError::Timeout)
        );
        assert!(Instant::now() - start >= SHORT);
        let deadline = Instant::now() + SHORT;
        assert_eq!(
            receiver.recv_deadline(deadline).await,
            Err(RecvTimeoutError::Timeout)
        );
        assert!(Instant::now() >= deadline);
        assert_eq!(
            sender.send_deadline(2, deadline).await,
            Err(SendTimeoutError::Timeout(2))
        );
    })
    .unwrap();
}

#[test]
fn what_can_be_done_at_once_is_done_though_the_time_is_over() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = buffered(Buffer::fifo(1));
    luna_core::block_on(async {
        assert_eq!(sender.send_timeout(1, Duration::ZERO).await, Ok(()));
        assert_eq!(receiver.recv_timeout(Duration::ZERO).await, Ok(1));
        assert_eq!(
            receiver.recv_timeout(Duration::ZERO).await,
            Err(RecvTimeoutError::Timeout)
        );
    })
    .unwrap();
    assert_eq!(sender.blocking_send_timeout(2, Duration::ZERO), Ok(()));
    assert_eq!(
        sender.blocking_send_timeout(3, Duration::ZERO),
        Err(SendTimeoutError::Timeout(3))
    );
    assert_eq!(receiver.blocking_recv_timeout(Duration::ZERO), Ok(2));
    assert_eq!(
        receiver.blocking_recv_timeout(Duration::ZERO),
        Err(RecvTimeoutError::Timeout)
    );
}

#[test]
fn a_time_that_never_comes_and_a_partner_that_does() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel();
    thread::scope(|scope| {
        scope.spawn(|| assert_eq!(sender.blocking_send_timeout(1, Duration::MAX), Ok(())));
        assert_eq!(receiver.blocking_recv_timeout(Duration::MAX), Ok(1));
        scope.spawn(|| {
            luna_core::block_on(sender.send_timeout(2, Duration::MAX))
                .unwrap()
                .unwrap()
        });
        assert_eq!(
            luna_core::block_on(receiver.recv_timeout(HOUR)).unwrap(),
            Ok(2)
        );
    });
}

#[test]
fn the_end_of_a_channel_comes_before_the_timeout() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel::<u8>();
    let clone = receiver.clone();
    thread::scope(|scope| {
        scope.spawn(|| {
            assert_eq!(
                receiver.blocking_recv_timeout(HOUR),
                Err(RecvTimeoutError::Closed)
            )
        });
        scope.spawn(|| {
            let received = luna_core::block_on(clone.recv_timeout(HOUR)).unwrap();
            assert_eq!(received, Err(RecvTimeoutError::Closed));
        });
        drop(sender);
    });
    drop(clone);
    let (sender, receiver) = channel::<u8>();
    drop(receiver);
    assert_eq!(
        sender.blocking_send_timeout(1, HOUR),
        Err(SendTimeoutError::Closed(1))
    );
}

#[test]
fn the_outcome_is_looked_at_before_the_clock() {
    // Both the partner and the deadline have come before the poll: it was sent, and it was
    // received.
    let (sender, receiver) = channel();
    // Time enough for a few steps on a busy machine.
    let time = Duration::from_millis(100);
    luna_core::block_on(async {
        let deadline = Instant::now() + time;
        let mut recv = Box::pin(receiver.recv_deadline(deadline));
        pending(&mut recv);
        sender.try_send(1).unwrap();
        while Instant::now() <= deadline {}
        assert_eq!(ready(&mut recv), Ok(1));

        let deadline = Instant::now() + time;
        let mut send = Box::pin(sender.send_deadline(2, deadline));
        pending(&mut send);
        assert_eq!(receiver.try_recv(), Ok(2));
        while Instant::now() <= deadline {}
        assert_eq!(ready(&mut send), Ok(()));
    })
    .unwrap();
}

#[test]
fn one_that_timed_out_is_withdrawn() {
    let _watchdog = Watchdog::new();
    let (sender, receiver) = channel();
    assert!(
        sender
            .blocking_send_timeout(1, SHORT)
            .unwrap_err()
            .is_timeout()
    );
    assert!(receiver.try_recv().unwrap_err().is_empty());
    luna_core::block_on(async {
        assert!(receiver.recv_timeout(SHORT).await.unwrap_err().is_timeout());
    })
    .unwrap();
    assert!(sender.try_send(2).unwrap_err().is_full());
}

#[test]
fn a_timed_operation_that_is_dropped_takes_its_offer_and_its_deadline_with_it() {
    let ledger = Ledger::new(1);
    let (sender, receiver) = channel();
    luna_core::block_on(async {
        let mut send = Box::pin(sender.send_timeout(ledger.token(0), HOUR));
        pending(&mut send);
        let timers = luna_core::current::timers().unwrap();
        assert_ne!(timers.next_deadline(), Instant::NEVER);
        drop(send);
        assert_eq!(timers.next_deadline(), Instant::NEVER);
    })
    .unwrap();
    ledger.assert_all_dropped_once();
    assert!(receiver.try_recv().unwrap_err().is_empty());
}

#[test]
#[should_panic(
    expected = "with a timeout or a deadline was awaited on a thread that runs no LUNA process"
)]
fn a_receive_that_must_wait_outside_of_luna_says_so() {
    let (_sender, receiver) = channel::<u8>();
    let _ = futures_lite::future::block_on(receiver.recv_timeout(HOUR));
}

#[test]
#[should_panic(
    expected = "with a timeout or a deadline was awaited on a thread that runs no LUNA process"
)]
fn a_send_that_must_wait_outside_of_luna_says_so() {
    let (sender, _receiver) = channel::<u8>();
    let _ = futures_lite::future::block_on(sender.send_timeout(1, HOUR));
}

/// What a panic says of a delay that is awaited under tokio.
fn refused_under_tokio(delay: impl Future<Output = ()>) -> String {
    let tokio = tokio::runtime::Builder::new_current_thread()
        .build()
        .unwrap();
    let awaited = std::panic::AssertUnwindSafe(|| tokio.block_on(delay));
    let payload = std::panic::catch_unwind(awaited).unwrap_err();
    payload.downcast_ref::<String>().unwrap().clone()
}

#[test]
fn a_delay_outside_of_luna_says_which_it_is_and_where_it_was_made() {
    let (after, after_made) = (luna_channels::after(HOUR), line!());
    let (at, at_made) = (luna_channels::at(Instant::now() + HOUR), line!());
    let (guard, guard_made) = (luna_channels::after(HOUR), line!());
    let (_sender, receiver) = channel::<u8>();
    let alternative = async {
        luna_channels::alt! {
            _ = receiver.recv() => {}
            _ = guard => {}
        }
    };
    let cases = [
        (refused_under_tokio(after), after_made),
        (refused_under_tokio(at), at_made),
        (refused_under_tokio(alternative), guard_made),
    ];
    for (message, line) in cases {
        let place = format!("`luna::after` or `luna::at`, made at {}:{line}:", file!());
        assert!(message.contains(&place), "{message}");
        assert!(message.contains("awaited on a thread that runs no LUNA process: await it inside"));
    }
}

#[test]
fn outside_of_luna_one_that_need_not_wait_works() {
    let (sender, receiver) = buffered(Buffer::fifo(1));
    assert_eq!(
        futures_lite::future::block_on(sender.send_timeout(1, HOUR)),
        Ok(())
    );
    assert_eq!(
        futures_lite::future::block_on(receiver.recv_timeout(HOUR)),
        Ok(1)
    );
}

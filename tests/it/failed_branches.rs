//! Branches of `par!` with a failed sibling, at operations that cannot return an error.

use luna::prelude::*;
use std::cell::Cell;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::task::Poll;
use std::time::Duration;

async fn fails() -> luna::Result<()> {
    Err(luna::Error::Timeout)
}

/// Runs `branch` beside one that fails; gives the errors of both.
fn beside_a_failure(branch: impl Future<Output = luna::Result<()>>) -> Vec<luna::Error> {
    let outcome = luna::run(async { par!(branch, fails()).await });
    outcome.unwrap_err().errors().cloned().collect()
}

#[test]
fn at_a_barrier_the_branch_ends() {
    let barrier = Barrier::new(2);
    let errors = beside_a_failure(async {
        barrier.sync().await;
        Ok(())
    });
    assert_eq!(errors, [luna::Error::Poisoned, luna::Error::Timeout]);
    // It has not come.
    assert_eq!(barrier.parties(), 2);
}

#[test]
fn at_a_local_barrier_the_branch_ends() {
    let group = Barrier::new(1).local(2);
    let errors = beside_a_failure(async {
        group.sync().await;
        Ok(())
    });
    assert_eq!(errors, [luna::Error::Poisoned, luna::Error::Timeout]);
}

#[test]
fn in_stop_the_branch_ends() {
    let (_sender, receiver) = luna::channel::<u32>();
    let never = std::hint::black_box(false);
    let errors = beside_a_failure(async {
        alt! { _ = receiver.recv(), if never => {} }
        Ok(())
    });
    assert_eq!(errors, [luna::Error::Poisoned, luna::Error::Timeout]);
}

#[test]
fn with_skip_nothing_is_waited_for() {
    let barrier = Barrier::new(2);
    let errors = beside_a_failure(async {
        luna::yield_now().await;
        alt! {
            _ = barrier.sync() => unreachable!(),
            skip => {}
        }
        Ok(())
    });
    assert_eq!(errors, [luna::Error::Timeout]);
}

#[test]
fn a_branch_that_has_learnt_of_it_cleans_up() {
    let is_clean = Cell::new(false);
    let barrier = Barrier::new(2);
    let (_sender, receiver) = luna::channel::<u32>();
    let errors = beside_a_failure(async {
        let learnt = {
            let (mut sync, mut recv) = (pin!(barrier.sync()), pin!(receiver.recv()));
            poll_fn(
                |cx| match (sync.as_mut().poll(cx), recv.as_mut().poll(cx)) {
                    (Poll::Ready(()), _) => Poll::Ready(None),
                    (_, Poll::Ready(received)) => Poll::Ready(received.err()),
                    _ => Poll::Pending,
                },
            )
            .await
        };
        assert!(learnt.is_some_and(|error| error.is_poisoned()));
        luna::after(Duration::from_millis(1)).await;
        is_clean.set(true);
        Ok(())
    });
    assert!(is_clean.get());
    assert_eq!(errors, [luna::Error::Timeout]);
}

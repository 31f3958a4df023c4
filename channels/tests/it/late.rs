//! A delay that has passed is chosen before what is below it, also by a partner that comes before
//! the owner has woken.

#![cfg(not(loom))]

use futures_lite::future::poll_once;
use luna_channels::{Receiver, Sender, alt, at, channel, pri_alt};
use luna_platform::clock::Instant;
use std::pin::pin;
use std::time::Duration;

const DELAY: Duration = Duration::from_millis(5);

/// Lets a partner come after the delay of an alternative that has begun to wait before it. Returns
/// whether it was found, and the choice. `None` if the machine was too slow for that.
async fn partner_comes_late(
    alternative: impl Future<Output = Option<u32>>,
    deadline: Instant,
    sender: &Sender<u32>,
) -> Option<(bool, Option<u32>)> {
    let mut alternative = pin!(alternative);
    if poll_once(alternative.as_mut()).await.is_some() {
        return None;
    }
    // On the clock, without giving the timers a chance to run.
    while Instant::now() < deadline {
        std::hint::spin_loop();
    }
    let is_found = sender.try_send(1).is_ok();
    Some((is_found, alternative.await))
}

/// Repeats what a slow machine may spoil.
fn until_some<T>(mut attempt: impl AsyncFnMut(&Sender<u32>, &Receiver<u32>) -> Option<T>) -> T {
    luna_core::block_on(async {
        loop {
            let (sender, receiver) = channel();
            if let Some(seen) = attempt(&sender, &receiver).await {
                return seen;
            }
        }
    })
    .unwrap()
}

#[test]
fn a_partner_does_not_find_a_guard_below_a_delay_that_has_passed() {
    let seen = until_some(async |sender, receiver| {
        let deadline = Instant::now() + DELAY;
        let by_order = async {
            pri_alt! {
                _ = at(deadline) => None,
                value = receiver.recv() => value.ok(),
            }
        };
        partner_comes_late(by_order, deadline, sender).await
    });
    assert_eq!(seen, (false, None));
}

#[test]
fn nor_one_beside_it_in_a_fair_alternative() {
    let seen = until_some(async |sender, receiver| {
        let deadline = Instant::now() + DELAY;
        let fair = async {
            alt! {
                value = receiver.recv() => value.ok(),
                _ = at(deadline) => None,
            }
        };
        partner_comes_late(fair, deadline, sender).await
    });
    assert_eq!(seen, (false, None));
}

#[test]
fn one_above_it_is_found() {
    let seen = until_some(async |sender, receiver| {
        let deadline = Instant::now() + DELAY;
        let by_order = async {
            pri_alt! {
                value = receiver.recv() => value.ok(),
                _ = at(deadline) => None,
            }
        };
        partner_comes_late(by_order, deadline, sender).await
    });
    assert_eq!(seen, (true, Some(1)));
}

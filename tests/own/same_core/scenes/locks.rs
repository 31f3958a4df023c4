//! The priority-inheriting lock, under which all of the others work.

use super::Scene;
use crate::same_core::shared::How;
use luna_platform::lock::PiLock;
use std::sync::Arc;

pub(super) fn scenes() -> [Scene; 1] {
    // Two numbers that differ only while the lock is held.
    let lock = Arc::new(PiLock::new((0_u64, 0_u64)));
    let of_low = lock.clone();
    let scene = Scene::new(
        "lock",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                // Neither lets the low side do more than leave.
                let pair = if high.how() == How::Try {
                    high.try_to(|| lock.try_lock())
                } else {
                    Some(high.try_to(|| lock.lock()))
                };
                if let Some(pair) = pair {
                    assert_eq!(pair.0, pair.1);
                }
            }
        },
        async move |low| {
            while low.goes_on().await {
                let mut pair = of_low.lock();
                pair.0 += 1;
                low.work(300);
                pair.1 += 1;
            }
        },
    );
    [scene]
}

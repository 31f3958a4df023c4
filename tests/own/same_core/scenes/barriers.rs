//! A barrier of the two sides: awaited, and as a guard.

use super::Scene;
use crate::same_core::shared::How;
use luna::{Barrier, alt};

pub(super) fn scenes() -> [Scene; 1] {
    let barrier = Barrier::new(2).external();
    let of_low = barrier.clone();
    let scene = Scene::new(
        "barrier",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                match high.how() {
                    How::Try => {
                        let choose = async {
                            alt! {
                                _ = barrier.sync() => {}
                                skip => {}
                            }
                        };
                        high.try_in(choose).await;
                    }
                    _ => high.wait_for(barrier.sync()).await,
                }
            }
            // The low side is alone then, and its rounds are complete at once.
            barrier.resign();
        },
        async move |low| {
            while low.goes_on().await {
                if low.random.below(2) == 0 {
                    low.offer(of_low.sync()).await;
                } else {
                    let choose = async {
                        alt! {
                            _ = of_low.sync() => {}
                        }
                    };
                    low.offer(choose).await;
                }
            }
        },
    );
    [scene]
}

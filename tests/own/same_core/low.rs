//! The low side: it works all the time, so that it loses its core anywhere in an operation.

use crate::common::Random;
use crate::same_core::shared::{Shared, low};
use futures_lite::future::{poll_once, yield_now};
use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// What waits at least as long as this is a wait in earnest: one in so many offers.
const RARELY: u64 = 128;

pub(crate) struct Low {
    pub(crate) random: Random,
    shared: Arc<Shared>,
    scene: usize,
}

impl Low {
    /// To be called on the low side's thread.
    pub(crate) fn new(shared: Arc<Shared>, random: Random) -> Self {
        Shared::set_thread(&shared.low_thread);
        Self {
            random,
            shared,
            scene: 0,
        }
    }

    pub(crate) fn leave(&mut self) {
        self.scene += 1;
    }

    /// Whether the high side is still in this scene. Counts an operation of this side as ended, and
    /// the next as begun.
    pub(crate) async fn goes_on(&mut self) -> bool {
        self.shared.low_state.store(low::BETWEEN, Ordering::Relaxed);
        self.shared.low.fetch_add(1, Ordering::SeqCst);
        if self.random.below(16) == 0 {
            // Through the run queue, if there is one.
            yield_now().await;
        }
        self.shared
            .low_state
            .store(low::OPERATES, Ordering::Relaxed);
        !self.shared.over.load(Ordering::SeqCst)
            && self.shared.scene.load(Ordering::SeqCst) == self.scene
    }

    /// Offers an operation for a short while, and mostly withdraws it then.
    pub(crate) async fn offer<F: Future>(&mut self, operation: F) -> Option<F::Output> {
        let mut operation = pin!(operation);
        if let Some(output) = poll_once(&mut operation).await {
            return Some(output);
        }
        if self.random.below(RARELY) == 0 {
            self.shared.low_state.store(low::WAITS, Ordering::Relaxed);
            let output = operation.await;
            self.shared
                .low_state
                .store(low::OPERATES, Ordering::Relaxed);
            return Some(output);
        }
        self.work(300);
        poll_once(&mut operation).await
    }

    /// Keeps the processor busy for at most so many steps.
    pub(crate) fn work(&mut self, most: u64) {
        for _ in 0..self.random.below(most) {
            std::hint::spin_loop();
        }
    }
}

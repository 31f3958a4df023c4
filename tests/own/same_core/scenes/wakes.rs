//! Wakes alone: a flag and a waker.

use super::Scene;
use crate::same_core::shared::How;
use luna_platform::lock::PiLock;
use std::future::poll_fn;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Waker};

pub(super) fn scenes() -> [Scene; 2] {
    [of_high(), of_low()]
}

/// Set by one side, awaited by the other.
struct Flag {
    set: AtomicBool,
    /// No process waits any more.
    ended: AtomicBool,
    waker: PiLock<Option<Waker>>,
}

impl Flag {
    fn new() -> Arc<Flag> {
        Arc::new(Flag {
            set: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            waker: PiLock::new(None),
        })
    }

    fn end(&self) {
        self.ended.store(true, Ordering::SeqCst);
        self.set.store(false, Ordering::SeqCst);
        self.raise();
    }

    fn take(&self) -> bool {
        self.set.swap(false, Ordering::SeqCst) || self.ended.load(Ordering::SeqCst)
    }

    fn raise(&self) {
        if self.set.swap(true, Ordering::SeqCst) {
            return;
        }
        let waker = self.waker.lock().clone();
        if let Some(waker) = waker {
            waker.wake();
        }
    }

    fn poll(&self, cx: &Context<'_>) -> Poll<()> {
        if self.take() {
            return Poll::Ready(());
        }
        let former = self.waker.lock().replace(cx.waker().clone());
        drop(former);
        // It may have been raised before the waker was there.
        if self.take() {
            return Poll::Ready(());
        }
        Poll::Pending
    }

    async fn raised(&self) {
        poll_fn(|cx| self.poll(cx)).await;
    }
}

/// The high side is woken.
fn of_high() -> Scene {
    let flag = Flag::new();
    let of_low = flag.clone();
    Scene::new(
        "wake, high",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                match high.how() {
                    How::Try => drop(high.try_to(|| flag.take())),
                    _ => high.wait_for(flag.raised()).await,
                }
            }
        },
        async move |low| {
            while low.goes_on().await {
                of_low.raise();
                low.work(300);
            }
        },
    )
}

/// The high side wakes.
fn of_low() -> Scene {
    let flag = Flag::new();
    let of_low = flag.clone();
    Scene::new(
        "wake, low",
        async move |high| {
            for _ in 0..high.rounds {
                high.pause().await;
                high.try_to(|| flag.raise());
            }
            // Wakes a low side that waits: it checks whether to go on, and this scene is about to
            // end.
            flag.end();
        },
        async move |low| {
            while low.goes_on().await {
                low.offer(of_low.raised()).await;
            }
        },
    )
}

//! Letting others run.

use crate::current;
use core::future::Future;
use core::pin::Pin;
use core::task::{Context, Poll};

/// Goes to the end of the queue of the process' level once: others of the same level, and all of
/// higher ones, run first.
///
/// Real-time path: yes; O(1). Under another runtime it wakes itself once, which that runtime may
/// take as it likes.
///
/// ```
/// luna_core::block_on(luna_core::yield_now()).unwrap();
/// ```
pub fn yield_now() -> YieldNow {
    YieldNow { yielded: false }
}

/// Made by [`yield_now`].
#[derive(Debug)]
#[must_use = "it yields only when awaited"]
pub struct YieldNow {
    yielded: bool,
}

impl Future for YieldNow {
    type Output = ();

    #[inline]
    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        if self.yielded {
            return Poll::Ready(());
        }
        self.yielded = true;
        current::yield_turn(cx);
        Poll::Pending
    }
}

//! A future as what the current process waits for.

use luna_core::events::{Kind, beside, waits_for, waits_no_more};
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};

/// While `future` waits, whatever for, the current process waits for this.
///
/// ```
/// use luna_events::{self as events, Kind};
///
/// let seven = events::waits_in((Kind::Loop, 7), async { 1 + 1 });
/// # drop(seven);
/// ```
#[inline(always)]
pub fn waits_in<F: Future>((kind, number): (Kind, u32), future: F) -> WaitsIn<F> {
    WaitsIn {
        kind,
        number,
        future,
    }
}

/// See [`waits_in`].
#[derive(Debug)]
#[must_use = "a future does nothing unless awaited"]
pub struct WaitsIn<F> {
    kind: Kind,
    number: u32,
    future: F,
}

impl<F: Future> Future for WaitsIn<F> {
    type Output = F::Output;

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<F::Output> {
        // SAFETY: the future is pinned with the whole structure, and nothing is moved.
        let (what, future) = unsafe {
            let this = self.get_unchecked_mut();
            (
                (this.kind, this.number),
                Pin::new_unchecked(&mut this.future),
            )
        };
        let polled = beside(|| future.poll(cx));
        if polled.is_pending() {
            waits_for(|| what);
        }
        polled
    }
}

impl<F> Drop for WaitsIn<F> {
    #[inline]
    fn drop(&mut self) {
        waits_no_more(|| Some((self.kind, self.number)));
    }
}

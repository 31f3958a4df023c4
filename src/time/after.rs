//! The clock and delays.

use luna_platform::clock::Instant;
use luna_platform::timer_queue::Sleep;
use std::future::Future;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

/// The time on the clock of the system. Real-time path: yes; O(1), no system call (24 ns on the reference machine).
///
/// ```
/// let start = luna::now();
/// assert!(luna::now() >= start);
/// ```
#[inline]
pub fn now() -> Instant {
    Instant::now()
}

/// Waits for `delay`, counted from this call. See [`at`] for what it costs.
///
/// ```
/// use std::time::Duration;
/// luna::run(async {
///     let start = luna::now();
///     luna::after(Duration::from_millis(2)).await;
///     assert!(luna::now() - start >= Duration::from_millis(2));
///     Ok(())
/// })?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn after(delay: Duration) -> After {
    at(now() + delay)
}

/// Waits until `deadline`; one that has passed is ready at once.
///
/// Real-time path: yes; O(log n) for n delays of this thread, no allocation. Cancel-safe.
///
/// # Panics
///
/// When awaited outside of any process of LUNA: there are no timers.
///
/// ```
/// use std::time::Duration;
/// luna::run(async {
///     let deadline = luna::now() + Duration::from_millis(1);
///     luna::at(deadline).await;
///     assert!(luna::now() >= deadline);
///     Ok(())
/// })?;
/// # Ok::<(), luna::Error>(())
/// ```
pub fn at(deadline: Instant) -> After {
    After {
        sleep: Sleep::until(deadline),
    }
}

/// A delay: see [`after`] and [`at`].
#[derive(Debug)]
#[must_use = "a delay does nothing unless awaited: add `.await`"]
pub struct After {
    sleep: Sleep,
}

impl Future for After {
    type Output = ();

    #[inline]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        // SAFETY: the sleep is pinned with the whole.
        unsafe { self.map_unchecked_mut(|this| &mut this.sleep) }.poll(cx)
    }
}

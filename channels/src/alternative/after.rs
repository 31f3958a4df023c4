//! Delays, as guards and alone.

use super::guard::{Attempt, Guard, RawGuard, Terms, own_seed};
use crate::replay;
use crate::wait_point::WaitQueues;
use core::future::Future;
use core::panic::Location;
use core::pin::Pin;
use core::task::{Context, Poll};
use core::time::Duration;
use luna_core::current::PendingWake;
use luna_core::timer_queue::{Sleep, no_timers};
use luna_platform::clock::Instant;
use pin_project_lite::pin_project;

/// Waits for `delay`, counted from this call. See [`at`] for what it costs.
///
/// ```
/// use luna_channels::{after, alt, channel};
/// use std::time::Duration;
/// # luna_core::block_on(async {
/// let (_sender, receiver) = channel::<u32>();
/// let late = alt! {
///     value = receiver.recv() => value.is_err(),
///     _ = after(Duration::from_millis(1)) => true,
/// };
/// assert!(late);
/// # }).unwrap();
/// ```
#[doc(alias = "sleep")]
#[inline]
#[track_caller]
pub fn after(delay: Duration) -> After {
    at(Instant::now() + delay)
}

/// Waits until `deadline`; one that has passed is ready at once. Alone, or as a guard of an
/// alternative.
///
/// Real-time path: yes; O(log n) for n delays of this thread, no allocation. Cancel-safe.
///
/// # Panics
///
/// When awaited outside of any process of LUNA: there are no timers.
///
/// ```
/// use luna_channels::at;
/// use luna_platform::clock::Instant;
/// # luna_core::block_on(async {
/// let deadline = Instant::now() + std::time::Duration::from_millis(1);
/// at(deadline).await;
/// assert!(Instant::now() >= deadline);
/// # }).unwrap();
/// ```
#[inline]
#[track_caller]
pub fn at(deadline: Instant) -> After {
    After {
        sleep: Sleep::until(deadline),
        made_at: Location::caller(),
        has_come: false,
    }
}

pin_project! {
    /// A delay: see [`after`] and [`at`].
    #[derive(Debug)]
    #[must_use = "a delay does nothing unless awaited or offered in an alternative"]
    pub struct After {
        #[pin]
        sleep: Sleep,
        // For the panic where there are no timers.
        made_at: &'static Location<'static>,
        // It is awaited in a process with a replay log, and has come.
        has_come: bool,
    }
}

impl After {
    /// The instant it waits for.
    pub fn deadline(&self) -> Instant {
        self.sleep.deadline()
    }

    #[inline]
    fn poll_sleep(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let this = self.project();
        let made_at = *this.made_at;
        this.sleep.poll_or(cx, || {
            no_timers("the delay `luna::after` or `luna::at`", Some(made_at))
        })
    }
}

impl Future for After {
    type Output = ();

    #[inline]
    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        if replay::is_on() {
            let mut has_come = self.has_come;
            let poll = |cx: &mut Context<'_>| self.as_mut().poll_sleep(cx);
            let polled = replay::poll_delay(&mut has_come, poll, cx);
            *self.project().has_come = has_come;
            return polled;
        }
        self.poll_sleep(cx)
    }
}

// SAFETY: it has no wait point, and is never listed.
unsafe impl RawGuard for After {
    fn terms(&self) -> Terms {
        Terms::default()
    }

    fn deadline(&self) -> Option<Instant> {
        Some(self.sleep.deadline())
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        _: Option<&mut WaitQueues>,
        _: &mut Context<'_>,
    ) -> Attempt {
        if self.sleep.has_come() {
            Attempt::Ready(PendingWake::NONE)
        } else {
            Attempt::NotReady
        }
    }

    unsafe fn poll_time(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        self.poll_sleep(cx)
    }
}

impl Guard for After {
    type Output = ();

    own_seed!();

    unsafe fn output(self: Pin<&mut Self>) {}
}

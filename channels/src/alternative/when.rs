//! Deadlines that are looked up when they come, as guards and alone.

use super::guard::{Attempt, Guard, RawGuard, Terms, own_seed};
use crate::replay;
use crate::stamp::Stamp;
use crate::wait_point::WaitQueues;
use core::future::Future;
use core::panic::Location;
use core::pin::Pin;
use core::task::{Context, Poll};
use luna_core::current::{self, PendingWake};
use luna_core::timer_queue::{Sleep, no_timers};
use luna_platform::clock::Instant;
use pin_project_lite::pin_project;

/// Something that falls due on the clock, and can have been put off when its time comes.
#[doc(hidden)]
pub trait Due {
    /// What it gives when it is served.
    type Output;

    /// When it is due, as known at `now`; not after `now` if it is due already, [`Instant::NEVER`]
    /// if it cannot be. While a process waits for it, it may only become later. Called under locks:
    /// O(1), and never panics.
    fn due_at(&self, now: Instant) -> Instant;

    /// Stamp of its last choice by a fair alternative, if it remembers that.
    fn stamp(&self) -> Option<&Stamp> {
        None
    }

    /// Serves it, which was due.
    fn serve(&mut self, now: Instant) -> Self::Output;
}

pin_project! {
    /// Waits until something is due: a tick, a timer, a watchdog. Alone, or as a guard of an
    /// alternative.
    ///
    /// Real-time path: yes; O(log n) for n delays of this thread, no allocation. Cancel-safe: what
    /// was not chosen stays due.
    ///
    /// # Panics
    ///
    /// When it has to wait outside of any process of LUNA: there are no timers.
    #[must_use = "it waits only when awaited or offered in an alternative"]
    pub struct When<D> {
        due: D,
        // For the panic where there are no timers.
        made_at: &'static Location<'static>,
        #[pin]
        sleep: Sleep,
        // Whether `sleep` is set to the time at which it is due now.
        is_set: bool,
        // It is awaited in a process with a replay log, and is due.
        has_come: bool,
    }
}

impl<D: Due> When<D> {
    #[doc(hidden)]
    #[track_caller]
    pub fn new(due: D) -> Self {
        Self {
            due,
            made_at: Location::caller(),
            sleep: Sleep::until(Instant::NEVER),
            is_set: false,
            has_come: false,
        }
    }

    fn is_due(&self) -> bool {
        let now = Instant::now();
        self.due.due_at(now) <= now
    }

    /// Whether it is due; arranges for a wake when it may be.
    fn poll_due(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let mut this = self.project();
        let made_at = *this.made_at;
        loop {
            let now = Instant::now();
            let due_at = this.due.due_at(now);
            if due_at <= now {
                return Poll::Ready(());
            }
            if due_at == Instant::NEVER {
                return Poll::Pending;
            }
            if !*this.is_set {
                this.sleep.as_mut().reset(due_at);
                *this.is_set = true;
            }
            // The due time may have been put off meanwhile: then it sleeps again, until the new
            // one.
            let refuse = || no_timers("a tick, a timer or a watchdog", Some(made_at));
            if this.sleep.as_mut().poll_or(cx, refuse).is_pending() {
                return Poll::Pending;
            }
            *this.is_set = false;
        }
    }

    fn serve(self: Pin<&mut Self>) -> D::Output {
        self.project().due.serve(replay::now())
    }
}

impl<D: Due> Future for When<D> {
    type Output = D::Output;

    fn poll(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<D::Output> {
        if replay::is_on() {
            let mut has_come = self.has_come;
            let polled = replay::poll_delay(&mut has_come, |cx| self.as_mut().poll_due(cx), cx);
            *self.as_mut().project().has_come = has_come;
            return polled.map(|()| self.serve());
        }
        if self.as_mut().poll_due(cx).is_pending() {
            return Poll::Pending;
        }
        if !current::count_operation() {
            // One of too many in a row that did not have to wait: the next poll begins a new count.
            current::ready_again(cx, current::QueueEnd::Back);
            return Poll::Pending;
        }
        Poll::Ready(self.serve())
    }
}

// SAFETY: it has no wait point, and is never listed.
unsafe impl<D: Due> RawGuard for When<D> {
    fn terms(&self) -> Terms {
        Terms::default()
    }

    fn stamp(&self) -> Option<&Stamp> {
        self.due.stamp()
    }

    unsafe fn attempt(
        self: Pin<&mut Self>,
        _: Option<&mut WaitQueues>,
        _: &mut Context<'_>,
    ) -> Attempt {
        if self.is_due() {
            Attempt::Ready(PendingWake::NONE)
        } else {
            Attempt::NotReady
        }
    }

    unsafe fn poll_time(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        self.poll_due(cx)
    }
}

impl<D: Due> Guard for When<D> {
    type Output = D::Output;

    own_seed!();

    unsafe fn output(self: Pin<&mut Self>) -> D::Output {
        self.serve()
    }
}

luna_platform::debug_fields!(impl[D] When<D>);

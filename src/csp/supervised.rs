//! A process' body as an executor polls it: with the failures that the framework finds in it.

use super::process::Common;
use crate::error::{Error, Result};
use crate::notice::notice;
use crate::system::deadlock::{Sleeping, find};
use crate::time::{LoopName, Scope};
use luna_channels::inspect::{failed_at, wait_points};
use luna_core::ExitValue;
use luna_core::current::{self, ProcessId};
use luna_events as events;
use std::cell::Cell;
use std::future::Future;
use std::hint::cold_path;
use std::mem::ManuallyDrop;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use std::time::Duration;

/// How a body ended, if it was not cancelled and did not panic; nothing if it returned without an
/// error.
pub(crate) struct Verdict(pub(crate) Option<Ended>);

impl Verdict {
    /// On the current process. Apart, so that a turn which ends nothing has no room for what ends
    /// do.
    #[cold]
    #[inline(never)]
    fn of(returned: Result<()>) -> Self {
        match returned {
            Ok(()) => Self(None),
            Err(error) => {
                let at = failed_at().filter(|_| error.is_closed() || error.is_poisoned());
                if let Some(at) = at {
                    Common::with(|common| common.ended_at.note(at));
                }
                match error {
                    // Its partners have ended: so does it, in order. If one of them has failed,
                    // that is the error of the run.
                    Error::Closed => Self(None),
                    error => Self::failure(Ended::Returned(error)),
                }
            }
        }
    }

    fn failure(ended: Ended) -> Self {
        events::note_failure();
        Self(Some(ended))
    }
}

impl ExitValue for Verdict {
    fn is_nothing(&self) -> bool {
        self.0.is_none()
    }

    fn failed() -> Self {
        match FAILURE.take() {
            Some(failure) => Self::failure(Ended::Failed(failure)),
            None => Self(None),
        }
    }
}

pub(crate) enum Ended {
    Returned(Error),
    Failed(Failure),
}

/// A loop that has reached its limit of late cycles, for which the framework ends its process.
/// Without allocation, since others go on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Failure {
    pub(crate) name: LoopName,
    pub(crate) consecutive: u32,
}

thread_local! {
    /// That of the process which is being polled: taken after the poll, or by the [`Alarm`] if that
    /// panics.
    static FAILURE: Cell<Option<Failure>> = const { Cell::new(None) };
}

/// Ends the current process with `failure` at its next await, which does not return.
pub(crate) async fn fail_current(failure: Failure) -> ! {
    FAILURE.set(Some(failure));
    current::fail_current();
    std::future::pending().await
}

/// A body with the failures that the framework finds in it. On a thread that has
/// [entered](Common::enter_thread).
pub(crate) struct Supervised<F> {
    body: ManuallyDrop<F>,
}

impl<F> Supervised<F> {
    /// Makes the body, on the thread that it is to run on, and enters what it is given before.
    pub(super) fn make(make: impl FnOnce() -> F, common: Option<&Arc<Common>>) -> Self {
        if let Some(common) = common {
            common.enter_thread();
            common.log.enter_executor();
        }
        let alarm = Alarm;
        let body = make();
        std::mem::forget(alarm);
        Self {
            body: ManuallyDrop::new(body),
        }
    }
}

impl<F: Future<Output = Result<()>>> Future for Supervised<F> {
    type Output = Verdict;

    #[inline(always)]
    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Verdict> {
        // SAFETY: the body is pinned with the whole, and never moved.
        let body = unsafe { Pin::new_unchecked(&mut *self.get_unchecked_mut().body) };
        let alarm = Alarm;
        let polled = body.poll(cx);
        std::mem::forget(alarm);
        match polled {
            Poll::Pending => Poll::Pending,
            Poll::Ready(returned) => {
                cold_path();
                Poll::Ready(Verdict::of(returned))
            }
        }
    }
}

impl<F> Drop for Supervised<F> {
    fn drop(&mut self) {
        if luna_core::has_given_up() {
            // The thread panicked around the body: an emergency too, and before anything of the
            // body's has its turn.
            drop(Alarm);
        }
        // Also a panic of what a cancelled body leaves.
        let alarm = Alarm;
        // SAFETY: dropped here, in its place, and nowhere else.
        unsafe { ManuallyDrop::drop(&mut self.body) };
        std::mem::forget(alarm);
    }
}

/// A panic in a process is an emergency. The panic hook has triggered it, unless the program has
/// set another hook since, or the panic went on from another thread: then it is triggered here, as
/// the panic leaves the body.
struct Alarm;

impl Drop for Alarm {
    #[cold]
    #[inline(never)]
    fn drop(&mut self) {
        // What the panic leaves behind is no later process'.
        FAILURE.set(None);
        Common::with(|common| common.emergency.trigger_by_panic());
    }
}

/// Runs `body` as a process on the calling thread, without a system around it: neither `Send` nor
/// `'static` is required.
///
/// The smallest way to run a network: a program's `main`, a test. The body may make blocking calls.
/// A panic passes through.
///
/// If it has waited for a second and nothing can wake it (no deadline, file, blocking call, channel
/// that is marked external or was used at its other end by another thread), it prints once on
/// standard error what it waits for, and waits on.
///
/// # Errors
///
/// The body's own, or [`SetupError::Nested`](crate::error::SetupError::Nested) inside a process.
///
/// ```
/// let greeting = String::from("hello");
/// let length = luna::run(async { Ok(greeting.len()) })?;
/// assert_eq!(length, 5);
/// # Ok::<(), luna::Error>(())
/// ```
#[doc(alias = "block_on")]
pub fn run<T>(body: impl Future<Output = Result<T>>) -> Result<T> {
    let _scope = Scope::free_standing().enter_until_dropped(false);
    // A panic of another run may have left one behind.
    FAILURE.set(None);
    let mut body = std::pin::pin!(body);
    let body = std::future::poll_fn(|cx| {
        let polled = body.as_mut().poll(cx);
        // Also of a body that has ended and had the branch.
        match FAILURE.take() {
            Some(failure) => Poll::Ready(Err(failure)),
            None => polled.map(Ok),
        }
    });
    luna_core::block_on_patiently(body, PATIENCE, report_if_stuck)?.map_err(Error::from)?
}

/// How long it waits before it prints. A thread that has not used its end yet may be about to:
/// channels are not marked here.
const PATIENCE: Duration = Duration::from_secs(1);

/// Prints what `process` waits for, if no other thread is known to use that; returns whether it was
/// printed.
fn report_if_stuck(process: ProcessId) -> bool {
    let body = Sleeping {
        id: process,
        name: "main".into(),
        has_ended: false,
        joiners: Vec::new(),
    };
    let mut points = wait_points();
    for wait_point in &mut points {
        // The wait has covered unknown parties, and the result is only printed.
        wait_point.strangers = false;
    }
    let Some(found) = find("", &[body], &points, |_| false, |_, _| false) else {
        return false;
    };
    let mut text =
        String::from("luna: the body of luna::run waits, and nothing that it knows of can wake it");
    for wait in found.waits {
        text.push_str(&format!("\n  {wait}"));
    }
    notice!("{text}");
    true
}

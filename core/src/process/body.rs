//! The body of a process: how it is built, polled, and ended.

use super::end::{Abandoned, ExitValue};
use super::{OfBody, Process, state};
use crate::current;
use core::any::TypeId;
use core::cell::UnsafeCell;
use core::future::Future;
use core::hint::unreachable_unchecked;
use core::mem::{self, offset_of};
use core::pin::Pin;
use core::ptr::{self, NonNull};
use core::task::{Context, Poll};
use luna_platform::panics::catch_unwind;

/// A process with its body.
#[repr(C)]
pub(super) struct Whole<F: Future, B> {
    /// First, so that a pointer to the whole is one to the process.
    pub(super) process: Process,
    pub(super) body: UnsafeCell<Body<F, F::Output, B>>,
}

/// A body. Its room is that of its builder and of its exit value too: there is memory for any exit
/// value when the body ends. `B` makes the future where it is to run.
pub(super) enum Body<F, O, B> {
    Unbuilt(B),
    Running(F),
    Value(O),
    Empty,
}

/// The body behind a process.
///
/// # Safety
///
/// `process` begins a live `Whole<F, B>`, and is a pointer to all of it; nothing else accesses the
/// body while the borrow lasts. This is the thread of its executor, unless the body is not built or
/// has ended: its builder and its exit value may be sent.
#[inline(always)]
unsafe fn body<'a, F: Future, B>(process: NonNull<Process>) -> Pin<&'a mut Body<F, F::Output, B>> {
    // SAFETY: the caller promises a live whole, the body of which nothing else accesses; the body
    // stays where it is until it is dropped.
    unsafe { Pin::new_unchecked(&mut *(*process.cast::<Whole<F, B>>().as_ptr()).body.get()) }
}

/// How a body ended, with its exit value before that is published.
enum End<O> {
    Completed(O),
    Abandoned(Abandoned),
}

impl OfBody {
    pub(super) const fn new<F, B>() -> Self
    where
        B: FnOnce() -> F,
        F: Future<Output: ExitValue> + 'static,
    {
        let start = offset_of!(Whole<F, B>, body);
        Self {
            build: build::<F, B>,
            clear: clear::<F, B>,
            abandon: abandon::<F, B>,
            range: start..start + size_of::<Body<F, F::Output, B>>(),
            value: TypeId::of::<F::Output>,
            take_value: take_value::<F, B>,
        }
    }
}

// Of the functions below `process` is the pointer of a `Whole<F, B>`, as `body` requires; the rest
// of what they require stands at `Methods`.

/// Makes the future where it stays. If the builder panics, there is nothing any more.
///
/// # Safety
///
/// As for [`body`]: the pointer of a live whole that is not built, on its executor's thread.
unsafe fn build<F: Future, B: FnOnce() -> F>(process: NonNull<Process>) {
    // SAFETY: the caller promises what `body` requires. There is no future yet that would be moved.
    // The builder is moved out, and nothing is in its place before its room is used again. It may
    // be large, so no room is moved.
    unsafe {
        let room: *mut Body<F, F::Output, B> = body::<F, B>(process).get_unchecked_mut();
        if let Body::Unbuilt(build) = &*room {
            let build = ptr::read(build);
            room.write(Body::Empty);
            room.write(Body::Running(build()));
        }
    }
}

/// # Safety
///
/// As for [`body`]: the pointer of a live whole that is not built.
unsafe fn clear<F: Future, B>(process: NonNull<Process>) {
    // SAFETY: the caller promises what `body` requires.
    unsafe { body::<F, B>(process) }.set(Body::Empty);
}

/// Polls the future, and ends it if it is ready.
///
/// # Safety
///
/// As for [`body`]: the pointer of a live whole whose body is built and has not ended, in its turn
/// on its executor's thread.
pub(super) unsafe fn poll<F, B>(process: NonNull<Process>, cx: &mut Context<'_>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller promises what `body` requires; the borrow is over when `end` begins. The
    // future is never moved: it is polled pinned, and dropped in place. It was built and has not
    // ended, so it is there.
    unsafe {
        let polled = match body::<F, B>(process).get_unchecked_mut() {
            Body::Running(future) => Pin::new_unchecked(future).poll(cx),
            _ => unreachable_unchecked(),
        };
        if let Poll::Ready(value) = polled {
            end::<F, B>(process, End::Completed(value));
        }
    }
}

/// # Safety
///
/// As for [`poll`]: a built body that has not ended, on its executor's thread.
unsafe fn abandon<F, B>(process: NonNull<Process>, abandoned: Abandoned)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller promises what `end` requires.
    unsafe { end::<F, B>(process, End::Abandoned(abandoned)) };
}

/// Drops the body and publishes how it ended. The exit value takes the body's place until it is
/// taken, or the process is freed.
///
/// # Safety
///
/// As for [`poll`]: a built body that has not ended, on its executor's thread.
#[cold]
unsafe fn end<F, B>(process: NonNull<Process>, mut end: End<F::Output>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller promises a live whole on its executor's thread, and a body that nothing
    // else accesses and that has not ended. No borrow of it is left when the exit value is
    // published, and from then on it belongs to the thread that takes it.
    unsafe {
        let this = process.as_ref();
        // Its own failure counts more than a cancellation that came in the same poll, and than a
        // value. Such a value is dropped here, before the body: if that panics, the process has
        // panicked.
        if this.has_failed() && !matches!(end, End::Abandoned(Abandoned::Panicked(_))) {
            end = End::Completed(F::Output::failed());
        }
        drop_body(body::<F, B>(process), this, &mut end);
        let (outcome, panic) = match end {
            End::Completed(value) if !value.is_nothing() => {
                body::<F, B>(process).set(Body::Value(value));
                (state::WITH_VALUE, None)
            }
            End::Abandoned(Abandoned::Cancelled) => (state::CANCELLED, None),
            End::Abandoned(Abandoned::Panicked(payload)) => (state::PANICKED, Some(payload)),
            End::Completed(_) | End::Abandoned(Abandoned::Over | Abandoned::Failed) => {
                (state::COMPLETED, None)
            }
        };
        this.finish(outcome, panic);
    }
}

/// Drops the future. One that panicked is never polled again, so its half-done state stays
/// invisible. Changes `end` if it ends in another way after all. A poll that is under way ends
/// before: what panics then finds a body that has not ended.
fn drop_body<F: Future, B>(
    mut body: Pin<&mut Body<F, F::Output, B>>,
    process: &Process,
    end: &mut End<F::Output>,
) {
    process.end_poll();
    // Dropping the body ends its channels before the end of the process is published. A body that
    // has not completed was left in the middle, and so is what it held.
    let abandoned = !matches!(end, End::Completed(_) | End::Abandoned(Abandoned::Over));
    let log_installer = process.log_installer();
    if let (End::Completed(_), Some(log_installer)) = (&*end, log_installer) {
        log_installer.completed();
    }
    let poisons = abandoned && process.is_poisoned();
    let dropped = catch_unwind(|| {
        let mut drop_body = || match (abandoned, poisons) {
            (false, _) => body.set(Body::Empty),
            (true, false) => current::with_abandoned(|| body.set(Body::Empty)),
            (true, true) => current::poison_dropped_ends(|| {
                current::with_abandoned(|| body.set(Body::Empty));
            }),
        };
        match log_installer {
            None => drop_body(),
            // A completed body is dropped within its last poll. That is no part of its replay log.
            Some(_) => current::without_replay_log(drop_body),
        }
    });
    if let Some(log_installer) = log_installer {
        log_installer.end();
    }
    match dropped {
        Ok(()) => {}
        // The first one counts, and dropping the other could panic in turn.
        Err(second) if matches!(end, End::Abandoned(Abandoned::Panicked(_))) => {
            mem::forget(second);
        }
        Err(payload) => *end = End::Abandoned(Abandoned::Panicked(payload)),
    }
}

/// # Safety
///
/// As for [`body`]: the pointer of a live whole whose body has ended with an exit value, which is
/// the caller's. `to` is room for it.
unsafe fn take_value<F: Future, B>(process: NonNull<Process>, to: *mut ()) {
    // SAFETY: the caller promises a live whole, the body of which has ended, and that the exit
    // value is this call's: so nothing else accesses the body, and no future is moved.
    unsafe {
        let body = body::<F, B>(process).get_unchecked_mut();
        match mem::replace(body, Body::Empty) {
            Body::Value(value) => to.cast::<F::Output>().write(value),
            _ => unreachable_unchecked(),
        }
    }
}

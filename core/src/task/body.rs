//! The body behind a task: how it is polled, and how it ends.

use super::Task;
use crate::process::{Abandoned, Body, End, ErasedExitValue, ExitValue, ExitValueMethods};
use core::any::TypeId;
use core::cell::UnsafeCell;
use core::future::Future;
use core::mem::offset_of;
use core::ops::Range;
use core::pin::Pin;
use core::ptr::NonNull;
use core::task::{Context, Poll};

/// Rare operations on a body: found through its process' methods.
pub(super) struct BodyMethods {
    /// Ends a body that has not completed.
    pub(super) abandon: unsafe fn(NonNull<Task>, Abandoned),
}

#[repr(C)]
pub(super) struct Whole<F: Future, B> {
    pub(super) task: Task,
    pub(super) body: UnsafeCell<Body<F, B>>,
}

/// The body behind a task.
///
/// # Safety
///
/// `task` is the head of a live `Whole<F, B>`, and nothing else accesses its body while the borrow
/// lasts. This is the thread of its executor, unless the body is not built or has ended: its
/// builder and its exit value may be sent.
#[inline(always)]
pub(super) unsafe fn body<'a, F: Future, B>(task: NonNull<Task>) -> Pin<&'a mut Body<F, B>> {
    // SAFETY: the caller promises a live whole, the body of which nothing else accesses; the body
    // stays where it is until it is dropped.
    unsafe { Pin::new_unchecked(&mut *(*task.cast::<Whole<F, B>>().as_ptr()).body.get()) }
}

/// # Safety
///
/// `owner` is the head of a live `Whole<F, B>`.
pub(super) unsafe fn body_range<F: Future, B>(owner: NonNull<()>) -> Range<usize> {
    let start = owner.addr().get() + offset_of!(Whole<F, B>, body);
    start..start + size_of::<Body<F, B>>()
}

/// # Safety
///
/// As for [`body`]: `owner` is the head of that `Whole<F, B>`. The body is built, and has not
/// ended.
pub(super) unsafe fn poll<F, B>(owner: NonNull<()>, cx: &mut Context<'_>)
where
    F: Future<Output: ExitValue>,
{
    let task = owner.cast::<Task>();
    // SAFETY: the caller promises what `body` requires, for both borrows, of which the first is
    // over when `end_body` begins; and that the body is built and has not ended, as `poll_unended`
    // and `end_body` require.
    unsafe {
        if let Poll::Ready(value) = body::<F, B>(task).poll_unended(cx) {
            end_body::<F, B>(task, End::Completed(value));
        }
    }
}

/// # Safety
///
/// As for [`body`]: a live whole on its executor's thread, and no other access to its body. That
/// has not ended.
pub(super) unsafe fn abandon<F, B>(task: NonNull<Task>, abandoned: Abandoned)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller promises what `end_body` requires: a live whole on its executor's thread,
    // and a body that nothing else accesses and that has not ended.
    unsafe { end_body::<F, B>(task, End::Abandoned(abandoned)) };
}

/// Drops the body and publishes how it ended. The exit value takes the body's place until it is
/// taken, or the task is freed.
///
/// # Safety
///
/// As for [`body`]: a live whole on its executor's thread, and no other access to its body. That
/// has not ended before.
#[cold]
pub(super) unsafe fn end_body<F, B>(task: NonNull<Task>, mut end: End<F::Output>)
where
    F: Future<Output: ExitValue>,
{
    // SAFETY: the caller promises a live whole on its executor's thread, and a body that nothing
    // else accesses and that has not ended. No borrow of it is left when the exit value is
    // published, and from then on it belongs to the threads that take it.
    unsafe {
        let this = task.as_ref();
        // Its own failure counts more than a cancellation that came in the same poll, and than a
        // value. Such a value is dropped here, before the body: if that panics, the process has
        // panicked.
        if this.process.has_failed() && !end.is_panic() {
            end = End::Completed(F::Output::failed());
        }
        body::<F, B>(task).end(&this.record, &mut end);
        let exit = end.into_raw(|value| {
            body::<F, B>(task).keep(value);
            let methods = const {
                &ExitValueMethods {
                    type_id: TypeId::of::<F::Output>,
                    take: take_exit_value::<F, B>,
                    discard: discard_exit_value::<F, B>,
                }
            };
            ErasedExitValue::new(task.cast(), methods)
        });
        this.process.set_ended();
        this.record.finish(exit);
    }
}

/// # Safety
///
/// `owner` is the head of a live `Whole<F, B>`. Its body has ended. The caller owns its exit
/// value; `to` is room for it.
pub(super) unsafe fn take_exit_value<F: Future, B>(owner: NonNull<()>, to: *mut ()) {
    // SAFETY: the caller promises a live whole, the body of which has ended, and that the exit
    // value is this call's: so nothing else accesses the body.
    unsafe {
        let task = owner.cast::<Task>();
        let value = body::<F, B>(task).take_exit_value();
        // The caller owns an exit value, so there is one.
        to.cast::<F::Output>().write(value.unwrap_unchecked());
    }
}

/// # Safety
///
/// As for [`take_exit_value`]: `owner` is the head of a live `Whole<F, B>`, its body has ended, and
/// the caller owns its exit value.
pub(super) unsafe fn discard_exit_value<F: Future, B>(owner: NonNull<()>) {
    // SAFETY: the caller promises a live whole, the body of which has ended, and that the exit
    // value is this call's: so nothing else accesses the body.
    unsafe {
        let task = owner.cast::<Task>();
        let value = body::<F, B>(task).take_exit_value();
        drop(value);
    }
}

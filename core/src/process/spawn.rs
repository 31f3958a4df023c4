//! A process that is not built yet: its executor's thread makes the body of what lies in its place.

use super::body::{self, Body, Whole};
use super::end::ExitValue;
use super::handle::ProcessSpec;
use super::record::retire;
use super::{Methods, Notice, OfBody, Process, ProcessRef, run, state, waker};
use crate::current;
use crate::events;
use crate::executor::Shared;
use crate::path;
use alloc::sync::Arc;
use core::cell::UnsafeCell;
use core::future::Future;
use core::mem::ManuallyDrop;
use core::ptr::NonNull;
use luna_platform::panics::catch_unwind;

/// A process that has not begun: dropped, it ends as cancelled, with its builder.
///
/// # Invariants
///
/// The process is not built and has not ended, and this alone accesses its builder.
pub(crate) struct Unbuilt(NonNull<Process>);

// SAFETY: its builder may be sent, and the rest is shared by atomics.
unsafe impl Send for Unbuilt {}

impl Unbuilt {
    /// A process that counts as living on `executor`, and a reference to it. Allocates.
    #[inline]
    pub(crate) fn new<F, B>(
        executor: Arc<Shared>,
        spec: ProcessSpec,
        builder: B,
    ) -> (Self, ProcessRef)
    where
        B: FnOnce() -> F + Send + 'static,
        F: Future<Output: ExitValue> + 'static,
    {
        let methods = const {
            &Methods {
                ready_elsewhere: run::ready_elsewhere,
                free: retire,
                poll: body::poll::<F, B>,
                of_body: OfBody::new::<F, B>(),
            }
        };
        executor.registry.enter();
        path::name_process(spec.id, &spec.name);
        events::report(events::code::SPAWNED, spec.id.get(), || {
            [events::current_process(), 0]
        });
        // The builder is written in place, since it may be large. SAFETY: a whole begins with the
        // process, and has room for both parts. No other code knows the process, which lies there
        // until `retire` has it freed.
        unsafe {
            let whole = Process::of_executor(spec, executor).placed::<Whole<F, B>>();
            let body = UnsafeCell::new(Body::Unbuilt(builder));
            (&raw mut (*whole.as_ptr()).body).write(body);
            let process = whole.cast::<Process>();
            Process::set_methods(process, methods);
            process.as_ref().set_waker(waker::of_itself(process));
            if process.as_ref().record.timing.is_some() {
                process.as_ref().notify(Notice::TIMED);
            }
            (Self(process), ProcessRef(process))
        }
    }

    pub(crate) fn process(&self) -> &Process {
        // SAFETY: by the invariant the process has not ended, so it is live.
        unsafe { self.0.as_ref() }
    }

    pub(crate) fn executor(&self) -> &Arc<Shared> {
        let executor = self.process().record.executor.as_ref();
        executor.expect("`new` has set it")
    }

    /// Builds the body and queues the process, on its executor's thread. A builder is the user's
    /// code: if it panics, the process has ended before it began. Allocates.
    ///
    /// # Panics
    ///
    /// If this thread is not that of its executor.
    #[inline]
    pub(crate) fn build(self) {
        assert_eq!(
            current::executor_id(),
            Some(self.process().executor_id),
            "a process is built on its executor's thread"
        );
        let this = ManuallyDrop::new(self);
        let build = this.process().methods().of_body.build;
        // SAFETY: by the invariant the process is not built, and this is its executor's thread.
        match catch_unwind(|| unsafe { build(this.0) }) {
            // SAFETY: it was just built.
            Ok(()) => unsafe { run::start(this.0) },
            // SAFETY: nothing is left of the builder, and this is not used any more.
            Err(payload) => unsafe { this.end(state::PANICKED, Some(payload)) },
        }
    }

    /// # Safety
    ///
    /// Nothing is left of the builder, and this is not used any more.
    unsafe fn end(&self, outcome: u8, panic: Option<super::end::Payload>) {
        let process = self.process();
        // SAFETY: by the invariant it was not built, and has not ended: so this is the only call.
        // It lives until `end` frees it, if at all.
        unsafe {
            process.finish(outcome, panic);
            process.report();
            Process::end(self.0);
        }
    }
}

impl Drop for Unbuilt {
    fn drop(&mut self) {
        let clear = self.process().methods().of_body.clear;
        // What the builder holds is the user's: dropping it may panic. SAFETY: by the invariant the
        // process is not built, and this alone accesses its builder.
        let cleared = catch_unwind(|| unsafe { clear(self.0) });
        let (outcome, panic) = match cleared {
            Ok(()) => (state::CANCELLED, None),
            Err(payload) => (state::PANICKED, Some(payload)),
        };
        // SAFETY: also a drop that panics leaves nothing; this is the end of it.
        unsafe { self.end(outcome, panic) };
    }
}

//! The emergency manager: a thread above all others that waits for an emergency and then brings the machine to safety.

use crate::error::{Error, Result};
use luna_executors::Living;
use luna_platform::clock::Instant;
use luna_platform::shortfall::Shortfall;
use luna_platform::signals::{self, Signal, SignalError, SignalWatch};
use luna_platform::thread::{self, Attributes, EMERGENCY_PRIORITY, Policy, Thread};
use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

const NORMAL: u8 = 0;
/// Triggered by a process, or a signal was seen: the functions run.
const TRIGGERED: u8 = 1;
/// The functions have run.
const SAFE: u8 = 2;
/// The system has ended, with or without an emergency: the thread ends.
const ENDED: u8 = 3;

/// What the triggers share with the thread.
#[derive(Debug)]
pub(crate) struct Emergency {
    /// Only rises.
    phase: AtomicU8,
}

impl Emergency {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            phase: AtomicU8::new(NORMAL),
        })
    }

    /// Wakes the thread; the first trigger counts. From any thread, on the real-time path too: O(1), one system call.
    pub(crate) fn trigger(&self) {
        self.phase.fetch_max(TRIGGERED, Ordering::AcqRel);
        signals::announce_event();
    }

    /// Whether there is an emergency: the functions have run, or will.
    pub(crate) fn has_begun(&self) -> bool {
        matches!(self.phase.load(Ordering::Acquire), TRIGGERED | SAFE)
    }

    /// Whether the functions have run.
    pub(crate) fn is_safe(&self) -> bool {
        self.phase.load(Ordering::Acquire) == SAFE
    }

    fn end(&self) {
        self.phase.store(ENDED, Ordering::Release);
        signals::announce_event();
    }
}

/// A function that brings something to safety, with its name.
pub(crate) struct Function {
    pub(crate) name: String,
    pub(crate) run: Box<dyn FnMut() + Send>,
}

/// The thread, as the system sees it. Dropping it ends it.
pub(crate) struct EmergencyThread {
    emergency: Arc<Emergency>,
    thread: Option<Thread<Option<i32>>>,
}

impl EmergencyThread {
    /// Starts the thread, at the highest priority if the system is a `real_time` one. It watches for SIGINT and SIGTERM.
    pub(crate) fn start(
        emergency: Arc<Emergency>,
        functions: Vec<Function>,
        living: Arc<Living>,
        real_time: bool,
    ) -> Result<Self> {
        let watch = match SignalWatch::install(&[Signal::Interrupt, Signal::Terminate]) {
            Ok(watch) => Some(watch),
            // A platform without signals has the functions all the same, for panics.
            Err(SignalError::Unsupported) => None,
            Err(error) => return Err(error.into()),
        };
        let policy = if real_time {
            Policy::fifo(EMERGENCY_PRIORITY)
        } else {
            Policy::Other
        };
        let own = emergency.clone();
        let thread = thread::spawn(
            Attributes::framework("luna-emergency", policy),
            |_| Ok::<_, Infallible>(()),
            move |()| watch_over(&own, functions, watch, &living),
        )
        .map_err(|error| Error::not_started("the emergency manager", error))?;
        Ok(Self {
            emergency,
            thread: Some(thread),
        })
    }

    /// What the thread was refused.
    pub(crate) fn shortfalls(&self) -> &[Shortfall] {
        self.thread
            .as_ref()
            .map_or(&[], |thread| &thread.obtained().shortfalls)
    }

    /// Ends the thread; gives the signal that made the emergency, if one did.
    pub(crate) fn stop(mut self) -> Option<i32> {
        self.join()
    }

    fn join(&mut self) -> Option<i32> {
        self.emergency.end();
        // A panic in an emergency function is caught; the thread's own would have been reported by the panic hook.
        self.thread
            .take()
            .and_then(|thread| thread.join().ok())
            .flatten()
    }
}

impl Drop for EmergencyThread {
    fn drop(&mut self) {
        self.join();
    }
}

/// The life of the thread. Returns the signal that was received.
fn watch_over(
    emergency: &Emergency,
    mut functions: Vec<Function>,
    watch: Option<SignalWatch>,
    living: &Living,
) -> Option<i32> {
    let received = || watch.as_ref().and_then(SignalWatch::received);
    let mut seen = signals::event_count();
    // A signal that comes as the system ends is seen all the same.
    while received().is_none() && emergency.phase.load(Ordering::Acquire) != TRIGGERED {
        if emergency.phase.load(Ordering::Acquire) == ENDED {
            return received();
        }
        seen = signals::wait_for_event(seen, Instant::NEVER);
    }
    emergency.phase.fetch_max(TRIGGERED, Ordering::AcqRel);
    let mut panicked = Vec::new();
    for Function { name, run } in &mut functions {
        // The others must run whatever this one does.
        if let Err(payload) = catch_unwind(AssertUnwindSafe(run)) {
            // Its drop is the user's code too.
            std::mem::forget(payload);
            panicked.push(name.as_str());
        }
    }
    emergency.phase.fetch_max(SAFE, Ordering::AcqRel);
    living.announce();
    // Only now: standard error may be a pipe that nobody reads.
    for name in panicked {
        eprintln!("luna: emergency function `{name}` panicked; the others ran");
    }
    while emergency.phase.load(Ordering::Acquire) != ENDED {
        seen = signals::wait_for_event(seen, Instant::NEVER);
    }
    received()
}
